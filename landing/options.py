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
    window_px: Annotated[int, Limits(5, 41, "px", "side of the Lucas-Kanade window")] = 16
    grey_noise: Annotated[float, Limits(0.1, 50, "grey", "image noise after the stretch, for weights")] = 4.0
    match_std_px: Annotated[
        float, Limits(0.001, 1, "px", "error of a match that no texture helps against")
    ] = 0.05


@dataclass(frozen=True, slots=True)
class EstimatorOptions:
    """How the flow field becomes a plane."""

    method: Annotated[
        Literal["map", "quadratic"],
        "exact maximum a posteriori plane fit, or the paper's quadratic flow fits",
    ] = "map"
    seed: Annotated[int, Limits(0, 2**31 - 1, "", "seed of the random hypotheses")] = 1
    time_offset_std_s: Annotated[
        float, Limits(0, 0.1, "s", "error of camera.time_offset_s, one sigma; 0: known, none is looked for")
    ] = 0.01
    time_offset_drift: Annotated[
        float, Limits(0, 0.01, "s/sqrt(s)", "random walk of the error of camera.time_offset_s")
    ] = 3e-4
    use_attitude: Annotated[bool, "take the vehicle's attitude out of the slopes"] = True
    attitude_std_deg: Annotated[
        float, Limits(0, 10, "deg", "error of the autopilot's roll and pitch, one sigma")
    ] = 0.125
    attitude_scale_std: Annotated[
        float,
        Limits(0, 0.2, "", "the same as a share of the vehicle's tilt, which an autopilot knows less well"),
    ] = 0.01
    min_tracks: Annotated[int, Limits(12, 500, "", "fewest tracks for an estimate")] = 24
    min_coverage: Annotated[float, Limits(0, 1, "", "smallest share of the image with tracks")] = 0.2
    map_max_flow_px: Annotated[float, Limits(1, 200, "px", "longest flow over a baseline")] = 45.0
    map_min_flow_px: Annotated[
        float, Limits(0.05, 50, "px", "smallest RMS flow an estimate is made from")
    ] = 5.0
    max_slope_std_deg: Annotated[
        float, Limits(0.1, 30, "deg", "uncertainty above which the slope is unknown")
    ] = 1.0
    motion_span_s: Annotated[float, Limits(0.02, 2, "s", "interval that the newest motion is taken from")] = (
        0.25
    )
    acceleration_std: Annotated[float, Limits(0.01, 100, "1/s^2", "usual acceleration over height")] = 2.0
    guided_span_s: Annotated[
        float, Limits(0.02, 2, "s", "the same interval where the vehicle's velocity is known")
    ] = 0.5
    guided_acceleration_std: Annotated[
        float, Limits(0.001, 10, "m/s^2", "error of what the vehicle's velocity says of an acceleration")
    ] = 0.03
    max_acceleration: Annotated[
        float,
        Limits(0.5, 100, "m/s^2", "change of the vehicle's velocity that counts as a jump of its filter"),
    ] = 8.0
    guided_velocity_std: Annotated[
        float, Limits(0.001, 2, "m/s", "slow error of the vehicle's velocity there, one sigma")
    ] = 0.06
    velocity_agreement: Annotated[
        float, Limits(1, 1000, "", "chi-square at which the images contradict the vehicle's velocity")
    ] = 50.0
    velocity_max_age_s: Annotated[
        float, Limits(0.01, 2, "s", "oldest velocity at an exposure that its changes are taken from")
    ] = 0.06
    attitude_error_std_rad: Annotated[
        float, Limits(0, 0.05, "rad", "error of an attitude that changes as the vehicle turns, one sigma")
    ] = 7e-4
    shared_error_px: Annotated[
        float, Limits(0, 1, "px", "error of all matches of a frame alike, one sigma")
    ] = 0.12
    memory_s: Annotated[float, Limits(0, 30, "s", "how far back estimates are fused")] = 2.0
    rotation_std_rad: Annotated[
        float, Limits(0, 0.1, "rad", "error of measured roll and pitch over a baseline")
    ] = 5e-4
    yaw_std_rad: Annotated[float, Limits(0, 0.1, "rad", "error of measured yaw over a baseline")] = 1.5e-3
    relief_cells: Annotated[
        int, Limits(4, 1000, "", "cells of the view that count alike in the roughness")
    ] = 80
    relief_scale: Annotated[float, Limits(0.0005, 0.1, "", "relief that matters, over the distance")] = 0.01
    standing_sigmas: Annotated[
        float, Limits(1, 20, "sigma", "height of an obstacle point, in its own uncertainty")
    ] = 5.0
    standing_height: Annotated[
        float, Limits(0.001, 1, "", "height of an obstacle point, over the distance")
    ] = 0.025
    standing_kept: Annotated[
        float, Limits(0, 1, "", "share of its height in the frame before that an obstacle point must keep")
    ] = 0.85
    standing_frames: Annotated[
        int, Limits(1, 100, "frames", "how long a point must be an obstacle point to count")
    ] = 2
    margin_kept: Annotated[
        float, Limits(0, 0.5, "", "border beyond the view, over its width, still remembered")
    ] = 0.025
    remembered: Annotated[int, Limits(0, 1000, "", "obstacle points that are remembered")] = 100
    border_flow_px: Annotated[
        float, Limits(0.5, 20, "px", "motion over which the border of the view is looked at")
    ] = 2.5
    border_step_px: Annotated[
        float, Limits(0, 20, "px", "motion after which it is looked at again, when no relief was found")
    ] = 2.0
    border_sigmas: Annotated[
        float, Limits(1, 20, "sigma", "height at the border that counts as relief, in its own uncertainty")
    ] = 7.0
    border_side_sigmas: Annotated[
        float, Limits(1, 20, "sigma", "the same of a whole side, from which nothing is called flat")
    ] = 5.0
    border_noise: Annotated[
        float, Limits(0.5, 10, "", "error of a block's height over what its pixels say")
    ] = 0.9
    border_locking_px: Annotated[
        float, Limits(0, 1, "px", "error of a block's shift that no texture helps against")
    ] = 0.1
    appearance_change: Annotated[
        float,
        Limits(
            0.05, 10, "", "logarithm of the brightness ratio from which new ground may be another surface"
        ),
    ] = 0.15
    appearance_change_sigmas: Annotated[
        float, Limits(1, 20, "sigma", "the same over how much it usually changes there")
    ] = 2.5
    drop_off_sigmas: Annotated[
        float,
        Limits(1, 20, "sigma", "mean height of the tracks nearest to a side that counts as a step edge"),
    ] = 6.0
    drop_off_floor: Annotated[
        float, Limits(0, 0.1, "", "error of a young track's height, over the distance, beside its own")
    ] = 0.005
    drop_off_tracks: Annotated[int, Limits(2, 100, "", "fewest tracks such a mean is taken of")] = 4
    drop_off_share: Annotated[
        float, Limits(0.02, 0.5, "", "share of the view, from a side, that such a mean reaches into")
    ] = 0.35
    max_roughness_std: Annotated[
        float, Limits(0.0005, 0.1, "", "uncertainty above which roughness is unknown")
    ] = 0.01
    max_height_std: Annotated[
        float, Limits(0.01, 1, "", "relative uncertainty above which height is unknown")
    ] = 0.6
    quadratic_max_gap: Annotated[int, Limits(1, 60, "frames", "longest baseline")] = 12


