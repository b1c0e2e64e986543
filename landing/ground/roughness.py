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

from landing.ground.relief_memory import Cells, Marks, ReliefMemory
from landing.motion.motion import OverPlane
from landing.motion.views import Views
from landing.options import EstimatorOptions
from landing.plane.plane import Plane
from landing.plane.planefit import NOISE_FLOOR
from landing.vision.camera import CameraModel
from landing.vision.tracking import FeatureTracker

Array = NDArray[np.float64]

_SHARE = 3, 4
"""Share of the plane's baseline that heights are measured over: longer is less noise, shorter more tracks."""
_LEAST_TRACKS = 20
"""Fewest tracks for a roughness."""
_GROUPS, _GROUP_TRACKS = 3, 3
"""Baselines for tracks younger than the plane's, and the fewest tracks that get one of their own."""
_GROSS_SIGMAS, _GROSS_SHARE = 4.0, 0.3
"""Residual across the motion that shows an error, and its share of that along the motion below which it is relief."""


@dataclass(frozen=True, slots=True)
class Relief:
    """``height`` (n,) over the plane over the distance along the axis of the tracks ``slots``, ``std`` (n,) of it.

    ``roughness`` is the RMS with the noise taken out, ``roughness_std`` one sigma of it, NaN where the motion
    does not determine it; ``gross`` counts the tracks refused as tracking errors, ``obstacle_points`` those with
    significant height over the plane.
    """

    slots: NDArray[np.intp]
    height: Array
    std: Array
    roughness: float
    roughness_std: float
    gross: int
    obstacle_points: int


@dataclass(frozen=True, slots=True)
class _Measured:
    """``height``, ``std`` (capacity,) over the plane ``normal`` (3,), the slots ``wrong`` (k,), as of one frame."""

    frame: int
    height: Array
    std: Array
    wrong: NDArray[np.intp]
    normal: Array


