"""Every threshold of the mathematics: a bounded field with a unit and a default."""

from dataclasses import dataclass, field
from typing import Annotated, Literal


@dataclass(frozen=True, slots=True)
class Limits:
    """The closed range of a number, its unit and its meaning; stands in ``Annotated`` behind the type."""

    low: float
    high: float
    unit: str = ""
    meaning: str = ""


@dataclass(frozen=True, slots=True)
class TrackingOptions:
    """Corners and their tracks."""

    max_features: Annotated[int, Limits(20, 1000, "", "corners tracked at once")] = 150
    window_px: Annotated[int, Limits(5, 41, "px", "side of the Lucas-Kanade window")] = 15
    levels: Annotated[
        int, Limits(0, 5, "", "pyramid levels above the image where the motion is predicted")
    ] = 1
    levels_unpredicted: Annotated[int, Limits(0, 5, "", "pyramid levels above the image where it is not")] = 3
    blur_px: Annotated[float, Limits(0, 3, "px", "sigma of the blur before tracking; cuts pixel locking")] = (
        0.8
    )
    gain_step: Annotated[float, Limits(0, 1, "", "relative change of brightness that is evened out")] = 0.01
    corner_quality: Annotated[float, Limits(0, 1, "", "weakest corner, relative to the strongest")] = 0.01
    corner_min: Annotated[float, Limits(0, 1, "", "weakest corner, smaller eigenvalue of the gradients")] = (
        1e-5
    )
    renew_below: Annotated[float, Limits(0, 1, "", "share of tracks left at which corners are added")] = 0.75
    renew_after_frames: Annotated[int, Limits(1, 1000, "frames", "oldest reference image")] = 15
    renew_after_px: Annotated[float, Limits(1, 1000, "px", "largest motion from the reference image")] = 12.0
    renew_after_growth: Annotated[
        float, Limits(0.01, 1, "", "largest growth or turn (rad) from the reference")
    ] = 0.06
    forward_backward_max_px: Annotated[
        float, Limits(0.05, 5, "px", "a track that does not come back to its start within this is refused")
    ] = 0.5


@dataclass(frozen=True, slots=True)
class EstimatorOptions:
    """How the flow field becomes a plane."""

    method: Annotated[
        Literal["map", "quadratic"],
        "exact maximum a posteriori plane fit, or the paper's quadratic flow fits",
    ] = "map"
    seed: Annotated[int, Limits(0, 2**31 - 1, "", "seed of the random hypotheses")] = 1
    use_attitude: Annotated[bool, "take the vehicle's attitude out of the slopes"] = True
    attitude_std_deg: Annotated[
        float, Limits(0, 10, "deg", "error of the autopilot's roll and pitch, one sigma")
    ] = 0.2
    min_tracks: Annotated[int, Limits(12, 500, "", "fewest tracks for an estimate")] = 24
    min_coverage: Annotated[float, Limits(0, 1, "", "smallest share of the image with tracks")] = 0.2
    min_roughness_tracks: Annotated[int, Limits(8, 500, "", "fewest tracks for a roughness")] = 20
    noise_floor_px: Annotated[float, Limits(0.001, 1, "px", "smallest track noise believed")] = 0.03
    noise_cap_px: Annotated[float, Limits(0.1, 10, "px", "largest track noise believed")] = 2.0
    map_flow_px: Annotated[float, Limits(1, 100, "px", "median flow of the baseline taken")] = 14.0
    map_min_flow_px: Annotated[
        float, Limits(0.05, 50, "px", "smallest median flow an estimate is made from")
    ] = 1.5
    map_keep_tracks: Annotated[float, Limits(0, 1, "", "share of the tracks that the baseline must keep")] = (
        0.6
    )
    rotation_std_rad: Annotated[
        float, Limits(0, 0.1, "rad", "error of measured roll and pitch over a baseline")
    ] = 5e-4
    yaw_std_rad: Annotated[float, Limits(0, 0.1, "rad", "error of measured yaw over a baseline")] = 1.5e-3
    unmeasured_rotation_std_rad: Annotated[float, Limits(0, 1, "rad", "rotation without any measurement")] = (
        0.1
    )
    slope_std: Annotated[float, Limits(0.1, 10, "", "prior of the slope tangents")] = 1.0
    quadratic_hypotheses: Annotated[int, Limits(1, 1000, "", "RANSAC hypotheses of a fit")] = 20
    quadratic_inlier_px: Annotated[float, Limits(0.05, 10, "px", "largest error of an inlier")] = 0.5
    quadratic_flow_px: Annotated[
        float, Limits(0.1, 50, "px", "median flow of the shortest baseline taken")
    ] = 3.0
    quadratic_max_gap: Annotated[int, Limits(1, 60, "frames", "longest baseline")] = 8
    quadratic_min_flow: Annotated[float, Limits(0.001, 1, "1/s", "ventral flow for first-order slopes")] = (
        0.06
    )
    quadratic_min_divergence: Annotated[
        float, Limits(0.001, 1, "1/s", "divergence for second-order slopes")
    ] = 0.06


@dataclass(frozen=True, slots=True)
class DecisionOptions:
    """When a surface counts as fit for landing."""

    max_inclination_deg: Annotated[float, Limits(1, 45, "deg", "steepest surface that is landed on")] = 10.0
    max_roughness: Annotated[float, Limits(0.001, 0.2, "", "largest RMS relief over distance landed on")] = (
        0.009
    )
    sigmas: Annotated[
        float, Limits(0, 6, "", "standard deviations added to an estimate before it is compared")
    ] = 2.0
    hysteresis: Annotated[
        float, Limits(0, 1, "", "share by which a limit widens once the surface is fit")
    ] = 0.15
    dwell_s: Annotated[float, Limits(0, 10, "s", "how long a surface must be flat before it is fit")] = 0.5
    patience_s: Annotated[float, Limits(0, 5, "s", "how long a fit surface may go without an estimate")] = 0.3
    min_coverage: Annotated[float, Limits(0, 1, "", "smallest share of the image with tracks")] = 0.35


@dataclass(frozen=True, slots=True)
class Options:
    """All of the above, as one pipeline takes them."""

    tracking: TrackingOptions = field(default_factory=TrackingOptions)
    estimator: EstimatorOptions = field(default_factory=EstimatorOptions)
    decision: DecisionOptions = field(default_factory=DecisionOptions)
