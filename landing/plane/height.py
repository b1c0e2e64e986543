"""Height from the autopilot's velocity and the ventral flow that the camera sees, h = V / omega, or a rangefinder.

Each has its error; they are fused, and compared where both are known. At one moment the velocity's slow error is all
in the ratio: of a vehicle that creeps, it is one of two errors. As the slope of velocity against flow over time
(``landing/ground/ground_velocity.py``) that error drops out.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ROUNDS = 3
_LEAST = 1e-9
"""Where neither has an error, 1/s."""
_GROUND_SHARE = 0.05
"""What the ground at the rangefinder's spot and the plane of the view differ by, over the distance, one sigma."""
_DRIFT_M_S = 0.3
"""Slow error of the autopilot's velocity, one sigma, when it is held against another source: GPS drift."""


@dataclass(frozen=True, slots=True)
class Height:
    """Distance to the surface along the optical axis with one sigma, m, and its source; NaN and "" where unknown.

    ``chi2``, one degree of freedom: how far its two sources disagree; NaN where there are not two.
    """

    value_m: float = math.nan
    std_m: float = math.nan
    source: str = ""
    chi2: float = math.nan


def of_sources(by_velocity: tuple[float, float], by_range: tuple[float, float], speed_m_s: float) -> Height:
    """One height of two, each (m, one sigma), NaN where unknown; relative errors are taken as Gaussian.

    ``speed_m_s`` is the velocity that the first is from: its slow error counts when the two are compared.
    """
    velocity_known, range_known = (
        math.isfinite(value) and math.isfinite(std) and value > 0 and std > 0
        for value, std in (by_velocity, by_range)
    )
    if not velocity_known and not range_known:
        return Height()
    if not range_known:
        return Height(*by_velocity, "velocity")
    if not velocity_known:
        return Height(*by_range, "rangefinder")
    (first, first_std), (second, second_std) = by_velocity, by_range
    a, b = (first_std / first) ** 2, (second_std / second) ** 2
    apart = math.log(first / second)
    drift = (_DRIFT_M_S / speed_m_s) ** 2 if speed_m_s > 0 else math.inf
    both = second * math.exp(apart * b / (a + b))
    return Height(both, both * math.sqrt(a * b / (a + b)), "both", apart * apart / (a + b + drift))


def along_axis(range_m: float, std_m: float, down: Array, normal: Array) -> tuple[float, float]:
    """Height along the optical axis, and one sigma, from a distance ``range_m`` along the ray ``down`` (3,), unit.

    Both ray and ``normal`` (3,), (-a, -b, 1), are in the camera's axes: X on the plane has n . X = h. NaN where the
    ray does not meet the plane.
    """
    share = float(normal @ down)
    if not (share > 0 and range_m > 0 and std_m > 0):
        return math.nan, math.nan
    value = range_m * share
    return value, value * math.hypot(std_m / range_m, _GROUND_SHARE)


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


_AGREE = 2.0
"""Standard deviations within which ratio and slope must agree for the slope to count later."""


class BetterHeight:
    """The ratio while the velocity is large beside its error, then the slope where it is surer.

    A velocity that is a share of the true one makes a straight line as well, of a distance that is too small. So the
    slope counts once the velocity has been large and both agreed, and until the slope is lost.
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
            self._vouched = abs(height_m - line_m) <= _AGREE * math.hypot(std_m, line_std_m)
            return ratio
        if not self._vouched:
            return ratio
        return ratio if height_m > 0 and std_m * line_m <= line_std_m * height_m else slope