class ReliefMap:
    """Heights of the tracked points over the plane, and the roughness of the whole view.

    The cells of the view count alike. An obstacle point that is no longer tracked, near the border or
    behind a step, still counts: ``memory`` carries it along.
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
        slots, h, s, h2, s2, gross = self._measure(views, plane)
        significant = np.abs(h) > o.standing_sigmas * s
        obstacle_points = self._obstacle_points(tracker, slots, h, significant)
        unknown = Relief(slots, h, s, math.nan, math.nan, gross, obstacle_points)
        if len(slots) < _LEAST_TRACKS:
            return unknown
        twice = np.isfinite(h2)
        variance = s * s
        product = np.where(twice, h * h2, h * h - variance)
        variance = np.where(twice, s * s2, variance)
        pixels = tracker.pixels.take(slots, 0)
        cell = self._cells.of(pixels)
        significant &= np.abs(h) > o.relief_scale
        self._remember(views, slots, pixels, h, s, h2, s2, significant, cell)
        # where something is measured now, that counts
        lost, lost_height = self.memory.unseen(self._cells.marked(cell))
        if len(lost):
            cell = np.concatenate((cell, lost))
            product = np.concatenate((product, lost_height**2))
            variance = np.concatenate((variance, np.full(len(lost), float(variance.min()))))
        # tracks that are accurate enough count alike, the others by their uncertainty
        weight = 1.0 / (np.bincount(cell).take(cell) * (variance + o.relief_scale**2) ** 2)
        total = float(weight.sum())
        mean_square = max(float(weight @ product) / total, 0.0)
        variance += mean_square
        variance *= weight
        spread = math.sqrt(2 * float(variance @ variance)) / total
        rough = math.sqrt(mean_square)
        rough_std = math.sqrt(mean_square + spread) - rough
        if rough_std > o.max_roughness_std:
            return unknown
        return Relief(slots, h, s, rough, rough_std, gross, obstacle_points)

    def _measure(
        self, views: Views, plane: Plane
    ) -> tuple[NDArray[np.intp], Array, Array, Array, Array, int]:
        """Slots (n,), their heights and standard deviations, newest and older, and the number of gross errors.

        The newest go back three quarters of the plane's baseline, or for younger tracks as far as they reach; the older
        are the newest of as many frames ago, so that the two have at most the middle frame in common.
        """
        tracker, o = views.tracker, self.options
        weight, normal = plane.weights(len(tracker.alive)), plane.normal
        reach = max(1, _SHARE[0] * plane.gap // _SHARE[1])
        gaps, slots, index = self._gaps(views, reach)
        oldest, index = index == 0, np.minimum(index, len(gaps) - 1)
        # the displacements over all the gaps come from the tracks that reach back over all of them
        tracks, derotated = views.stack(gaps, slots)
        over = OverPlane(tracks.new, derotated, normal, tracks.whitener, turns=True)
        rotation_std = np.array((o.rotation_std_rad, o.rotation_std_rad, o.yaw_std_rad))
        rotation_std = np.hypot(rotation_std, views.baseline_std(reach))
        found = over.displacement(weight.take(slots), rotation_std, oldest)
        place = tracker.frame % len(self._measured)
        if found is None:
            self._measured[place] = None
            nothing = np.empty(0)
            return slots[:0], nothing, nothing, nothing, nothing, 0
        h, s, wrong = heights(*over.against(found[0], index), normal)
        older, older_std, older_wrong = self._recall(views, normal, weight, reach, slots)
        height, std = np.full((2, len(weight)), math.nan)
        height[slots], std[slots] = h, s
        self._measured[place] = _Measured(tracker.frame, height, std, slots[wrong], normal)
        good = (~(wrong | older_wrong)).nonzero()[0]
        gross = int(np.count_nonzero(wrong))
        return slots.take(good), h.take(good), s.take(good), older.take(good), older_std.take(good), gross

    def _recall(
        self, views: Views, normal: Array, weight: Array, reach: int, slots: NDArray[np.intp]
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """What ``slots`` showed ``reach`` frames ago, heights over this ``normal``: they, their std, gross errors."""
        tracker = views.tracker
        height, std = np.full((2, len(slots)), math.nan)
        wrong = np.zeros(len(weight), bool)
        frame = tracker.frame - reach
        then = self._measured[frame % len(self._measured)]
        if then is None or then.frame != frame:
            return height, std, wrong.take(slots)
        wrong[then.wrong] = True
        same = tracker.born.take(slots) < frame
        gross = wrong.take(slots)
        gross &= same
        before = then.height.take(slots)
        known = (same & np.isfinite(before) & ~gross).nonzero()[0]
        seen = slots.take(known)
        point = views.rows.places(frame).take(seen, 0)
        now = turned(normal, views.rotation(reach))
        # the inverse depth is (1 + e) n . p whichever the plane, but for the scale: what fits the plane has none
        old, new = (n[2] + np.dot(point, n[:2]) for n in (then.normal, now))
        inverse = (1 + before.take(known) * math.sqrt(float(then.normal @ then.normal))) * old / new
        fits = weight.take(seen)
        total = float(fits @ inverse)
        if total > 0:
            inverse *= float(fits.sum()) / total
            inverse -= 1
            height[known] = inverse / math.sqrt(float(now @ now))
            std[known] = then.std.take(seen)
        return height, std, gross

    def _gaps(self, views: Views, reach: int) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
        """The longest gap, then the ages of the larger groups of younger tracks, falling.

        With them the slots (n,) that reach back over the shortest, and the number (n,) of the first gap each reaches.
        """
        tracker = views.tracker
        slots = tracker.alive.nonzero()[0]
        age = np.minimum(tracker.frame - tracker.born.take(slots), reach)
        count = np.bincount(age, minlength=reach + 1)
        younger = 1 + (count[1:reach] >= _GROUP_TRACKS).nonzero()[0][::-1]
        gaps = np.concatenate(((reach,), younger[:_GROUPS])).astype(np.intp)
        old = age >= gaps[-1]
        return gaps, slots.compress(old), np.searchsorted(-gaps, -age.compress(old))

    def _obstacle_points(
        self, tracker: FeatureTracker, slots: NDArray[np.intp], h: Array, significant: Marks
    ) -> int:
        """How many tracks were obstacle points for some frames on end; what does not last is a tracking error.

        Nor does a height that falls: an error of a young track's place counts less the further it has gone.
        """
        o, born = self.options, tracker.born
        significant = significant & (np.abs(h) > o.standing_height)
        streak = np.zeros(len(born), np.int64)
        if significant.any():
            before = self._measured[(tracker.frame - 1) % len(self._measured)]
            if before is not None and before.frame == tracker.frame - 1:
                significant &= ~(np.abs(h) < o.standing_kept * np.abs(before.height.take(slots)))
            obstacle_points = slots.compress(significant)
            same = born.take(obstacle_points) == self._born.take(obstacle_points)
            streak[obstacle_points] = np.where(same, self._streak.take(obstacle_points) + 1, 1)
        self._streak, self._born = streak, born.copy()
        return int(np.count_nonzero(streak >= o.standing_frames))

    def _remember(
        self,
        views: Views,
        slots: NDArray[np.intp],
        pixels: NDArray[np.floating],
        h: Array,
        s: Array,
        h2: Array,
        s2: Array,
        significant: Marks,
        cell: NDArray[np.int64],
    ) -> None:
        """Add the points with two significant heights, forget those where the ground is now measured as even."""
        o, tracker = self.options, views.tracker
        even = self._cells.marked(cell.compress((s < o.relief_scale) & ~significant))
        sure = significant.nonzero()[0]
        if len(sure):
            even &= ~self._cells.marked(cell.take(sure))
            twice = (np.abs(h2) > o.standing_sigmas * s2) & (np.sign(h2) == np.sign(h))
            sure = sure.compress(twice.take(sure))
        points = tracker.history[tracker.frame % tracker.HISTORY].take(slots.take(sure), 0)
        self.memory.update(points, pixels.take(sure, 0), h.take(sure), cell.take(sure), even)


def turned(normal: Array, old_from_new: Array | None) -> Array:
    """The normal (3,) in the axes of an older frame, with z = 1 again."""
    if old_from_new is None:
        return normal
    n = old_from_new @ normal
    return n / n[2]


def heights(along: Array, left: Array, normal: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Height over the plane (n,) over the distance along the axis, its standard deviation, and gross errors (n,).

    ``along`` (2, n) is each track's displacement over the plane and ``left`` (2, n) what of its way that leaves,
    whitened (``OverPlane.against``): (x' - x) = d (1 + e) (x' tz - tx) is linear in the height e as well.
    """
    gu, gv = along
    square = along * along
    information = np.maximum(square[0] + square[1], 1e-12)
    length = np.sqrt(information)
    across = np.abs(gu * left[1] - gv * left[0]) / length
    noise = max(float(np.partition(across, len(across) // 2)[len(across) // 2]) * 1.4826, NOISE_FLOOR)
    scale = 1.0 / math.sqrt(float(np.dot(normal, normal)))
    np.multiply(along, left, out=square)
    product = square[0] + square[1]
    # where a patch lies on a step edge or a slope it is off a little: still relief as long as it goes along the motion
    astray = across * length > _GROSS_SHARE * np.abs(product)
    astray &= across > _GROSS_SIGMAS * noise
    return product / information * scale, (noise * scale) / length, astray
