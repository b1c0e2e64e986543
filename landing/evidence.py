"""Evidence over time: estimates of one surface fused in the world frame, until they disagree.

The normal of a plane is constant in the world while the vehicle turns and moves, so older estimates still speak of
it. Going back from the newest, estimates are fused as long as each agrees with what is newer (a test on the
innovations); the first disagreement is where the surface changed, and all that is older is left out. Nothing
lags: the newest estimate is always part of the result.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


_CAPACITY = 512
"""Estimates remembered at most; half of them when the store is full."""


@dataclass(frozen=True, slots=True)
class EvidenceOptions:
    """``memory_s`` how far back, ``drift_std`` slope tangent per root second, ``agreement`` chi-square of two
    degrees at which two estimates disagree, ``overlap`` the share of a baseline after which the next estimate
    counts as new."""

    memory_s: float
    drift_std: float
    agreement: float
    overlap: float
    floor_std: float


class Evidence:
    """Remembers the estimates of the last seconds; ``fuse`` returns the slope in the newest camera frame."""

    def __init__(self, options: EvidenceOptions) -> None:
        self.options = options
        self.used = 0
        self._first = self._end = 0
        self._frame = np.zeros(_CAPACITY, np.int64)
        self._time_s, self._share = np.zeros(_CAPACITY), np.zeros(_CAPACITY)
        self._slope, self._covariance = np.zeros((_CAPACITY, 2)), np.zeros((_CAPACITY, 2, 2))

    def clear(self) -> None:
        """Forget: the surface is another one."""
        self._first = self._end = 0

    def add(
        self,
        frame: int,
        time_s: float,
        ned_from_camera: Array,
        a: float,
        b: float,
        covariance: Array,
        gap: int,
    ) -> None:
        """Remember the slope tangents (a, b) with covariance (2, 2), from a baseline of ``gap`` frames."""
        turned = to_world(ned_from_camera, a, b, covariance)
        if turned is None:
            return
        self._forget(time_s)
        if self._end == _CAPACITY:
            kept = slice(max(self._first, _CAPACITY // 2), _CAPACITY)
            for store in (self._frame, self._time_s, self._share, self._slope, self._covariance):
                store[: kept.stop - kept.start] = store[kept].copy()
            self._first, self._end = 0, kept.stop - kept.start
        end = self._end
        # neighbouring estimates share their tracks: a baseline's worth of frames counts as one
        self._share[end] = min(1.0, 1.0 / max(1.0, gap * self.options.overlap))
        self._frame[end], self._time_s[end] = frame, time_s
        self._slope[end], self._covariance[end] = turned
        self._end += 1

    @property
    def newest_frame(self) -> int | None:
        """Frame of the newest estimate remembered."""
        return int(self._frame[self._end - 1]) if self._end > self._first else None

    def fuse(self, time_s: float, ned_from_camera: Array) -> tuple[float, float, Array] | None:
        """(a, b, covariance (2, 2)) in the newest camera frame, None without anything remembered."""
        o = self.options
        self._forget(time_s)
        if self._end == self._first:
            return None
        # newest first
        order = slice(self._end - 1, self._first - 1 if self._first else None, -1)
        slope, share = self._slope[order], self._share[order]
        drift = o.drift_std**2 * (time_s - self._time_s[order])
        covariance = self._covariance[order].copy()
        covariance[:, 0, 0] += drift
        covariance[:, 1, 1] += drift
        information = _inverse(covariance)
        counted = information * share[:, None, None]
        total = counted.cumsum(axis=0)
        weighted = (counted @ slope[..., None])[..., 0].cumsum(axis=0)
        mean = (_inverse(total) @ weighted[..., None])[..., 0]
        last = len(slope)
        if last > 1:
            difference = slope[1:] - mean[:-1]
            # a short sum knows no less than its best member
            enough = np.maximum(1.0, 1.0 / share[:-1].cumsum())
            test = _inverse(covariance[1:] + _inverse(enough[:, None, None] * total[:-1]))
            distance = (difference[:, None, :] @ test @ difference[..., None])[:, 0, 0]
            disagree = np.flatnonzero(distance > o.agreement)
            if len(disagree):
                last = int(disagree[0]) + 1
        used = total[last - 1]
        if used[0, 0] + used[1, 1] < information[0, 0, 0] + information[0, 1, 1]:
            used = information[0]
        self.used = last
        world = _inverse(used[None])[0]
        world[0, 0] += o.floor_std**2
        world[1, 1] += o.floor_std**2
        return from_world(ned_from_camera, mean[last - 1], world)

    def _forget(self, time_s: float) -> None:
        while self._end > self._first and time_s - self._time_s[self._first] > self.options.memory_s:
            self._first += 1


def to_world(ned_from_camera: Array, a: float, b: float, covariance: Array) -> tuple[Array, Array] | None:
    """Slope tangents of the normal in the world (2,) and their covariance; None for a wall."""
    n = ned_from_camera @ np.array((-a, -b, 1.0))
    if n[2] < 0.1:
        return None
    slope = n[:2] / n[2]
    jacobian = (-ned_from_camera[:2, :2] + np.outer(slope, ned_from_camera[2, :2])) / n[2]
    return slope, jacobian @ covariance @ jacobian.T


def from_world(ned_from_camera: Array, slope: Array, covariance: Array) -> tuple[float, float, Array] | None:
    """(a, b) in the camera frame and their covariance; None where the surface is edge-on."""
    n = ned_from_camera.T @ np.array((slope[0], slope[1], 1.0))
    if n[2] < 0.1:
        return None
    tangent = n[:2] / n[2]
    camera_from_ned = ned_from_camera.T
    jacobian = -(camera_from_ned[:2, :2] - np.outer(tangent, camera_from_ned[2, :2])) / n[2]
    return -float(tangent[0]), -float(tangent[1]), jacobian @ covariance @ jacobian.T


def _inverse(m: Array) -> Array:
    """Inverses of symmetric matrices (k, 2, 2)."""
    a, b, d = m[:, 0, 0], m[:, 0, 1], m[:, 1, 1]
    determinant = a * d - b * b
    out = np.empty_like(m)
    out[:, 0, 0], out[:, 1, 1] = d / determinant, a / determinant
    out[:, 0, 1] = out[:, 1, 0] = -b / determinant
    return out


def slope_std(covariance: Array) -> float:
    """Largest standard deviation of a slope covariance (2, 2)."""
    a, b, d = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    return math.sqrt(max(0.0, (a + d) / 2 + math.hypot((a - d) / 2, b)))
