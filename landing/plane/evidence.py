"""Evidence over time: the slopes of several frames are fused in the world frame while they agree.

In: slope tangents (a, b) of the surface Z = h + aX + bY in the camera frame, their covariance, and the camera's
attitude, at each frame. Out: the fused slope in the newest camera frame. The normal of a plane is constant in the
world while the vehicle rotates and moves, so older estimates are measurements of the same normal. From the newest
backwards, each estimate is tested (chi-square of the innovation) against the fusion of the newer ones. The first that
fails marks a change of the surface; it and all older ones are left out. There is no lag, since the newest estimate is
always included. A single newest estimate that disagrees with many consistent ones may be an outlier and needs a
larger difference.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


_CAPACITY = 512
"""Size of the ring of stored estimates; when it is full, the older half is dropped."""
_TINY = 1e-3
"""Step of the finite differences that rotate sensitivities."""
_MANY = 3
"""Number of consistent estimates from which a single other one may be an outlier."""


@dataclass(frozen=True, slots=True)
class EvidenceOptions:
    """``memory_s``: age up to which estimates are used, s. ``drift_std``: random walk of the slope, tangent per root
    second.

    ``agreement``: chi-square (two degrees of freedom) above which an estimate disagrees with the newer ones;
    ``agreement_alone``: the same for the newest one against all before it. ``overlap``: share of a baseline after
    which the next estimate counts as independent. ``floor_std``: error of the result that no fusion removes, tangent.
    """

    memory_s: float
    drift_std: float = math.tan(math.radians(0.2))
    agreement: float = 9.0
    agreement_alone: float = 25.0
    overlap: float = 0.5
    floor_std: float = math.tan(math.radians(0.05))


class Evidence:
    """Stores the estimates of the last ``memory_s``; ``fuse`` returns the slope in the newest camera frame.

    ``used`` is the number of estimates in the last fusion.
    """

    def __init__(self, options: EvidenceOptions) -> None:
        self.options = options
        self.used = 0
        self._first = self._end = 0
        self._frame = np.zeros(_CAPACITY, np.int64)
        self._time_s, self._share = np.zeros(_CAPACITY), np.zeros(_CAPACITY)
        self._slope, self._covariance = np.zeros((2, _CAPACITY)), np.zeros((3, _CAPACITY))
        """Slope tangents x and y in the world; their covariance xx, xy, yy."""
        self._sensitivity = np.zeros((2, _CAPACITY))
        """Derivative (2, n) of each slope by a parameter that all share: the rolling-shutter readout, s."""
        self._lens: Array = np.zeros((2, 0, _CAPACITY))
        """Change (2, k, n) of each slope with each of k independent lens errors of unit variance."""
        self.sensitivity = np.zeros(2)
        """Derivative (2,) of the slope that was fused last by the shared parameter, in the world frame."""
        self._fused: tuple[float, Array, Array] | None = None
        """Time, slope (2,) and covariance (2, 2) of the last fusion, without the error of the shared parameter."""

    def clear(self) -> None:
        """Forget all estimates: the surface is another one."""
        self._first = self._end = 0
        self._fused = None

    def add(
        self,
        frame: int,
        time_s: float,
        ned_from_camera: Array,
        a: float,
        b: float,
        covariance: Array,
        gap: int,
        sensitivity: Array | None = None,
        lens: Array | None = None,
    ) -> None:
        """Store the slope tangents (a, b) with covariance (2, 2), from a baseline of ``gap`` frames.

        ``sensitivity`` (2,): their derivative by the shared parameter. ``lens`` (2, k): their change with each of k
        lens errors of unit variance.
        """
        turned = to_world(ned_from_camera, a, b, covariance)
        if turned is None:
            return
        self._forget(time_s)
        if self._end == _CAPACITY:
            kept = slice(max(self._first, _CAPACITY // 2), _CAPACITY)
            for store in self._stores():
                store[..., : kept.stop - kept.start] = store[..., kept].copy()
            self._first, self._end = 0, kept.stop - kept.start
        end = self._end
        # neighbouring estimates share their tracks: the frames of one baseline count as one
        self._share[end] = min(1.0, 1.0 / max(1.0, gap * self.options.overlap))
        self._frame[end], self._time_s[end] = frame, time_s
        self._slope[:, end], self._covariance[:, end] = turned[0], turned[1].take((0, 1, 3))
        self._sensitivity[:, end] = 0.0
        if sensitivity is not None:
            moved = to_world(
                ned_from_camera, a + _TINY * sensitivity[0], b + _TINY * sensitivity[1], covariance
            )
            if moved is not None:
                self._sensitivity[:, end] = (moved[0] - turned[0]) / _TINY
        if lens is not None:
            if self._lens.shape[1] != lens.shape[1]:
                self._lens = np.zeros((2, lens.shape[1], _CAPACITY))
            self._lens[..., end] = _slopes_turned(ned_from_camera, a, b) @ lens
        self._end += 1

    def shift(self, change: float) -> None:
        """The estimate of the shared parameter changed by ``change``: correct all stored slopes accordingly."""
        self._slope += self._sensitivity * change
        if self._fused is not None:
            time_s, slope, covariance = self._fused
            self._fused = time_s, slope + self.sensitivity * change, covariance

    def expected(self, time_s: float, ned_from_camera: Array) -> tuple[Array, Array, Array] | None:
        """The last fusion as a prediction in these camera axes: (a, b) (2,), covariance (2, 2), sensitivity (2,).

        None when there was none within ``memory_s``.
        """
        if self._fused is None or time_s - self._fused[0] > self.options.memory_s:
            return None
        then_s, slope, covariance = self._fused
        drifted = covariance + np.eye(2) * (self.options.drift_std**2 * (time_s - then_s))
        known = from_world(ned_from_camera, slope, drifted)
        moved = from_world(ned_from_camera, slope + _TINY * self.sensitivity, drifted)
        if known is None or moved is None:
            return None
        a, b = np.array(known[:2]), np.array(moved[:2])
        return a, known[2], (b - a) / _TINY

    def _stores(self) -> tuple[NDArray[np.generic], ...]:
        return (
            self._frame,
            self._time_s,
            self._share,
            self._slope,
            self._covariance,
            self._sensitivity,
            self._lens,
        )

    @property
    def newest_frame(self) -> int | None:
        """Frame of the newest estimate remembered."""
        return int(self._frame[self._end - 1]) if self._end > self._first else None

    def fuse(
        self, time_s: float, ned_from_camera: Array, unknown_std: float = 0.0
    ) -> tuple[float, float, Array] | None:
        """(a, b, covariance (2, 2)) in the newest camera frame; None when nothing is stored.

        ``unknown_std``: standard deviation of the shared parameter. Its error is common to all estimates, so that
        fusion does not reduce it.
        """
        o = self.options
        self._forget(time_s)
        if self._end == self._first:
            return None
        # newest first
        order = slice(self._end - 1, self._first - 1 if self._first else None, -1)
        slope, share = self._slope[:, order], self._share[order]
        covariance = self._covariance[:, order].copy()
        covariance[::2] += o.drift_std**2 * (time_s - self._time_s[order])
        sensitivity = self._sensitivity[:, order]
        if unknown_std > 0:
            covariance += _outer(sensitivity) * unknown_std**2
        lens = self._lens[..., order]
        counted = _inverse(covariance)
        counted *= share
        total, summed, mean = _running(counted, slope)
        last = self._agreeing(slope, covariance, share, summed, mean)
        if last == 1 and slope.shape[1] > _MANY:
            last += self._against_a_stray(slope, covariance, share, counted)
        used = summed[:, last - 1]
        if total[0, last - 1] + total[2, last - 1] < (counted[0, 0] + counted[2, 0]) / share[0]:
            used = covariance[:, 0]
        self.used = last
        world = _matrix(used, o.floor_std)
        if unknown_std > 0:
            weighted = _product(counted[:, :last], sensitivity[:, :last]).sum(axis=1)
            self.sensitivity = _product(summed[:, last - 1], weighted)
            # as if each had an error of its own it is in the sum already
            common = 1 - 1 / max(1.0, float(share[:last].sum()))
            self._fused = time_s, mean[:, last - 1].copy(), world
            world = _matrix(used + _outer(self.sensitivity) * (common * unknown_std**2), o.floor_std)
        # errors of the lens are the same in all
        both = _product(
            summed[:, last - 1, None], _product(counted[:, None, :last], lens[..., :last]).sum(axis=2)
        )
        world = world + both @ both.T
        return from_world(ned_from_camera, mean[:, last - 1], world)

    def _agreeing(self, slope: Array, covariance: Array, share: Array, summed: Array, mean: Array) -> int:
        """How many estimates, newest first, agree each with the mean of those that are newer."""
        # a short sum knows no less than its best member
        enough = np.maximum(1.0, 1.0 / share[:-1].cumsum())
        spread = covariance[:, 1:] + summed[:, :-1] / enough
        apart = _apart(slope[:, 1:] - mean[:, :-1], spread, self.options.agreement).nonzero()[0]
        return int(apart[0]) + 1 if len(apart) else slope.shape[1]

    def _against_a_stray(self, slope: Array, covariance: Array, share: Array, counted: Array) -> int:
        """How many estimates before the newest are consistent, if it differs from them by no more than an outlier."""
        older, older_share = covariance[:, 1:], share[1:]
        _, summed, mean = _running(counted[:, 1:], slope[:, 1:])
        count = self._agreeing(slope[:, 1:], older, older_share, summed, mean)
        if count < _MANY:
            return 0
        spread = covariance[:, 0] + summed[:, count - 1] / max(1.0, 1.0 / float(older_share[:count].sum()))
        off = slope[:, 0] - mean[:, count - 1]
        return 0 if _apart(off, spread, self.options.agreement_alone) else count

    def _forget(self, time_s: float) -> None:
        while self._end > self._first and time_s - self._time_s[self._first] > self.options.memory_s:
            self._first += 1


def to_world(ned_from_camera: Array, a: float, b: float, covariance: Array) -> tuple[Array, Array] | None:
    """Slope tangents (2,) of the surface normal in the world frame and their covariance; None for a wall."""
    rows = ned_from_camera.tolist()
    x, y, z = (z - x * a - y * b for x, y, z in rows)
    if z < 0.1:
        return None
    slope = x / z, y / z
    return np.array(slope), _carried(rows, slope, z, covariance)


def _slopes_turned(ned_from_camera: Array, a: float, b: float) -> Array:
    """How slope tangents in the world change (2, 2) with (a, b) in the camera frame."""
    x, y, z = ned_from_camera @ (-a, -b, 1.0)
    moved = -ned_from_camera[:, :2]
    return np.asarray((moved[:2] - np.outer((x / z, y / z), moved[2])) / z, np.float64)


def from_world(ned_from_camera: Array, slope: Array, covariance: Array) -> tuple[float, float, Array] | None:
    """(a, b) in the camera frame and their covariance; None where the surface is edge-on."""
    rows = ned_from_camera.T.tolist()
    sx, sy = slope.tolist()
    x, y, z = (x * sx + y * sy + z for x, y, z in rows)
    if z < 0.1:
        return None
    tangent = x / z, y / z
    # (a, b) are the negative tangents: their covariance is the same
    return -tangent[0], -tangent[1], _carried(rows, tangent, z, covariance)


def _carried(rows: list[list[float]], slope: tuple[float, float], depth: float, covariance: Array) -> Array:
    """Covariance (2, 2) of a normal's slope tangents after a rotation of these ``rows``, where they are ``slope``."""
    third = rows[2]
    (ax, ay), (bx, by) = (
        [(row[k] - tangent * third[k]) / depth for k in (0, 1)]
        for row, tangent in zip(rows, slope, strict=False)
    )
    (xx, xy), (_, yy) = covariance.tolist()
    ux, uy, vx, vy = ax * xx + ay * xy, ax * xy + ay * yy, bx * xx + by * xy, bx * xy + by * yy
    across = ux * bx + uy * by
    return np.array(((ux * ax + uy * ay, across), (across, vx * bx + vy * by)))


