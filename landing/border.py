"""Relief at the sides of the view where ground has just come in and no track has a history yet.

Strips along these sides are compared, picture with picture, with what the plane and the motion make of the view a few
frames ago. What stands above the plane is displaced further along its parallax; the share by which, found by least
squares over a block of pixels, is its height over the distance. A strip a little further in, which the tracks have
judged, is the measure: what both have in common is an error of the plane or of the motion.
"""

import math
from dataclasses import dataclass
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

_LENGTH, _DEPTH = 20, 10
"""A block of pixels: along the side and across it."""
_CLEAR = 2
"""Pixels between what has just come in and the first strip: the interpolation's reach."""
_INWARDS = 14
"""Pixels from one strip to the other."""
_RUN = 5
"""Blocks in a row that are judged together, beside the whole side."""
_LEAST_PX = 1.0
"""Motion below which nothing comes in."""
_SIDES = ((1, False), (1, True), (0, False), (0, True))
"""The axis across a side (0: x, 1: y), and whether it is the far side."""
_NO_SECOND_MAP = np.empty((0, 0), np.float32)


@dataclass(frozen=True, slots=True)
class Standing:
    """Blocks at a side: their middles (k, 2) px, height over the distance, share of the view's mean square height."""

    pixels: Array
    height: float
    mean_square: float


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
    """Blocks (k,) along a side: height over the distance, its variance, middles (k, 2) px, mean parallax."""

    height: Array
    variance: Array
    middles: Array
    parallax_px: float