@dataclass(frozen=True, slots=True)
class GroundOptions:
    """The ground map: how it is measured, and what a disc of ground must be to be landed on."""

    landing_radius_m: Annotated[
        float, Limits(0.1, 2, "m", "radius of the disc of ground that the vehicle stands on")
    ] = 0.5
    max_step_m: Annotated[
        float, Limits(0.01, 1, "m", "largest step within that disc that the vehicle can stand on")
    ] = 0.05
    max_inclination_deg: Annotated[float, Limits(1, 45, "deg", "steepest disc that is landed on")] = 10.0
    sigmas: Annotated[
        float, Limits(0, 6, "", "standard deviations added to what is measured before it is compared")
    ] = 2.0
    min_known: Annotated[float, Limits(0.5, 1, "", "smallest known share of a disc")] = 0.9
    min_looks: Annotated[
        float, Limits(0.1, 10, "", "independent looks, in baselines, from which a cell counts as known")
    ] = 0.7
    memory_s: Annotated[float, Limits(0.5, 60, "s", "how long a look counts")] = 6.0
    max_scale_std: Annotated[
        float, Limits(0.01, 1, "", "relative uncertainty of metres above which nothing is landable")
    ] = 0.45
    baseline: Annotated[
        float, Limits(0.01, 0.3, "", "flow over a look's baseline, over the width of the picture")
    ] = 0.06
    look_step: Annotated[
        float, Limits(0.05, 2, "", "motion from look to look, over that of a look's baseline")
    ] = 0.35
    max_std: Annotated[
        float, Limits(0.001, 0.2, "", "uncertainty of a block's distance, over it, above which it is unknown")
    ] = 0.03


