"""The time offset of the camera, how late its frames' stamps are, found along the way where the vehicle turns.

A frame stamped late by s was seen s before. Over a baseline the measured rotation old_from_new then is wrong by what
the camera turned in that time at both ends, d = (old_from_new^T w_old - w_new) s in the newest camera's axes, w the
rates of turn. The plane fit finds d from the tracks; a steady turn does not tell, a change of it does.
"""

import math

import numpy as np
from numpy.typing import NDArray

from landing.motion.views import Views
from landing.plane.plane import Plane

Array = NDArray[np.float64]

_LEAST_CHANGE = 0.02
"""Change of the rate of turn below which nothing is learnt, rad/s."""
_ORDINARY = 2.0
"""Surprises larger than this, in sigma, count by their size only and not by its square (Huber)."""

_FARTHEST = 10.0
"""Farther away than this, in sigma of what is known at first, it is something else."""


class TimeOffsetFilter:
    """A scalar Kalman filter: lateness ``late_s`` beyond the offset that is set, its standard deviation ``std_s``."""

    def __init__(self, std_s: float, drift: float, attitude_error_std_rad: float) -> None:
        """``attitude_error_std_rad``: what an attitude is wrong by for other reasons while the vehicle turns."""
        self.late_s, self.std_s = 0.0, std_s
        self._attitude_error2 = 2 * attitude_error_std_rad**2
        self._first_std_s, self._drift = std_s, drift
        self.farthest_s = _FARTHEST * std_s
        """Bound of the search: a lateness found there is at least so much."""
        self._last_s: float | None = None

    def loosen(self) -> None:
        """The clocks are set against each other anew: what was found is a guess again."""
        self.std_s = self._first_std_s

    def step(self, views: Views, plane: Plane) -> None:
        """Learn from the newest plane's fit."""
        now_s = views.newest.time_s
        if self._last_s is not None:
            grown = self.std_s**2 + self._drift**2 * (now_s - self._last_s)
            self.std_s = math.sqrt(min(grown, self._first_std_s**2))
        self._last_s = now_s
        found = plane.rotation_error
        if found is None or self.std_s == 0:
            return
        change = views.turn_change(plane.gap)
        if change is None or float(change[0] @ change[0]) < _LEAST_CHANGE**2:
            return
        per_second, taken_out = change
        # what the tracks alone tell of d, with the measured rotation's own noise: its precision, and that times d
        precision = found.prior_std**-2.0
        told = np.diag(precision) - precision[:, None] * found.covariance * precision
        # and with the errors of both attitudes, (told^-1 + Q)^-1 = (1 + told Q)^-1 told
        more = np.eye(3) + self._attitude_error2 * told
        both = np.linalg.solve(more, np.column_stack((told @ per_second, precision * found.mean)))
        weight = both[:, 0]
        information = float(per_second @ weight)
        left = per_second * self.late_s - taken_out
        surprise = float(per_second @ both[:, 1]) - float(weight @ left)
        if not (information > 0 and math.isfinite(surprise)):
            return
        sigmas = abs(surprise) / math.sqrt(information + (information * self.std_s) ** 2)
        # baselines that overlap say the same again
        share = min(1.0, _ORDINARY / max(sigmas, 1e-9)) / plane.gap
        variance = 1.0 / (self.std_s**-2.0 + share * information)
        self.late_s = min(max(self.late_s + variance * share * surprise, -self.farthest_s), self.farthest_s)
        self.std_s = math.sqrt(variance)