class Border:
    """Looks at the sides of each frame for ground that does not fit the plane."""

    def __init__(self, options: EstimatorOptions, camera: CameraModel) -> None:
        self.options, self.camera = options, camera
        self._size = (camera.width, camera.height)
        self._warp = Warp(camera)
        self._middles = np.tile((np.array(self._size) - 1) / 2, (len(_SIDES), 1))
        for middle, (axis, far) in zip(self._middles, _SIDES, strict=True):
            middle[axis] *= 2 if far else 0
        self._middle_rays = camera.undistort(self._middles)
        self._frame = -2
        self._last: dict[int, _Strip] = {}

    def step(self, views: Views, plane: Plane) -> Standing | None:
        """What surely stands out at the sides of the newest frame, None where nothing does."""
        before = self._before(views, plane)
        now = {} if before is None else self._strips(views, before)
        last = self._last if self._frame == views.tracker.frame - 1 else {}
        self._frame, self._last = views.tracker.frame, now
        found = [s for side, strip in now.items() if (s := self._standing(strip, last.get(side)))]
        return max(found, key=lambda standing: standing.mean_square, default=None)

    def _before(self, views: Views, plane: Plane) -> _Before | None:
        """The frame to compare with; None where there is none far enough away."""
        o = self.options
        longest = min(views.longest, len(views.tracker.images) - 1)
        flow_px = math.hypot(plane.omega[0], plane.omega[1]) * self.camera.focal_px
        moved_px = [flow_px * (views.newest.time_s - views.view(gap).time_s) for gap in range(1, longest + 1)]
        if not moved_px or not moved_px[-1] >= _LEAST_PX:
            return None
        gap = next((k for k, px in enumerate(moved_px, 1) if px >= o.border_flow_px), longest)
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

    def _strips(self, views: Views, before: _Before) -> dict[int, _Strip]:
        """The sides where ground comes in, by their number."""
        out = {}
        way = self._middles - self.camera.project(apply(before.on_plane, self._middle_rays))
        for side, (axis, far) in enumerate(_SIDES):
            coming = -way[side, axis] if far else way[side, axis]
            if coming < _LEAST_PX:
                continue
            begin = math.ceil(coming) + _CLEAR
            if begin + _INWARDS + _DEPTH < self._size[axis] // 2 and self._size[1 - axis] >= _LENGTH + 2:
                out[side] = self._strip(views, before, side, begin)
        return out

    def _strip(self, views: Views, before: _Before, side: int, begin: int) -> _Strip:
        """The strip ``begin`` pixels away from a side, over the one further in.

        Heights are NaN where the older frame did not see it.
        """
        axis, far = _SIDES[side]
        blocks = (self._size[1 - axis] - 2) // _LENGTH
        depth = _INWARDS + _DEPTH
        first = self._size[axis] - begin - depth if far else begin
        start = (self._size[1 - axis] - blocks * _LENGTH) // 2
        across, along = slice(first, first + depth), slice(start, start + blocks * _LENGTH)
        rows, columns = (across, along) if axis == 1 else (along, across)
        at = np.array((0.0, _INWARDS)) + (_DEPTH - 1) / 2
        middles = np.empty((2, blocks, 2))
        middles[..., axis] = (first + depth - 1 - at if far else first + at)[:, None]
        middles[..., 1 - axis] = start + _LENGTH * np.arange(blocks) + (_LENGTH - 1) / 2
        rays = self.camera.undistort(middles.reshape(-1, 2))
        on_plane, far_away = (self.camera.project(apply(h, rays)) for h in (before.on_plane, before.far_away))
        parallax = (on_plane - far_away).astype(np.float32)

        def in_blocks(picture: NDArray[Any]) -> NDArray[Any]:
            """The pixels (2 k, n) of the blocks of both strips, the outer one first."""
            turned = picture if axis == 1 else picture.T
            turned = turned[::-1] if far else turned
            both = np.concatenate((turned[:_DEPTH], turned[_INWARDS:])).reshape(2, _DEPTH, blocks, _LENGTH)
            return both.transpose(0, 2, 1, 3).reshape(2 * blocks, -1)

        new, old = views.tracker.images[0], views.tracker.images[before.gap]
        places = self._warp.places(before.on_plane, rows, columns)
        warped = cv2.remap(old, places, _NO_SECOND_MAP, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101)
        around = new[rows.start - 1 : rows.stop + 1, columns.start - 1 : columns.stop + 1]
        gx, gy = (
            in_blocks(cv2.Scharr(around, cv2.CV_32F, *d, scale=1 / 32)[1:-1, 1:-1]) for d in ((1, 0), (0, 1))
        )
        g = gx * parallax[:, :1] + gy * parallax[:, 1:]
        r = in_blocks(cv2.subtract(new[rows, columns], warped, dtype=cv2.CV_32F))
        g, r = g - g.mean(axis=1, keepdims=True), r - r.mean(axis=1, keepdims=True)
        square = np.maximum((g * g).sum(axis=1), 1e-9)
        height = (g * r).sum(axis=1) / square
        left = r - height[:, None] * g
        variance = self.options.border_noise**2 * (left * left).mean(axis=1) / square
        beside = in_blocks(places[..., axis])
        seen = (beside.min(axis=1) >= 0) & (beside.max(axis=1) <= self._size[axis] - 1)
        outer, inner = np.where(seen, height, math.nan).reshape(2, blocks)
        return _Strip(
            outer - inner,
            variance.reshape(2, blocks).sum(axis=0),
            middles[0],
            float(np.hypot(*parallax[:blocks].T).mean()),
        )

    def _standing(self, strip: _Strip, last: _Strip | None) -> Standing | None:
        """The run of blocks that adds most to the view's relief, of those that stand out for sure."""
        o = self.options
        both = [strip] if last is None else [strip, last]
        height, variance = np.array([s.height for s in both]), np.array([s.variance for s in both])
        each = np.where(np.isfinite(height), 1 / np.maximum(variance, 1e-12), 0.0)
        information, weighted = each.sum(axis=0), (np.where(each > 0, height, 0.0) * each).sum(axis=0)
        locking = o.border_locking_px / max(strip.parallax_px, 1e-3) / math.sqrt(len(both))
        most: Standing | None = None
        for length in {min(_RUN, len(information)), len(information)}:
            ones = np.ones(length)
            total = np.maximum(np.convolve(information, ones, "valid"), 1e-9)
            mean = np.convolve(weighted, ones, "valid") / total
            std = np.sqrt(1 / total + locking**2)
            sure = np.abs(mean) > np.maximum(o.border_height, o.border_sigmas * std)
            best = int(np.where(sure, np.abs(mean), 0.0).argmax())
            share = length * _LENGTH * _DEPTH / (self._size[0] * self._size[1])
            mean_square = float(mean[best] ** 2) * share
            if sure[best] and (most is None or mean_square > most.mean_square):
                most = Standing(strip.middles[best : best + length], float(mean[best]), mean_square)
        return most
