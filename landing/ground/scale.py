"""Metres: the distance to the plane, from whatever knows it, carried on by the divergence of the view."""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_DRIFT = 0.1
"""Relative change of the distance in a second that the view does not show, one sigma: the ground below changes."""
_GATE = 3.0
"""Standard deviations by which a measurement must differ to start anew."""


class Scale:
    """Distance along the plane's normal, m, with its relative standard deviation.

    Errors of the vehicle's velocity are slow: measurements of the same moments share them, so that averaging takes out
    noise only, and the standard deviation is that of the best measurement, growing since.
    """

    def __init__(self) -> None:
        self.distance_m = math.nan
        self.relative_std = math.inf
        self._noise2 = math.inf

    def forget(self) -> None:
        """Nothing is known."""
        self.distance_m, self.relative_std, self._noise2 = math.nan, math.inf, math.inf

    def step(self, interval_s: float, approach: float, measured_m: float, std_m: float) -> None:
        """Carry on over ``interval_s``; ``approach`` (1/s) is the speed towards the plane over the distance.

        ``measured_m`` with ``std_m`` is the distance along the normal, NaN where nothing measures it.
        """
        if not math.isfinite(approach) or not 0 <= interval_s < 1:
            self.forget()
        else:
            self.distance_m *= math.exp(-approach * interval_s)
            self._noise2 += _DRIFT**2 * interval_s
            self.relative_std = math.hypot(self.relative_std, _DRIFT * math.sqrt(interval_s))
        if not (math.isfinite(measured_m) and measured_m > 0 and std_m > 0):
            return
        relative = std_m / measured_m
        if not math.isfinite(self.distance_m):
            self.distance_m, self.relative_std, self._noise2 = measured_m, relative, relative**2
            return
        innovation = math.log(measured_m / self.distance_m)
        if abs(innovation) > _GATE * math.hypot(relative, self.relative_std):
            self.distance_m, self.relative_std, self._noise2 = measured_m, relative, relative**2
            return
        gain = self._noise2 / (self._noise2 + relative**2)
        self.distance_m *= math.exp(gain * innovation)
        self._noise2 *= 1 - gain
        self.relative_std = min(self.relative_std, relative)


def along_normal(height_m: float, normal: Array) -> float:
    """Distance along the normal (3,) of a plane that is ``height_m`` away along the axis."""
    return height_m / float(np.linalg.norm(normal))
