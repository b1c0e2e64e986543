"""Relief at the sides of the view where ground has just come in and no track has a history yet.

Strips along these sides are compared, picture with picture, with what the plane and the motion make of the view a few
frames ago. What stands above the plane is displaced further along its parallax; the share by which, found by least
squares over a block of pixels, is its height over the distance. A strip a little further in, which the tracks have
measured, is the reference: their common part is an error of the plane or of the motion. Two gaps are looked at: the
shorter one shows what has come in last, the longer one shows it twice as well once it is a little further in.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from landing.motion.motion import OverPlane
from landing.motion.views import Views
from landing.options import EstimatorOptions
from landing.plane.plane import Plane
from landing.vision.camera import CameraModel
from landing.vision.homography import Warp, apply, towards

Array = NDArray[np.float64]

_LENGTH, _DEPTH = 20, 5
"""A block of pixels: along the side and across it."""
_CLEAR = 1
"""Pixels between what has just come in and the strip: the interpolation's reach."""
_REFERENCE = slice(8, 18)
"""The strip further in, pixels from the beginning of the outer one."""
_RUNS = (3, 5)
"""Lengths of runs of blocks that are tested together, in addition to the whole side."""
_LEAST_PX = 1.0
"""Motion below which nothing comes in."""
SIDES = ((1, False), (1, True), (0, False), (0, True))
"""The axis across a side (0: x, 1: y), and whether it is the far side."""
_LEARNT = 0.05
"""Share of a strip in what is known of the scatter of blocks."""
_MEDIAN_TO_STD = 1.4826
_NO_SECOND_MAP = np.empty((0, 0), np.float32)


@dataclass(frozen=True, slots=True)
class BorderStep:
    """Blocks at a side: their middles (k, 2) px, height over the distance, share of the view's mean square height.

    ``sure``: by ``border_sigmas``, not only by ``border_side_sigmas``. ``lasting``: the same side had relief for
    sure in the frame before as well.
    """

    side: int
    pixels: Array
    height: float
    mean_square: float
    sure: bool
    lasting: bool = False


_LEAST_SHOWN = 0.3
"""Share of a strip further in that must show ground to compare the outer one with."""


@dataclass(frozen=True, slots=True)
class _Before:
    """What plane and motion say of where the newest frame's points were ``gap`` frames ago.

    ``on_plane`` and ``far_away`` (3, 3) are homographies old_from_new of normalised points.
    """

    gap: int
    on_plane: Array
    far_away: Array


@dataclass(frozen=True, slots=True)
class _Place:
    """A strip to look at: ``begin`` pixels away from a side, against the frame ``before``.

    ``parallax`` (2, k, 2) px per unit height, in the middles of its blocks and of those of the strip further in.
    """

    side: int
    begin: int
    before: _Before
    parallax: NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class _Strips:
    """Blocks (k,) of the strips (s,) along a side: height (s, k) over the distance, its information (s, k)."""

    places: list[_Place]
    height: Array
    information: Array