@dataclass(frozen=True, slots=True)
class DecisionOptions:
    """When a surface counts as fit for landing."""

    max_inclination_deg: Annotated[float, Limits(1, 45, "deg", "steepest surface that is landed on")] = 10.0
    max_roughness: Annotated[float, Limits(0.001, 0.2, "", "largest RMS relief over distance landed on")] = (
        0.009
    )
    sigmas: Annotated[
        float, Limits(0, 6, "", "standard deviations added to the inclination before it is compared")
    ] = 2.0
    hysteresis: Annotated[
        float, Limits(0, 1, "", "share by which a limit widens once the surface is fit")
    ] = 0.15
    dwell_s: Annotated[float, Limits(0, 10, "s", "how long a surface must be flat before it is fit")] = 0.8
    patience_s: Annotated[float, Limits(0, 5, "s", "how long a fit surface may go without an estimate")] = 0.3
    roughness_sigmas: Annotated[float, Limits(0, 6, "", "standard deviations added to the roughness")] = 1.0
    max_relief_m: Annotated[
        float, Limits(0.005, 10, "m", "RMS relief landed on, where the height is known")
    ] = 0.04
    max_patch_m: Annotated[
        float,
        Limits(0.02, 10, "m", "side of the ground one track averages over, where the height is known"),
    ] = 0.45
    landing_radius_m: Annotated[
        float, Limits(0.05, 10, "m", "radius of the ground below that must be measured")
    ] = 0.5
    min_area_measured: Annotated[float, Limits(0, 1, "", "smallest measured share of that ground")] = 0.8
    max_standing: Annotated[int, Limits(0, 100, "", "obstacle points that a flat surface may have")] = 0
    min_coverage: Annotated[float, Limits(0, 1, "", "smallest share of the image with tracks")] = 0.35
    max_ground_speed_m_s: Annotated[
        float, Limits(0.05, 10, "m/s", "speed of the ground by itself, as far as it is known, landed on")
    ] = 0.3
    at_rest_known: Annotated[bool, "require ground that is known to be at rest"] = True
    touchdown_known: Annotated[
        bool, "require measured ground all the way to the stopping point, not only straight below"
    ] = True


@dataclass(frozen=True, slots=True)
class Options:
    """All of the above, as one pipeline takes them."""

    tracking: TrackingOptions = field(default_factory=TrackingOptions)
    estimator: EstimatorOptions = field(default_factory=EstimatorOptions)
    decision: DecisionOptions = field(default_factory=DecisionOptions)
    ground: GroundOptions = field(default_factory=GroundOptions)
