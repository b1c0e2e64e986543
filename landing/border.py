"""Relief at the sides of the view where ground has just come in and no track has a history yet.

Strips along these sides are compared, picture with picture, with what the plane and the motion make of the view a few
frames ago. What stands above the plane is displaced further along its parallax; the share by which, found by least
squares over a block of pixels, is its height over the distance. A strip a little further in, which the tracks have
judged, is the measure: what both have in common is an error of the plane or of the motion. Two gaps are looked at: the
shorter one shows what has come in last, the longer one shows it twice as well once it is a little further in.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from landing.camera import CameraModel
from landing.homography import Warp, apply, towards
from landing.motion import OverPlane
from landing.options import EstimatorOptions
from landing.plane import Plane
from landing.views import Views

Array = NDArray[np.float64]

_LENGTH, _DEPTH = 20, 5
"""A block of pixels: along the side and across it."""
_CLEAR = 1
"""Pixels between what has just come in and the strip: the interpolation's reach."""
_REFERENCE = slice(8, 18)
"""The strip further in, pixels from the beginning of the outer one."""
_RUNS = (3, 5)
"""Blocks in a row that are judged together, beside the whole side."""
_LEAST_PX = 1.0
"""Motion below which nothing comes in."""
SIDES = ((1, False), (1, True), (0, False), (0, True))
"""The axis across a side (0: x, 1: y), and whether it is the far side."""
_LEARNT = 0.05
"""Share of a strip in what is known of the scatter of blocks."""
_MEDIAN_TO_STD = 1.4826
_NO_SECOND_MAP = np.empty((0, 0), np.float32)


