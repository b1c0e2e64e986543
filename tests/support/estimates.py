"""Estimates as the tests of decision and permission feed them."""

from landing.estimate import SurfaceEstimate

FLAT = SurfaceEstimate(
    0,
    0.0,
    "ok",
    "map",
    inclination_deg=1.0,
    inclination_std_deg=0.1,
    roughness=0.001,
    roughness_std=0.0001,
    coverage=1.0,
    flat=True,
)
