"""Relief at the sides of the view where ground has just come in and no track has a history yet.

Strips along these sides are compared, picture with picture, with what the plane and the motion make of the view a few
frames ago. What stands above the plane is displaced further along its parallax; the share by which, found by least
squares over a block of pixels, is its height over the distance. A strip a little further in, which the tracks have
judged, is the measure: what both have in common is an error of the plane or of the motion. Two gaps are looked at: the
shorter one shows what has come in last, the longer one shows it twice as well once it is a little further in.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from landing.camera import CameraModel
from landing.homography import Warp, apply
from landing.motion import displacement
from landing.options import EstimatorOptions
from landing.plane import Plane
from landing.rotations import exp_so3
from landing.views import Views

Array = NDArray[np.float64]

_LENGTH, _DEPTH = 20, 5
"""A block of pixels: along the side and across it."""
_CLEAR = 1
"""Pixels between what has just come in and the strip: the interpolation's reach."""
_REFERENCE = slice(8, 18)
"""The strip further in, pixels from the beginning of the outer one."""
_RUN = 5
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
class _Strip:
    """Blocks (k,) along a side: height over the distance, its information, middles (k, 2) px.

    ``end_px``: how far the strip reaches, from the side.
    """

    height: Array
    information: Array
    middles: Array
    end_px: int


