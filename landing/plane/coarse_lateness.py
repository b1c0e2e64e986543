"""How late a camera is, roughly and over a wide range: the pictures' rotation against the vehicle's, shifted in time.

Network cameras are 0.1 to 0.5 s late. A filter that starts at zero does not find that: a rotation measured half a
swing off is wrong by more than the fit allows. So first the rotation between two frames is found from the tracks
alone, with next to no trust in the measured one, and compared with the vehicle's at every shift of a grid: a
cross-correlation, each pair of frames weighted by the information of its tracks about each axis.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from landing.motion.views import Views
from landing.plane.plane import Plane
from landing.plane.turn_comparison import picture_rotation
from landing.rotations import log_so3

Array = NDArray[np.float64]

EARLIEST_S, LATEST_S = -0.1, 0.6
"""The range of the search; what is found at its ends is at least so much."""
_STEP_S = 0.02
_SPAN_S, _EVERY_S = 0.1, 0.1
"""Between the two frames of a pair, and from one pair to the next."""
_NOISE_RAD = 1e-3
"""What the rotation between two frames is wrong by whatever the tracks say: of attitudes, lens and rows."""
_PAIRS, _LEAST_PAIRS = 150, 25
_APART_S = 0.07
"""A shift farther away than this from the best one is another answer."""
_SURE = 20.0
"""Logarithm of the likelihood by which the best shift is better than every other answer."""
_CORRELATION = 0.8
"""Least correlation of both rotations at the best shift."""
_LOOK_EVERY = 5
"""Pairs from one look at the curve to the next."""
_ATTITUDES = 128
"""Attitudes kept at first; twice as many where they come faster."""

SHIFTS: Array = np.linspace(EARLIEST_S, LATEST_S, round((LATEST_S - EARLIEST_S) / _STEP_S) + 1)


class CoarseLateness:
    """Feed it every frame's views; ``step`` returns the lateness when it is sure of one, else None."""

    def __init__(self) -> None:
        self._count = 0
        self._time_s = np.zeros(_ATTITUDES)
        self._attitude = np.zeros((_ATTITUDES, 3, 3))
        self._turned = np.zeros((_ATTITUDES, 3))
        """Rotation vector from each attitude to the next, in the camera's axes."""
        self._pending: deque[tuple[float, float, Array, Array]] = deque()
        self._pairs: deque[tuple[Array, Array]] = deque(maxlen=_PAIRS)
        self._last_s = -np.inf
        self._since = 0

    def forget(self) -> None:
        """Look anew: the clocks, or the camera's delay, are others now."""
        self._count = self._since = 0
        self._pending.clear()
        self._pairs.clear()

    def step(self, views: Views, plane: Plane | None = None) -> float | None:
        """Take the newest frame, with its plane where known; how late its stamp is beyond the offset that is set, s,
        once it is sure."""
        newest = views.newest
        if newest.ned_from_camera is None:
            self._count = 0
            self._pending.clear()
            return None
        # attitudes are those of the stamps less the lateness that was allowed for
        if not self._remember(newest.time_s - newest.late_s, newest.ned_from_camera):
            return None
        if views.longest >= 1 and newest.time_s - self._last_s >= 0.9 * _EVERY_S:
            self._see(views, plane)
        return self._look() if self._compared() else None

    def _remember(self, time_s: float, attitude: Array) -> bool:
        """Keep an attitude; False if it does not come after the last one."""
        n = self._count
        if n and time_s <= self._time_s[n - 1]:
            return False
        if n == len(self._time_s):
            # half of them go, unless pairs would still need them
            n = n // 2
            if self._time_s[-1] - self._time_s[n] > 2 * (LATEST_S - EARLIEST_S + _SPAN_S):
                for store in (self._time_s, self._attitude, self._turned):
                    store[:n] = store[-n:].copy()
            else:
                n = len(self._time_s)
                self._time_s = np.resize(self._time_s, 2 * n)
                self._attitude = np.resize(self._attitude, (2 * n, 3, 3))
                self._turned = np.resize(self._turned, (2 * n, 3))
        self._time_s[n], self._attitude[n] = time_s, attitude
        if n:
            self._turned[n - 1] = log_so3(self._attitude[n - 1].T @ attitude)
        self._count = n + 1
        return True

    def _see(self, views: Views, plane: Plane | None) -> None:
        """The rotation over the last span, from the tracks."""
        newest = views.newest
        found = picture_rotation(views, _SPAN_S, plane)
        if found is None:
            return
        gap, fit = found
        self._last_s = newest.time_s
        covariance = fit.covariance[5:, 5:] + np.eye(3) * _NOISE_RAD**2
        whitener: Array = np.linalg.cholesky(np.linalg.inv(covariance)).T.astype(np.float64)
        seen = whitener @ log_so3(fit.old_from_new)
        self._pending.append((views.view(gap).time_s, newest.time_s, seen, whitener))

    def _compared(self) -> bool:
        """Compare the pairs that attitudes reach around; whether it is time for a look."""
        if self._count < 2:
            return False
        first_s, last_s = self._time_s[0], self._time_s[self._count - 1]
        while self._pending and self._pending[0][1] - EARLIEST_S <= last_s:
            old_s, new_s, seen, whitener = self._pending.popleft()
            if old_s - LATEST_S < first_s:
                continue
            turns = _log(np.swapaxes(self._at(old_s - SHIFTS), 1, 2) @ self._at(new_s - SHIFTS))
            self._pairs.append((seen, turns @ whitener.T))
            self._since += 1
        if self._since < _LOOK_EVERY or len(self._pairs) < _LEAST_PAIRS:
            return False
        self._since = 0
        return True

    def _at(self, times: Array) -> Array:
        """Attitudes (m, 3, 3) at ``times`` (m,), within those that are remembered."""
        known = self._time_s[: self._count]
        k = np.clip(known.searchsorted(times, side="right") - 1, 0, self._count - 2)
        share = np.clip((times - known[k]) / (known[k + 1] - known[k]), 0.0, 1.0)
        return np.asarray(self._attitude[k] @ _exp(share[:, None] * self._turned[k]), np.float64)

    def _look(self) -> float | None:
        seen = np.array([pair[0] for pair in self._pairs])
        turned = np.array([pair[1] for pair in self._pairs])
        error2 = np.square(seen[:, None] - turned).sum(axis=2)
        # an own scale, and little weight of a pair that went wrong (Cauchy)
        scale = max(float(np.median(error2[:, error2.sum(axis=0).argmin()])), 1.0)
        cost = np.log1p(error2 / scale).sum(axis=0)
        best = int(cost.argmin())
        others = cost[np.abs(SHIFTS - SHIFTS[best]) > _APART_S]
        sure = float(others.min()) - float(cost[best]) >= _SURE
        if not sure or _correlation(seen, turned[:, best]) < _CORRELATION:
            return None
        if best in (0, len(SHIFTS) - 1):
            return float(SHIFTS[best])
        left, middle, right = cost[best - 1 : best + 2]
        bend = left - 2 * middle + right
        between = float(0.5 * (left - right) / bend) if bend > 0 else 0.0
        return float(SHIFTS[best]) + between * _STEP_S


def _correlation(seen: Array, measured: Array) -> float:
    a, b = seen - np.median(seen, axis=0), measured - np.median(measured, axis=0)
    square = float((a * a).sum() * (b * b).sum())
    return float((a * b).sum()) / square**0.5 if square > 0 else 0.0


def _exp(vectors: Array) -> Array:
    """Rotations (n, 3, 3) of small rotation vectors (n, 3), to third order."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    k = np.array(((zero, -z, y), (z, zero, -x), (-y, x, zero))).transpose(2, 0, 1)
    square = k @ k
    return np.eye(3) + k + square / 2 + k @ square / 6


def _log(rotations: Array) -> Array:
    """Rotation vectors (n, 3) of rotations (n, 3, 3) well below half a turn."""
    r = rotations
    axis = np.stack((r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]), axis=1) / 2
    sine = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(sine, (np.trace(r, axis1=1, axis2=2) - 1) / 2)
    out: Array = axis * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 1.0)[:, None]
    return out