@dataclass(frozen=True, slots=True)
class Standing:
    """Blocks at a side: their middles (k, 2) px, height over the distance, share of the view's mean square height.

    ``lasting``: the same side stood out in the frame before as well.
    """

    side: int
    pixels: Array
    height: float
    mean_square: float
    lasting: bool = False


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
class _Strip:
    """Blocks (k,) along a side: height over the distance, its information, middles (k, 2) px.

    ``end_px``: how far the strip reaches, from the side.
    """

    height: Array
    information: Array
    middles: Array
    end_px: int


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

    def __init__(self, options: EstimatorOptions, camera: CameraModel) -> None:
        self.options, self.camera = options, camera
        self._warp = Warp(camera)
        self._sides = [_Side(camera, axis, far) for axis, far in SIDES]
        self._middles = np.array([side.middle for side in self._sides])
        self._middle_rays = np.concatenate([side.middle_ray for side in self._sides])
        self._frame = -2
        self._last: set[int] = set()
        self._scatter = 1.0
        self.incoming: set[int] = set()
        """The sides where ground came in at the last step."""

    def step(self, views: Views, plane: Plane) -> Standing | None:
        """What surely stands out at the sides of the newest frame, None where nothing does."""
        found: list[Standing] = []
        places = self._places(self._before(views, plane, self._gaps(views, plane)))
        self.incoming = {place.side for place in places}
        for place in places:
            strip = self._strip(views, place)
            found += self._standing(place.side, strip)
            self._learn(strip)
        last = self._last if self._frame == views.tracker.frame - 1 else set()
        self._frame, self._last = views.tracker.frame, {standing.side for standing in found}
        most = max(found, key=lambda standing: standing.mean_square, default=None)
        return None if most is None else replace(most, lasting=most.side in last)

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
        found = []
        for before in befores:
            way = self._middles - self.camera.project(apply(before.on_plane, self._middle_rays))
            for number, side in enumerate(self._sides):
                coming = float(-way[number, side.axis] if side.far else way[number, side.axis])
                begin = math.ceil(coming) + _CLEAR if coming >= _LEAST_PX else side.across_px
                if begin + _REFERENCE.stop < side.across_px // 2 and side.blocks:
                    rays = side.rays[[begin + _DEPTH // 2, begin + (_REFERENCE.start + _REFERENCE.stop) // 2]]
                    rays = rays.reshape(-1, 2)
                    both = np.concatenate((apply(before.on_plane, rays), apply(before.far_away, rays)))
                    on_plane, far_away = self.camera.project(both).reshape(2, 2, side.blocks, 2)
                    found.append(_Place(number, begin, before, (on_plane - far_away).astype(np.float32)))
        return found

    def _strip(self, views: Views, place: _Place) -> _Strip:
        """The outer strip over the one further in; blocks that the older frame did not see have no information."""
        o, side, depth = self.options, self._sides[place.side], _REFERENCE.stop
        rows, columns = side.window(place.begin, depth)
        new, old = views.tracker.images[0], views.tracker.images[place.before.gap]
        places = self._warp.places(place.before.on_plane, rows, columns)
        warped = cv2.remap(old, places, _NO_SECOND_MAP, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101)
        around = new[rows.start - 1 : rows.stop + 1, columns.start - 1 : columns.stop + 1]
        gx, gy = (
            side.lines(cv2.Scharr(around, cv2.CV_32F, *d, scale=1 / 32)[1:-1, 1:-1]) for d in ((1, 0), (0, 1))
        )
        left = side.lines(cv2.subtract(new[rows, columns], warped, dtype=cv2.CV_32F))
        # in each block what unit height changes, what has changed, and what is the same everywhere
        rows_of = np.ones((side.blocks, 3, _DEPTH, _LENGTH), np.float32)
        outer, shift = slice(0, _DEPTH), place.parallax[0]
        rows_of[:, 0] = (gx[outer] * shift[:, :1] + gy[outer] * shift[:, 1:]).transpose(1, 0, 2)
        rows_of[:, 1] = left[outer].transpose(1, 0, 2)
        flat = rows_of.reshape(side.blocks, 3, -1)
        product = np.matmul(flat[:, :2], flat.transpose(0, 2, 1))
        pixels = _DEPTH * _LENGTH
        square = np.maximum(product[:, 0, 0] - product[:, 0, 2] ** 2 / pixels, 1e-9)
        cross = product[:, 0, 1] - product[:, 0, 2] * product[:, 1, 2] / pixels
        height = cross / square
        rest = product[:, 1, 1] - product[:, 1, 2] ** 2 / pixels - height * cross
        noise = np.maximum(rest, 0.0) / (pixels * square)
        locking2 = o.border_locking_px**2 / np.maximum((place.parallax[0] ** 2).sum(axis=1), 1e-6)
        beside = side.lines(places[..., side.axis])[:_DEPTH]
        seen = (beside.min(axis=(0, 2)) >= 0) & (beside.max(axis=(0, 2)) <= side.across_px - 1)
        information = np.where(seen, 1 / (o.border_noise**2 * noise + locking2), 0.0)
        # of the inner strip as a whole
        inner, shift = _REFERENCE, place.parallax[1]
        by_height = (gx[inner] * shift[:, :1] + gy[inner] * shift[:, 1:]).ravel()
        by_height -= float(by_height.sum()) / len(by_height)
        common = float(left[inner].ravel() @ by_height) / max(float(by_height @ by_height), 1e-9)
        middles = side.middles[place.begin + _DEPTH // 2]
        return _Strip(height.astype(np.float64) - common, information, middles, place.begin + _DEPTH)

    def _standing(self, side: int, strip: _Strip) -> list[Standing]:
        """The runs of blocks that stand out for sure, of each length the one that adds most to the view's relief."""
        out = []
        weighted = strip.height * strip.information
        for length in {*(min(run, len(weighted)) for run in _RUNS), len(weighted)}:
            ones = np.ones(length)
            total = np.maximum(np.convolve(strip.information, ones, "valid"), 1e-9)
            mean = np.convolve(weighted, ones, "valid") / total
            sure = np.abs(mean) * np.sqrt(total) > self.options.border_sigmas * max(self._scatter, 1.0)
            best = int(np.where(sure, np.abs(mean), 0.0).argmax())
            if sure[best]:
                share = length * _LENGTH * strip.end_px / (self.camera.width * self.camera.height)
                places = strip.middles[best : best + length]
                out.append(Standing(side, places, float(mean[best]), float(mean[best] ** 2) * share))
        return out

    def _learn(self, strip: _Strip) -> None:
        """How much blocks beside each other differ, over their sigma: more in compressed pictures of faint ground."""
        seen = strip.information > 0
        height = strip.height[seen]
        middle = len(height) // 2
        if len(height) >= _RUNS[-1]:
            away = np.abs(height - np.partition(height, middle)[middle]) * np.sqrt(strip.information[seen])
            typical = float(np.partition(away, middle)[middle]) * _MEDIAN_TO_STD
            self._scatter += _LEARNT * (typical - self._scatter)
