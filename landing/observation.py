"""What one step of the pipeline is given."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Observation:
    """One exposure and what the vehicle knew of itself at its middle.

    ``image`` is (height, width) uint8 grey. ``time_s`` counts from any fixed origin and rises from
    observation to observation. ``ned_from_body`` is the (3, 3) attitude at mid-exposure, or None;
    ``rotation_std_rad`` the standard deviation of the error of the rotation between two exposures, per axis
    (timing, interpolation, sensor), ``rotation_wander`` (3,) what it grows by with time about the body's axes, in rad
    per root second, ``tilt_std_rad`` that of roll and pitch themselves for want of the exact
    moment. ``velocity_ned`` is (3,) m/s with one standard deviation for all axes, measured from what lies
    ``velocity_age_s`` from the exposure; ``velocity_noise`` is the part of its error that changes from frame to
    frame, one sigma of an axis in m/s, and ``velocity_factor`` its slow part over the one that is assumed.
    ``turn_rate`` is (3,) rad/s about the body's axes; ``late_s`` the lateness of the stamps, beyond the one that is
    set, that all of this allows for; ``delay_s`` goes from the exposure to the stamp in all: how far the vehicle has
    flown on since matters to where it comes down. ``range_m`` is a rangefinder's distance along the body's z axis, NaN
    where there is none, and ``range_std_m`` one sigma of it.
    """

    frame: int
    time_s: float
    image: NDArray[np.uint8]
    ned_from_body: NDArray[np.float64] | None = None
    rotation_std_rad: float = 1e-3
    velocity_ned: NDArray[np.float64] | None = None
    velocity_std: float = 0.2
    velocity_age_s: float = 0.0
    velocity_noise: float = 0.0
    velocity_factor: float = 1.0
    tilt_std_rad: float = 0.0
    turn_rate: NDArray[np.float64] | None = None
    late_s: float = 0.0
    delay_s: float = 0.0
    range_m: float = math.nan
    range_std_m: float = math.nan
    rotation_wander: NDArray[np.float64] | None = None
