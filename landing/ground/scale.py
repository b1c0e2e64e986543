"""Metres: the distance to the plane, from whatever knows it, carried on by the divergence of the view."""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_DRIFT = 0.1
"""Relative change of the distance in a second that the view does not show, one sigma: the ground below changes."""
_GATE = 3.0
"""Standard deviations by which a measurement must differ to start anew."""
_HELD_S = 0.3
"""Time constant over which a measurement must hold, s: of a single velocity its noise may be the whole."""


class Scale:
    """Distance along the plane's normal, m, with its relative standard deviation.

    Errors of the vehicle's velocity are slow: measurements of the same moments share them, so that averaging takes out
    noise only, and the standard deviation is that of the best third of a second of measurements, growing since: of
    the mean of their information, to which a moment without a measurement adds nothing. The best single one would be
    the one with the largest noise: of a vehicle that hovers, every velocity is noise, and over moving ground the view
    moves.
    """

    def __init__(self) -> None:
        self.distance_m = math.nan
        self.relative_std = math.inf
        self._noise2 = math.inf
        self._information = 0.0

    def forget(self) -> None:
        """Nothing is known."""
        self.distance_m, self.relative_std, self._noise2 = math.nan, math.inf, math.inf
        self._information = 0.0

    def step(self, interval_s: float, approach: float, measured_m: float, std_m: float) -> None:
        """Carry on over ``interval_s``; ``approach`` (1/s) is the speed towards the plane over the distance.

        ``measured_m`` with ``std_m`` is the distance along the normal, NaN where nothing measures it.
        """
        measures = math.isfinite(measured_m) and measured_m > 0 and std_m > 0
        relative = std_m / measured_m if measures else math.inf
        if not math.isfinite(approach) or not 0 <= interval_s < 1:
            self.forget()
        else:
            self.distance_m *= math.exp(-approach * interval_s)
            self._noise2 += _DRIFT**2 * interval_s
            self.relative_std = math.hypot(self.relative_std, _DRIFT * math.sqrt(interval_s))
            self._information += (1 - math.exp(-interval_s / _HELD_S)) * (relative**-2 - self._information)
        if not measures:
            return
        if not math.isfinite(self.distance_m):
            self._begin(measured_m, relative)
            return
        innovation = math.log(measured_m / self.distance_m)
        if abs(innovation) > _GATE * math.hypot(relative, self.relative_std):
            self._begin(measured_m, relative)
            return
        gain = self._noise2 / (self._noise2 + relative**2)
        self.distance_m *= math.exp(gain * innovation)
        self._noise2 *= 1 - gain
        if self._information > 0:
            self.relative_std = min(self.relative_std, self._information**-0.5)

    def _begin(self, measured_m: float, relative: float) -> None:
        """Start from a single measurement, whose standard deviation is not established yet."""
        self.forget()
        self.distance_m, self._noise2 = measured_m, relative**2


def along_normal(height_m: float, normal: Array) -> float:
    """Distance along the normal (3,) of a plane that is ``height_m`` away along the axis."""
    return height_m / float(np.linalg.norm(normal))