def _running(counted: Array, slope: Array) -> tuple[Array, Array, Array]:
    """Sums (3, k) of informations, their inverses (3, k), and the means (2, k) of the slopes so far."""
    total = counted.cumsum(axis=1)
    summed = _inverse(total)
    return total, summed, _product(summed, _product(counted, slope).cumsum(axis=1))


def _apart(difference: Array, covariance: Array, limit: float) -> NDArray[np.bool_]:
    """Whether differences (2, ...) have a chi-square beyond a limit, their covariances xx, xy, yy (3, ...)."""
    (x, y), (xx, xy, yy) = difference, covariance
    # difference^T S^-1 difference, times the determinant of S
    distance = yy * (x * x) - (2 * x) * (xy * y) + xx * (y * y)
    return np.asarray(distance > limit * (xx * yy - xy * xy))


def _matrix(covariance: Array, floor_std: float) -> Array:
    """The matrix (2, 2) of xx, xy, yy, with an error of both axes added."""
    xx, xy, yy = covariance.tolist()
    return np.array(((xx + floor_std**2, xy), (xy, yy + floor_std**2)))


def _outer(v: Array) -> Array:
    """xx, xy, yy (3, ...) of the products of vectors (2, ...) with themselves."""
    return np.stack((v[0] * v[0], v[0] * v[1], v[1] * v[1]))


def _inverse(m: Array) -> Array:
    """Inverses (3, k) of symmetric matrices xx, xy, yy (3, k)."""
    out = m[::-1] / (m[0] * m[2] - m[1] * m[1])
    np.negative(out[1], out=out[1])
    return np.asarray(out)


def _product(m: Array, v: Array) -> Array:
    """Symmetric matrices (3, k) times vectors (2, k)."""
    return m[:2] * v[0] + m[1:] * v[1]


def slope_std(covariance: Array) -> float:
    """Largest standard deviation of a slope covariance (2, 2)."""
    (a, b), (_, d) = covariance.tolist()
    return math.sqrt(max(0.0, (a + d) / 2 + math.hypot((a - d) / 2, b)))
