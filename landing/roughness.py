"""Roughness: RMS relief of the surface over its distance, from the parallax that the plane leaves.

A point that stands e (relative, towards the camera) over the plane is displaced by e times the derivative g of its
projection along the translation; dividing the residual by g makes the measure independent of height, speed and
time to contact. The component across g holds no relief: it measures the tracker's noise and unmasks gross errors.
The noise is taken out by multiplying two measurements of the same point from baselines without a common frame:
what is relief is in both, what is noise is not.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from landing.camera import CameraModel
from landing.motion import OverPlane
from landing.options import EstimatorOptions
from landing.plane import Plane
from landing.relief_memory import Cells, ReliefMemory
from landing.tracking import FeatureTracker
from landing.views import Views

Array = NDArray[np.float64]

_SHARE = 3, 4
"""Share of the plane's baseline that heights are measured over: longer is less noise, shorter more tracks."""


@dataclass(frozen=True, slots=True)
class Relief:
    """``height`` (n,) over the plane over the distance along the axis of the tracks ``slots``, ``std`` (n,) of it.

    ``roughness`` is the RMS with the noise taken out, ``roughness_std`` one sigma of it, NaN where the motion
    does not tell; ``gross`` counts the tracks refused as tracking errors, ``standing`` those that surely stand
    out from the plane.
    """

    slots: NDArray[np.intp]
    height: Array
    std: Array
    roughness: float
    roughness_std: float
    gross: int
    standing: int


@dataclass(frozen=True, slots=True)
class _Measured:
    """``height``, ``std`` and gross errors ``wrong`` (capacity,) over the plane ``normal`` (3,), as of one frame."""

    frame: int
    height: Array
    std: Array
    wrong: NDArray[np.bool_]
    normal: Array