class _Side:
    """Geometry of one side of the view: its blocks, and the rays of their middles at every distance from it."""

    def __init__(self, camera: CameraModel, axis: int, far: bool) -> None:
        self.axis, self.far = axis, far
        size = (camera.width, camera.height)
        self.across_px, along_px = size[axis], size[1 - axis]
        self.blocks = (along_px - 2) // _LENGTH
        start = (along_px - self.blocks * _LENGTH) // 2
        self.along = slice(start, start + self.blocks * _LENGTH)
        deep = np.arange(self.across_px // 2)
        self.middles = np.empty((len(deep), self.blocks, 2))
        self.middles[..., axis] = (self.across_px - 1 - deep if far else deep)[:, None]
        self.middles[..., 1 - axis] = start + _LENGTH * np.arange(self.blocks) + (_LENGTH - 1) / 2
        self.rays = camera.undistort(self.middles.reshape(-1, 2)).reshape(self.middles.shape)
        middle = (np.array(size) - 1) / 2
        middle[axis] = self.across_px - 1 if far else 0
        self.middle, self.middle_ray = middle, camera.undistort(middle[None])

    def window(self, begin: int, depth: int) -> tuple[slice, slice]:
        """Rows and columns of the ``depth`` lines from ``begin`` pixels away from the side on."""
        first = self.across_px - begin - depth if self.far else begin
        across = slice(first, first + depth)
        return (across, self.along) if self.axis == 1 else (self.along, across)

    def lines(self, picture: NDArray[Any]) -> NDArray[Any]:
        """A window's pixels as lines along the side, the outermost first, in blocks: (depth, blocks, length)."""
        turned = picture if self.axis == 1 else picture.T
        return (turned[::-1] if self.far else turned).reshape(-1, self.blocks, _LENGTH)


class Border:
    """Looks at the sides of each frame for ground that does not fit the plane."""

    def __init__(self, options: EstimatorOptions, camera: CameraModel, kept_px: float) -> None:
        self.options, self.camera = options, camera
        self.kept_px = kept_px
        """Motion over which a doubt lasts: until the ground that raised it is far enough in to be measured."""
        self.moved_px = math.inf
        """Motion at the last step since the frame before, infinite where that was not looked at."""
        self._warp = Warp(camera)
        self.barred = camera.barred(1)
        self._sides = [_Side(camera, axis, far) for axis, far in SIDES]
        self._middles = np.array([side.middle for side in self._sides])
        self._middle_rays = np.concatenate([side.middle_ray for side in self._sides])
        self._frame = -2
        self._came_px = self._since_px = math.inf
        self._last: set[int] = set()
        self._scatter = 1.0
        self.incoming: set[int] = set()
        """The sides where ground came in at the last step."""
        self.suspect: BorderStep | None = None
        """A possible step edge at the border: a whole side, with less certainty, or one found shortly before."""

    def step(self, views: Views, plane: Plane) -> BorderStep | None:
        """The most significant step edge at the sides of the newest frame; None where there is none.

        After a look that found nothing the next is due when some ground has come in (``border_step_px``).
        """
        o, follows = self.options, self._frame == views.tracker.frame - 1
        self._frame = views.tracker.frame
        self.moved_px = self._moved_px(views, plane) if follows else math.inf
        if follows:
            self._came_px += self.moved_px
            self._since_px += self.moved_px
            if self._since_px > self.kept_px:
                self.suspect = None
            if self.suspect is None and self._came_px < o.border_step_px:
                return None
        self._came_px = 0.0
        places = self._places(self._before(views, plane, self._gaps(views, plane)))
        self.incoming = {place.side for place in places}
        found: list[BorderStep] = []
        for number in self.incoming:
            strips = self._strips(views, [place for place in places if place.side == number])
            found += self._steps(strips)
            self._learn(strips)
        sure = [step for step in found if step.sure]
        last, self._last = self._last if follows else set(), {step.side for step in sure}
        if sure:
            self._since_px = 0.0
            most = self.suspect = _largest(sure)
            return replace(most, lasting=most.side in last)
        if found:
            self.suspect = _largest(found if self.suspect is None else [*found, self.suspect])
        return None

    def _moved_px(self, views: Views, plane: Plane) -> float:
        """About how far the view has moved over the ground since the frame before, by displacement and by turning."""
        flow = math.hypot(plane.omega[0], plane.omega[1]) * (views.newest.time_s - views.view(1).time_s)
        rotation = views.rotation(1)
        turn = math.inf if rotation is None else math.hypot(rotation[0, 2], rotation[1, 2])
        return self.camera.focal_px * (flow + turn)

    def _gaps(self, views: Views, plane: Plane) -> list[int]:
        """The shortest gap with enough motion and twice that, as far as there are pictures."""
        longest = min(views.longest, len(views.tracker.images) - 1)
        flow_px = math.hypot(plane.omega[0], plane.omega[1]) * self.camera.focal_px
        moved_px = [flow_px * (views.newest.time_s - views.view(gap).time_s) for gap in range(1, longest + 1)]
        if not moved_px or not moved_px[-1] >= _LEAST_PX:
            return []
        gap = next((k for k, px in enumerate(moved_px, 1) if px >= self.options.border_flow_px), longest)
        return [gap, 2 * gap] if 2 * gap <= longest else [gap]

    def _before(self, views: Views, plane: Plane, gaps: list[int]) -> list[_Before]:
        """The frames to compare with; none where the motion since is not known."""
        rotations = [rotation for gap in gaps if (rotation := views.rotation(gap)) is not None]
        if not gaps or len(rotations) < len(gaps):
            return []
        tracks, derotated = views.stack(np.array(gaps))
        # over so short a time a rotation's error is small, and common to both strips
        weight, normal = plane.weights(len(views.tracker.alive)).take(tracks.slots), plane.normal
        found = OverPlane(tracks.new, derotated, normal, tracks.whitener).displacement(weight)
        if found is None:
            return []
        return [
            _Before(gap, rotation @ towards(t.tolist(), normal.tolist()), rotation)
            for gap, rotation, t in zip(gaps, rotations, found[0], strict=True)
        ]

    def _places(self, befores: list[_Before]) -> list[_Place]:
        """The strips at the sides where ground comes in."""
        if not befores:
            return []
        there = np.concatenate([apply(before.on_plane, self._middle_rays) for before in befores])
        way = self._middles - self.camera.project(there).reshape(len(befores), -1, 2)
        wanted = []
        for before, moved in zip(befores, way.tolist(), strict=True):
            for number, side in enumerate(self._sides):
                coming = -moved[number][side.axis] if side.far else moved[number][side.axis]
                begin = math.ceil(coming) + _CLEAR if coming >= _LEAST_PX else side.across_px
                if begin + _REFERENCE.stop < side.across_px // 2 and side.blocks:
                    wanted.append((number, begin, before))
        if not wanted:
            return []
        seen = []
        for number, begin, before in wanted:
            lines = [begin + _DEPTH // 2, begin + (_REFERENCE.start + _REFERENCE.stop) // 2]
            rays = self._sides[number].rays[lines].reshape(-1, 2)
            seen += [apply(before.on_plane, rays), apply(before.far_away, rays)]
        pixels = np.split(self.camera.project(np.concatenate(seen)), np.cumsum([len(x) for x in seen])[:-1])
        return [
            _Place(*place, (on_plane - far_away).reshape(2, -1, 2).astype(np.float32))
            for place, on_plane, far_away in zip(wanted, pixels[::2], pixels[1::2], strict=True)
        ]

    def _strips(self, views: Views, places: list[_Place]) -> _Strips:
        """A side's outer strips over those further in; blocks that the older frame did not see have no information."""
        o, side, depth = self.options, self._sides[places[0].side], _REFERENCE.stop
        new = views.tracker.images[0]
        first, last = min(place.begin for place in places), max(place.begin for place in places)
        rows, columns = side.window(first, last - first + depth)
        around = new[rows.start - 1 : rows.stop + 1, columns.start - 1 : columns.stop + 1]
        slope = np.stack(
            [
                side.lines(cv2.Scharr(around, cv2.CV_32F, *d, scale=1 / 32)[1:-1, 1:-1])
                for d in ((1, 0), (0, 1))
            ]
        )
        # u and v of the slopes, what has changed, the pixels across the side where each was seen: of each strip's lines
        slopes = np.stack([slope[:, p.begin - first : p.begin - first + depth] for p in places])
        changed, across = np.empty((2, len(places), *slopes.shape[2:]), np.float32)
        shown = np.ones(changed.shape, bool)  # what shows ground in both frames
        for place, left, beside, free in zip(places, changed, across, shown, strict=True):
            rows, columns = side.window(place.begin, depth)
            moves = views.rows.moves_of(place.before.gap)
            at = self._warp.places(place.before.on_plane, rows, columns, moves)
            old = views.tracker.images[place.before.gap]
            warped = cv2.remap(old, at, _NO_SECOND_MAP, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101)
            left[:] = side.lines(cv2.subtract(new[rows, columns], warped, dtype=cv2.CV_32F))
            beside[:] = side.lines(at[..., side.axis])
            if self.barred is not None:
                there = cv2.remap(self.barred.astype(np.uint8), at, _NO_SECOND_MAP, cv2.INTER_NEAREST)
                free[:] = side.lines(~(self.barred[rows, columns] | (there > 0)))
        # per unit height, of the outer blocks and of those further in: (strip, u and v, 1, block, 1)
        shift = np.stack([place.parallax for place in places]).transpose(1, 0, 3, 2)[:, :, :, None, :, None]
        # in each block what unit height changes, what has changed, and what is the same everywhere
        rows_of = np.ones((len(places), side.blocks, 3, _DEPTH, _LENGTH), np.float32)
        rows_of[:, :, 0] = (slopes[:, :, :_DEPTH] * shift[0]).sum(axis=1).transpose(0, 2, 1, 3)
        rows_of[:, :, 1] = changed[:, :_DEPTH].transpose(0, 2, 1, 3)
        flat = rows_of.reshape(len(places), side.blocks, 3, -1)
        product = np.matmul(flat[:, :, :2], flat.transpose(0, 1, 3, 2)).astype(np.float64)
        pixels = _DEPTH * _LENGTH
        square = np.maximum(product[..., 0, 0] - product[..., 0, 2] ** 2 / pixels, 1e-9)
        cross = product[..., 0, 1] - product[..., 0, 2] * product[..., 1, 2] / pixels
        height = cross / square
        rest = product[..., 1, 1] - product[..., 1, 2] ** 2 / pixels - height * cross
        noise = np.maximum(rest, 0.0) / (pixels * square)
        moved2 = (shift[0, ..., 0] ** 2).sum(axis=(1, 2))
        locking2 = o.border_locking_px**2 / np.maximum(moved2, 1e-6)
        outer = across[:, :_DEPTH]
        seen = (outer.min(axis=(1, 3)) >= 0) & (outer.max(axis=(1, 3)) <= side.across_px - 1)
        seen &= shown[:, :_DEPTH].all(axis=(1, 3))
        information = np.where(seen, 1 / (o.border_noise**2 * noise + locking2), 0.0)
        # of the inner strip as a whole
        by_height = (slopes[:, :, _REFERENCE] * shift[1]).sum(axis=1).reshape(len(places), -1)
        inner = shown[:, _REFERENCE].reshape(len(places), -1)
        by_height -= (by_height * inner).sum(axis=1, keepdims=True) / np.maximum(
            inner.sum(axis=1, keepdims=True), 1
        )
        by_height *= inner
        information[inner.mean(axis=1) < _LEAST_SHOWN] = 0.0
        left = changed[:, _REFERENCE].reshape(len(places), -1)
        common = (left * by_height).sum(axis=1) / np.maximum((by_height**2).sum(axis=1), 1e-9)
        return _Strips(places, height - common[:, None], information)

    def _steps(self, strips: _Strips) -> list[BorderStep]:
        """The runs of blocks with significant height: in each strip and of each length the one with the largest mean.

        In a whole side the errors of its blocks even out, and of many runs one is off by chance: less is asked of it.
        """
        o, out = self.options, []
        side, blocks = self._sides[strips.places[0].side], strips.height.shape[1]
        both = np.zeros((2, len(strips.places), blocks + 1))
        np.cumsum(strips.information, axis=1, out=both[0, :, 1:])
        np.cumsum(strips.height * strips.information, axis=1, out=both[1, :, 1:])
        for length in {*(min(run, blocks) for run in _RUNS), blocks}:
            total, weighted = both[..., length:] - both[..., :-length]
            total = np.maximum(total, 1e-9)
            away = np.abs(weighted) / (max(self._scatter, 1.0) * np.sqrt(total))
            candidates = away > (o.border_side_sigmas if length == blocks else o.border_sigmas)
            if not candidates.any():
                continue
            mean = np.where(candidates, weighted / total, 0.0)
            for place, means, aways in zip(strips.places, mean, away, strict=True):
                best = int(np.abs(means).argmax())
                if means[best]:
                    size = self.camera.width * self.camera.height
                    share = length * _LENGTH * (place.begin + _DEPTH) / size
                    middles = side.middles[place.begin + _DEPTH // 2, best : best + length]
                    square = float(means[best] ** 2) * share
                    sure = bool(aways[best] > o.border_sigmas)
                    out.append(BorderStep(place.side, middles, float(means[best]), square, sure))
        return out

    def _learn(self, strips: _Strips) -> None:
        """How much blocks beside each other differ, over their sigma: more in compressed pictures of faint ground."""
        for all_heights, information in zip(strips.height, strips.information, strict=True):
            seen = information > 0
            height = all_heights[seen]
            middle = len(height) // 2
            if len(height) >= _RUNS[-1]:
                away = np.abs(height - np.partition(height, middle)[middle]) * np.sqrt(information[seen])
                typical = float(np.partition(away, middle)[middle]) * _MEDIAN_TO_STD
                self._scatter += _LEARNT * (typical - self._scatter)


def _largest(found: list[BorderStep]) -> BorderStep:
    return max(found, key=lambda step: step.mean_square)
