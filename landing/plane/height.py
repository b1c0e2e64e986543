"""Height from the velocity that the autopilot knows and the ventral flow that the camera sees: h = V / omega.

At one moment the velocity's slow error is all in it: of a vehicle that creeps, the ratio is of two errors. As the slope
of velocity against flow over time (``landing/ground/ground_velocity.py``) that error drops out.
"""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ROUNDS = 3
_LEAST = 1e-9
"""Where neither has an error, 1/s."""


def height(
    velocity: Array, velocity_std: float, omega: Array, omega_std: Array, max_relative_std: float
) -> tuple[float, float]:
    """Distance to the surface along the optical axis and its standard deviation, m.

    ``velocity`` (3,) m/s and ``omega`` (3,) 1/s in the camera frame; the inverse height that fits all three axes
    best, both with their errors. NaN where the motion does not determine it within ``max_relative_std``.
    """
    axes = list(zip(velocity.tolist(), omega.tolist(), omega_std.tolist(), strict=True))
    speed2 = sum(v * v for v, _, _ in axes)
    inverse = sum(v * w for v, w, _ in axes) / speed2 if speed2 > 0 else math.nan
    if not math.isfinite(inverse):
        return math.nan, math.nan
    for _ in range(_ROUNDS):
        if inverse <= 0:
            return math.nan, math.nan
        # an error of the velocity counts by what it makes of omega
        floor = (velocity_std * inverse) ** 2 + _LEAST**2
        information = sum(v * v / (std * std + floor) for v, _, std in axes)
        inverse = sum(v * w / (std * std + floor) for v, w, std in axes) / information
    relative = 1.0 / (math.sqrt(information) * inverse)
    if not 0 < relative <= max_relative_std:
        return math.nan, math.nan
    return 1.0 / inverse, relative / inverse


class BetterHeight:
    """The ratio while the velocity is large beside its error, then the slope where it is surer.

    A velocity that is a share of the true one makes a straight line as well, of a distance that is too small. So the
    slope counts once the velocity has been large, and until the slope is lost.
    """

    def __init__(self, vouched_std: float) -> None:
        """``vouched_std``: relative standard deviation of the ratio by which the velocity vouches for itself."""
        self._vouched_std = vouched_std
        self._vouched = False

    def forget(self) -> None:
        """The slope is another from now on."""
        self._vouched = False

    def step(self, ratio: tuple[float, float], slope: tuple[float, float]) -> tuple[float, float]:
        """Height and standard deviation, m, from those of the ratio and of the slope; NaN where one is unknown."""
        (height_m, std_m), (line_m, line_std_m) = ratio, slope
        if not line_m > 0:
            self._vouched = False
            return ratio
        if height_m > 0 and std_m <= self._vouched_std * height_m:
            self._vouched = True
            return ratio
        if not self._vouched:
            return ratio
        return ratio if height_m > 0 and std_m * line_m <= line_std_m * height_m else slope