class ReliefMap:
    """Heights of the tracked points over the plane, and the roughness of the whole view.

    The cells of the view count alike. What stood out and is no longer tracked, near the border or behind a step, still
    counts: ``memory`` carries it along.
    """

    def __init__(
        self, options: EstimatorOptions, camera: CameraModel, capacity: int, border_px: float
    ) -> None:
        self.options = options
        self._cells = Cells(camera, options.relief_cells)
        self.memory = ReliefMemory(options, camera, self._cells, border_px)
        self._streak = np.zeros(capacity, np.int64)
        self._born = np.full(capacity, -1, np.int64)
        self._measured: list[_Measured | None] = [None] * FeatureTracker.HISTORY

    def step(self, views: Views, plane: Plane) -> Relief | None:
        """Relief at the newest frame over ``plane``; None when there is no baseline to see it by."""
        tracker, o = views.tracker, self.options
        if plane.status != "ok" or plane.gap < 1:
            return None
        height, std, older, older_std, gross = self._measure(views, plane)
        slots = np.flatnonzero(np.isfinite(height))
        h, s, h2, s2 = height[slots], std[slots], older[slots], older_std[slots]
        standing = self._standing(tracker, slots, h, s)
        unknown = Relief(slots, h, s, math.nan, math.nan, gross, standing)
        if len(slots) < o.min_roughness_tracks:
            return unknown
        twice = np.isfinite(h2)
        product = np.where(twice, h * h2, h**2 - s**2)
        variance = np.where(twice, s * s2, s**2)
        cell = self._cells.of(tracker.pixels[slots])
        self._remember(views, slots, h, s, h2, s2, cell)
        # where something is measured now, that counts
        lost, lost_height = self.memory.unseen(self._cells.marked(cell))
        cell = np.concatenate((cell, lost))
        product = np.concatenate((product, lost_height**2))
        variance = np.concatenate((variance, np.full(len(lost), float(variance.min()))))
        share = 1.0 / np.bincount(cell)[cell]
        # tracks good enough to tell what matters count alike, the others by their uncertainty
        weight = share / (variance + o.relief_scale**2) ** 2
        total = float(weight.sum())
        mean_square = max(float((weight * product).sum()) / total, 0.0)
        spread = math.sqrt(2 * float((weight**2 * (variance + mean_square) ** 2).sum())) / total
        rough = math.sqrt(mean_square)
        rough_std = math.sqrt(mean_square + spread) - rough
        if rough_std > o.max_roughness_std:
            return unknown
        return Relief(slots, h, s, rough, rough_std, gross, standing)

    def _measure(self, views: Views, plane: Plane) -> tuple[Array, Array, Array, Array, int]:
        """Heights and standard deviations of all slots (capacity,), newest and older, and the gross errors.

        The newest go back three quarters of the plane's baseline, or for younger tracks as far as they reach; the older
        are the newest of as many frames ago, so that the two have at most the middle frame in common.
        """
        tracker, o = views.tracker, self.options
        weight = plane.weights(len(tracker.alive))
        height, std = np.full((2, len(weight)), math.nan)
        wrong = np.zeros(len(weight), bool)
        reach = max(1, _SHARE[0] * plane.gap // _SHARE[1])
        gaps = self._gaps(views, reach)
        slots = np.flatnonzero(tracker.alive & (tracker.born <= tracker.frame - gaps[-1]))
        index = np.searchsorted(-gaps, -(tracker.frame - tracker.born[slots]))
        # the displacements over all the gaps come from the tracks that reach back over all of them
        tracks, derotated = views.stack(gaps, slots)
        oldest, index = index == 0, np.minimum(index, len(gaps) - 1)
        own = derotated[index, np.arange(len(index))]
        over = OverPlane(tracks.new, derotated, plane.normal, tracks.whitener, turned=own)
        rotation_std = np.hypot(
            (o.rotation_std_rad, o.rotation_std_rad, o.yaw_std_rad), views.baseline_std(reach)
        )
        found = over.displacement(weight.take(slots), rotation_std, oldest)
        if found is not None:
            along, left = over.against(found[0], index)
            height[slots], std[slots], wrong[slots] = heights(along, left, plane.normal, o)
        older, older_std, older_wrong = self._recall(views, plane, weight, reach)
        self._measured[tracker.frame % len(self._measured)] = _Measured(
            tracker.frame, height, std, wrong, plane.normal
        )
        return np.where(wrong | older_wrong, math.nan, height), std, older, older_std, int(wrong.sum())

    def _recall(
        self, views: Views, plane: Plane, weight: Array, reach: int
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """What all slots showed ``reach`` frames ago, heights over the plane of now: they, their std, gross errors."""
        tracker = views.tracker
        height, std = np.full((2, len(weight)), math.nan)
        frame = tracker.frame - reach
        then = self._measured[frame % len(self._measured)]
        if then is None or then.frame != frame:
            return height, std, np.zeros(len(weight), bool)
        same = tracker.alive & (tracker.born < frame)
        wrong = then.wrong & same
        slots = np.flatnonzero(same & np.isfinite(then.height) & ~wrong)
        point = tracker.history[frame % tracker.HISTORY, slots]
        now = turned(plane.normal, views.rotation(reach))
        # the inverse depth is (1 + e) n . p whichever the plane, but for the scale: what fits the plane has none
        old, new = (n[2] + point @ n[:2] for n in (then.normal, now))
        inverse = (1 + then.height[slots] * np.linalg.norm(then.normal)) * old / new
        fits = weight[slots]
        total = float(fits @ inverse)
        if total > 0:
            height[slots] = (inverse * (float(fits.sum()) / total) - 1) / np.linalg.norm(now)
            std[slots] = then.std[slots]
        return height, std, wrong

    def _gaps(self, views: Views, reach: int) -> NDArray[np.intp]:
        """The longest gap, then the ages of the larger groups of younger tracks, falling."""
        tracker, o = views.tracker, self.options
        ages = np.bincount(
            np.minimum(tracker.frame - tracker.born[tracker.alive], reach), minlength=reach + 1
        )
        younger = 1 + np.flatnonzero(ages[1:reach] >= o.relief_group_tracks)[::-1]
        return np.concatenate(((reach,), younger[: o.relief_groups])).astype(np.intp)

    def _standing(self, tracker: FeatureTracker, slots: NDArray[np.intp], h: Array, s: Array) -> int:
        """How many tracks have stood out for some frames on end; what does not last is a tracking error.

        Nor does a height that falls: an error of a young track's place counts less the further it has gone.
        """
        o, born = self.options, tracker.born
        stands = np.zeros(len(born), bool)
        stands[slots] = np.abs(h) > np.maximum(o.standing_height, o.standing_sigmas * s)
        before = self._measured[(tracker.frame - 1) % len(self._measured)]
        if before is not None and before.frame == tracker.frame - 1:
            stands[slots] &= ~(np.abs(h) < o.standing_kept * np.abs(before.height[slots]))
        self._streak = np.where(stands & (born == self._born), self._streak + 1, stands.astype(np.int64))
        self._born = born.copy()
        return int((self._streak >= o.standing_frames).sum())

    def _remember(
        self,
        views: Views,
        slots: NDArray[np.intp],
        h: Array,
        s: Array,
        h2: Array,
        s2: Array,
        cell: NDArray[np.int64],
    ) -> None:
        """Add the points that stand out twice, forget those where the ground is now measured as even."""
        o = self.options
        stands = (np.abs(h) > o.standing_sigmas * s) & (np.abs(h) > o.relief_scale)
        sure = stands & (np.abs(h2) > o.standing_sigmas * s2) & (np.sign(h2) == np.sign(h))
        cells, tracker = self._cells, views.tracker
        even = cells.marked(cell[~stands & (s < o.relief_scale)]) & ~cells.marked(cell[stands])
        points = tracker.history[tracker.frame % tracker.HISTORY, slots]
        self.memory.update(points, tracker.pixels[slots], h, sure, even)


def turned(normal: Array, old_from_new: Array | None) -> Array:
    """The normal (3,) in the axes of an older frame, with z = 1 again."""
    if old_from_new is None:
        return normal
    n = old_from_new @ normal
    return n / n[2]


def heights(
    along: Array, left: Array, normal: Array, options: EstimatorOptions
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Height over the plane (n,) over the distance along the axis, its standard deviation, and gross errors (n,).

    ``along`` (2, n) is each track's displacement over the plane and ``left`` (2, n) what of its way that leaves,
    whitened (``OverPlane.against``): (x' - x) = d (1 + e) (x' tz - tx) is linear in the height e as well.
    """
    gu, gv = along
    square = along * along
    information = np.maximum(square[0] + square[1], 1e-12)
    length = np.sqrt(information)
    across = np.abs(gu * left[1] - gv * left[0]) / length
    noise = max(float(np.partition(across, len(across) // 2)[len(across) // 2]) * 1.4826, options.noise_floor)
    scale = 1.0 / math.sqrt(float(np.dot(normal, normal)))
    np.multiply(along, left, out=square)
    product = square[0] + square[1]
    # where a patch lies on a brink or a slope it goes astray a little: still relief as long as it goes along the motion
    astray = across * length > options.gross_share * np.abs(product)
    astray &= across > options.gross_sigmas * noise
    return product / information * scale, (noise * scale) / length, astray
