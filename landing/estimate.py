"""What one step of the pipeline returns."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from landing.reasons import Reason

NAN = math.nan


@dataclass(frozen=True, slots=True)
class TrackView:
    """The tracks behind an estimate, for pictures: pixels of the raw (distorted) image.

    ``previous_px`` and ``current_px`` are (n, 2); ``inlier`` (n,) bool: the track moves as the plane says;
    ``height`` (n,) height of the point over the plane, over the distance along the axis (NaN: unknown).
    """

    previous_px: NDArray[np.float64]
    current_px: NDArray[np.float64]
    inlier: NDArray[np.bool_]
    height: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SurfaceEstimate:
    """The surface below at one frame. Camera frame unless stated; NaN where the motion does not determine it.

    ``status`` is "ok" or the reason there is no estimate. Standard deviations are one sigma.
    """

    frame: int
    time_s: float
    status: str
    method: str
    ventral_flow_x: float = NAN
    ventral_flow_y: float = NAN
    divergence: float = NAN
    time_to_contact_s: float = NAN
    slope_x_deg: float = NAN
    slope_y_deg: float = NAN
    slope_x_std_deg: float = NAN
    slope_y_std_deg: float = NAN
    roll_deg: float = NAN
    pitch_deg: float = NAN
    surface_pitch_deg: float = NAN
    surface_roll_deg: float = NAN
    inclination_deg: float = NAN
    inclination_std_deg: float = NAN
    downhill_bearing_deg: float = NAN
    roughness: float = NAN
    roughness_std: float = NAN
    height_m: float = NAN
    height_std_m: float = NAN
    height_source: str = ""
    """"velocity", "rangefinder", or "both"; empty while the height is unknown."""
    ground_speed_m_s: float = NAN
    """Of the ground by itself, with the slow error of the autopilot's velocity."""
    ground_speed_std_m_s: float = NAN
    features: int = 0
    inlier_fraction: float = NAN
    fit_error_px: float = NAN
    coverage: float = NAN
    blind: float = 0.0
    """Share of the view in areas without any track, what is masked aside."""
    obstacle_points: int = 0
    unsettled: bool = False
    """What makes it rough has just come into view and was not there in the frame before."""
    suspicious: bool = False
    """Ground that has just come into view may have relief."""
    appearance_change: bool = False
    """The brightness of ground that has just come into view differs from the rest; it is not measured yet."""
    flat: bool = False
    against_flat: tuple[Reason, ...] = ()
    tracks: TrackView | None = field(default=None, compare=False)