class Border:
    """Looks at the sides of each frame for ground that does not fit the plane."""

    def __init__(self, options: EstimatorOptions, camera: CameraModel) -> None:
        self.options, self.camera = options, camera
        self._size = (camera.width, camera.height)
        self._warp = Warp(camera)
        self._middles = np.tile((np.array(self._size) - 1) / 2, (len(SIDES), 1))
        for middle, (axis, far) in zip(self._middles, SIDES, strict=True):
            middle[axis] *= 2 if far else 0
        self._middle_rays = camera.undistort(self._middles)
        self._frame = -2
        self._last: set[int] = set()
        self._scatter = 1.0
        self.incoming: set[int] = set()
        """The sides where ground came in at the last step."""

    def step(self, views: Views, plane: Plane) -> Standing | None:
        """What surely stands out at the sides of the newest frame, None where nothing does."""
        self.incoming = set()
        found: list[Standing] = []
        for gap in self._gaps(views, plane):
            before = self._before(views, plane, gap)
            if before is not None:
                for side, strip in self._strips(views, before):
                    self.incoming.add(side)
                    found += self._standing(side, strip)
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

    def _before(self, views: Views, plane: Plane, gap: int) -> _Before | None:
        """The frame to compare with; None where the motion since is not known."""
        o = self.options
        rotation = views.rotation(gap)
        if rotation is None:
            return None
        tracks, derotated = views.stack(np.array([gap]))
        found = displacement(
            tracks.new,
            derotated,
            plane.normal,
            tracks.whitener,
            plane.weights(len(views.tracker.alive))[tracks.slots],
            np.hypot((o.rotation_std_rad, o.rotation_std_rad, o.yaw_std_rad), views.baseline_std(gap)),
        )
        if found is None:
            return None
        t, error = np.split(found[0][0], 2)
        far_away = rotation @ exp_so3(error)
        on_plane = far_away @ (np.eye(3) - np.outer(t, plane.normal))
        return _Before(gap, on_plane, far_away)

    def _strips(self, views: Views, before: _Before) -> Iterator[tuple[int, _Strip]]:
        """The sides where ground comes in, by their number."""
        way = self._middles - self.camera.project(apply(before.on_plane, self._middle_rays))
        for side, (axis, far) in enumerate(SIDES):
            coming = -way[side, axis] if far else way[side, axis]
            if coming < _LEAST_PX:
                continue
            begin = math.ceil(coming) + _CLEAR
            if begin + _REFERENCE.stop < self._size[axis] // 2 and self._size[1 - axis] >= _LENGTH + 2:
                yield side, self._strip(views, before, side, begin)

    def _strip(self, views: Views, before: _Before, side: int, begin: int) -> _Strip:
        """The strip ``begin`` pixels away from a side, over the one further in.

        Blocks that the older frame did not see have no information.
        """
        o, (axis, far) = self.options, SIDES[side]
        blocks = (self._size[1 - axis] - 2) // _LENGTH
        depth = _REFERENCE.stop
        first = self._size[axis] - begin - depth if far else begin
        start = (self._size[1 - axis] - blocks * _LENGTH) // 2
        across, along = slice(first, first + depth), slice(start, start + blocks * _LENGTH)
        rows, columns = (across, along) if axis == 1 else (along, across)
        at = np.array(((_DEPTH - 1) / 2, (_REFERENCE.start + _REFERENCE.stop - 1) / 2))
        middles = np.empty((2, blocks, 2))
        middles[..., axis] = (first + depth - 1 - at if far else first + at)[:, None]
        middles[..., 1 - axis] = start + _LENGTH * np.arange(blocks) + (_LENGTH - 1) / 2
        rays = self.camera.undistort(middles.reshape(-1, 2))
        on_plane, far_away = (self.camera.project(apply(h, rays)) for h in (before.on_plane, before.far_away))
        parallax = (on_plane - far_away).reshape(2, blocks, 2).astype(np.float32)

        def from_side(picture: NDArray[Any]) -> NDArray[Any]:
            """The picture's rows as lines along the side, the outermost first, in blocks: (depth, blocks, length)."""
            turned = picture if axis == 1 else picture.T
            return (turned[::-1] if far else turned).reshape(depth, blocks, _LENGTH)

        new, old = views.tracker.images[0], views.tracker.images[before.gap]
        places = self._warp.places(before.on_plane, rows, columns)
        warped = cv2.remap(old, places, _NO_SECOND_MAP, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101)
        around = new[rows.start - 1 : rows.stop + 1, columns.start - 1 : columns.stop + 1]
        gx, gy = (
            from_side(cv2.Scharr(around, cv2.CV_32F, *d, scale=1 / 32)[1:-1, 1:-1]) for d in ((1, 0), (0, 1))
        )
        r = from_side(cv2.subtract(new[rows, columns], warped, dtype=cv2.CV_32F))

        def sums(part: slice, shift: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
            """Sums of g^2, g r and r^2 in each block (blocks,), about its means; g is the change by unit height."""
            g = gx[part] * shift[:, :1] + gy[part] * shift[:, 1:]
            both = np.stack((g, r[part]))
            both -= both.mean(axis=(1, 3), keepdims=True)
            product = np.einsum("iabc,jabc->bij", both, both)
            return np.maximum(product[:, 0, 0], 1e-9), product[:, 0, 1], product[:, 1, 1]

        square, cross, left = sums(slice(0, _DEPTH), parallax[0])
        square_in, cross_in, _ = sums(_REFERENCE, parallax[1])
        height = cross / square
        noise = o.border_noise**2 * np.maximum(left - height * cross, 0.0) / (_DEPTH * _LENGTH * square)
        locking = o.border_locking_px / np.maximum(np.hypot(*parallax[0].T), 1e-3)
        beside = from_side(places[..., axis])[:_DEPTH]
        seen = (beside.min(axis=(0, 2)) >= 0) & (beside.max(axis=(0, 2)) <= self._size[axis] - 1)
        information = np.where(seen, 1 / (noise + locking**2), 0.0)
        height = height - float(cross_in.sum()) / float(square_in.sum())
        return _Strip(height.astype(np.float64), information, middles[0], begin + _DEPTH)

    def _standing(self, side: int, strip: _Strip) -> list[Standing]:
        """The runs of blocks that stand out for sure, of each length the one that adds most to the view's relief."""
        out = []
        weighted = strip.height * strip.information
        for length in {min(_RUN, len(weighted)), len(weighted)}:
            ones = np.ones(length)
            total = np.maximum(np.convolve(strip.information, ones, "valid"), 1e-9)
            mean = np.convolve(weighted, ones, "valid") / total
            sure = np.abs(mean) * np.sqrt(total) > self.options.border_sigmas * max(self._scatter, 1.0)
            best = int(np.where(sure, np.abs(mean), 0.0).argmax())
            if sure[best]:
                share = length * _LENGTH * strip.end_px / (self._size[0] * self._size[1])
                places = strip.middles[best : best + length]
                out.append(Standing(side, places, float(mean[best]), float(mean[best] ** 2) * share))
        return out

    def _learn(self, strip: _Strip) -> None:
        """How much blocks beside each other differ, over their sigma: more in compressed pictures of faint ground."""
        seen = strip.information > 0
        if np.count_nonzero(seen) >= _RUN:
            height = strip.height[seen]
            away = np.abs(height - np.median(height)) * np.sqrt(strip.information[seen])
            self._scatter += _LEARNT * (float(np.median(away)) * _MEDIAN_TO_STD - self._scatter)
