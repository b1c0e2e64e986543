"""From the plane in the camera frame to the surface in the world: inclination, bearing, per-axis slopes."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

NAN = math.nan
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Surface:
    """The surface relative to gravity, degrees; NaN without an attitude.

    ``pitch`` and ``roll`` are the slope angles with the vehicle's angle subtracted per axis: positive pitch
    rises ahead, positive roll falls to the right, as the vehicle's own angles that would match the surface.
    """

    inclination_deg: float = NAN
    inclination_std_deg: float = NAN
    bearing_deg: float = NAN
    pitch_deg: float = NAN
    roll_deg: float = NAN


def surface_in_ned(
    a: float, b: float, covariance: Array, ned_from_camera: Array, attitude_std_rad: float
) -> tuple[float, float, float]:
    """Inclination, its standard deviation and the downhill bearing, in degrees.

    The standard deviation is the root of the expected squared error: near level both axes count, because any
    error tilts the normal away from the vertical; on a slope only the error along the slope counts.
    """
    length = math.sqrt(a * a + b * b + 1)
    rows = ned_from_camera.tolist()
    north, east, down = ((z - x * a - y * b) / length for x, y, z in rows)
    horizontal = math.hypot(north, east)
    along = (north / horizontal, east / horizontal) if horizontal > 1e-9 else (1.0, 0.0)
    # error of the unit normal, in ned: the part along and across the slope
    of_a, of_b = (
        [(row[k] + unit * tangent / length) / length for row, unit in zip(rows, (north, east), strict=False)]
        for k, tangent in enumerate((a, b))
    )
    (aa, ab), (_, bb) = covariance.tolist()

    def variance(x: float, y: float) -> float:
        u, v = x * of_a[0] + y * of_a[1], x * of_b[0] + y * of_b[1]
        return u * u * aa + 2 * u * v * ab + v * v * bb

    var_attitude = attitude_std_rad**2
    var_along = variance(*along) / max(down**2, 1e-6) + var_attitude
    var_across = variance(-along[1], along[0]) + var_attitude
    if down < 0:
        north, east, down = -north, -east, -down
    # E[(|s + e| - s)^2] between the two limits: s = 0 gives both variances, large s the one along the slope. What is
    # measured is |s + e|: near level it is mostly error, and no evidence of a slope.
    slope2 = max(horizontal**2 - var_along - var_across, 0.0)
    share = (var_across / (var_across + slope2)) ** 2 if var_across > 0 else 0.0
    std = math.sqrt(var_along + share * var_across)
    inclination, bearing = math.atan2(horizontal, down), math.atan2(-east, -north)
    return math.degrees(inclination), math.degrees(std), math.degrees(bearing) % 360


def slopes_in_body(a: float, b: float, body_from_camera: Array) -> tuple[float, float]:
    """Slope angles (rad) of the surface along body x and body y: dz/dx and dz/dy of the plane, arc tangent."""
    x, y, z = (z - x * a - y * b for x, y, z in body_from_camera.tolist())
    return math.atan2(-x, z), math.atan2(-y, z)


def surface(
    a: float,
    b: float,
    covariance: Array,
    ned_from_camera: Array | None,
    body_from_camera: Array,
    roll: float,
    pitch: float,
    attitude_std_rad: float,
) -> Surface:
    """All of the above for one plane; NaN where the attitude is unknown."""
    if ned_from_camera is None or not math.isfinite(a + b):
        return Surface()
    inclination, std, bearing = surface_in_ned(a, b, covariance, ned_from_camera, attitude_std_rad)
    along_x, along_y = slopes_in_body(a, b, body_from_camera)
    # depth that grows ahead by tan(along_x) is ground that falls ahead; a nose-up pitch alone does the same
    return Surface(inclination, std, bearing, math.degrees(-along_x + pitch), math.degrees(along_y + roll))
