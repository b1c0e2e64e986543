"""What stands still in the picture while the ground moves: skids, legs, a gimbal's edge, dirt on the lens, a caption.

Two pictures between which the ground moved are compared cell by cell in two ways: as they are, and with the older one
warped by the plane's homography. Ground agrees in the second way, a part of the vehicle in the first (background
subtraction with a compensated camera, turned round). A cell's sums of squared differences over many looks decide, with
hysteresis, and go on in masked cells: what was masked wrongly is given back. Ground without texture agrees in both
ways, and what moves by itself in neither. Ground beside a part is hidden by it in one of the two pictures, and looks
then as if it did not go with the ground: both pictures are warped, each to the other, and ground must agree in one.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from landing.motion.views import View
from landing.vision.camera import CameraModel
from landing.vision.homography import Warp, towards
from landing.vision.rolling_shutter import Motion

Array = NDArray[np.float64]
Image = NDArray[Any]
Mask = NDArray[np.bool_]

_COLUMNS = 160
"""Pictures are compared at about this width."""
_CELL = 2
"""Side of a cell at that width, px."""
_TAPER = np.array((0.25, 0.5, 0.25), np.float32)
"""Weights of a cell and its neighbours: two cells side by side show enough texture."""
_MEAN = 15
"""Side of the area whose mean is taken out: exposure and shading change slowly over the picture, px."""
_SHIFT = 0.035
"""Motion of the picture's middle over a look, over the width: beyond the correlation of most texture."""
_LEAST_SHIFT = 0.4
"""Share of it by which a cell must move to be compared."""
_KEPT = 40
_FRAMES_APART = 3
_REACH = _CELL // 2
"""From a cell's middle to its sides, px."""
_LOOKS = 6
"""Looks from which a cell may be masked."""
_FEW = 8
"""Cells whose change can wait."""
_MEMORY = 24.0
"""Looks over which the sums fade."""
_STILL, _MOVES = 0.45, 0.9
"""Ratio of the two sums below which a cell stands still, and above which it does not any more."""
_SHOWN = 1.5
"""Ratio of the two sums in the middle of all cells from which the view shows that the ground moves."""
_SEEN = 0.25
"""Share of the picture's usual change that the ground's motion would have made in a cell that stands still."""


@dataclass(frozen=True, slots=True)
class _Picture:
    time_s: float
    image: Image
    ned_from_camera: Array


class FixedParts:
    """Feed it every picture with the motion over the plane; ``mask`` is what it has found.

    ``mask`` (height, width): pixels that stand still, one cell wider on all sides; starts as ``known`` does.
    """

    def __init__(self, camera: CameraModel, known: Mask | None = None) -> None:
        self._camera, self._warp = camera, Warp(camera)
        self._factor = max(1, round(camera.width / _COLUMNS))
        self._side = _CELL * self._factor
        self._shape = camera.height // self._side, camera.width // self._side
        self._pictures: deque[_Picture] = deque(maxlen=_KEPT)
        self._frames = self._since = 0
        both = 2, *self._shape
        self._still, self._warped, self._looks = np.zeros(self._shape), np.zeros(both), np.zeros(both)
        self.cells: Mask = np.zeros(self._shape, bool)
        self.mask: Mask = np.zeros((camera.height, camera.width), bool)
        if known is not None:
            self._begin(known)

    def step(self, view: View, image: Image, motion: Motion | None) -> bool:
        """Take a picture (height, width) and the motion over the plane, None: unknown; whether ``mask`` has changed."""
        if view.ned_from_camera is None:
            return False
        self._frames += 1
        now = _Picture(view.time_s, self._small(image), view.ned_from_camera)
        if self._frames >= _FRAMES_APART and motion is not None:
            older = self._older(now, motion)
            if older is not None:
                self._frames = 0
                self._look(now.image, *older)
                self._pictures.append(now)
                return self._decide()
        self._pictures.append(now)
        return False

    def _small(self, image: Image) -> Image:
        rows, columns = self._shape
        image = image[: rows * self._side, : columns * self._side]
        return cv2.resize(image, (columns * _CELL, rows * _CELL), interpolation=cv2.INTER_AREA)

    def _older(self, now: _Picture, motion: Motion) -> tuple[Image, Array] | None:
        """The newest earlier picture over which the middle moved far enough, and the homography to it."""
        target = _SHIFT * self._camera.width / self._camera.focal_px
        for old in reversed(self._pictures):
            old_from_new = (old.ned_from_camera.T @ now.ned_from_camera) @ towards(
                motion.omega * (old.time_s - now.time_s), motion.normal
            )
            x, y, z = old_from_new[:, 2]
            if z <= 0:
                return None
            moved = math.hypot(x / z, y / z)
            if moved > 3 * target:
                return None
            if moved >= target:
                return old.image, old_from_new
        return None

    def _look(self, new: Image, old: Image, old_from_new: Array) -> None:
        f = self._factor
        places = self._warp.places(old_from_new)[f // 2 :: f, f // 2 :: f]
        places = np.ascontiguousarray(places[: new.shape[0], : new.shape[1]])
        if f > 1:
            places = np.asarray((places - (f - 1) / 2) / f, np.float32)
        level, before = _level(new), _level(old)
        grid = np.stack(np.meshgrid(*(np.arange(n, dtype=np.float32) for n in new.shape[::-1])), axis=-1)
        still = _cells(cv2.absdiff(level, before))
        middle = places[_CELL // 2 :: _CELL, _CELL // 2 :: _CELL]
        way = middle - grid[_CELL // 2 :: _CELL, _CELL // 2 :: _CELL]
        moves = np.hypot(way[..., 0], way[..., 1]) >= _LEAST_SHIFT * _SHIFT * self._camera.width / f
        inside = np.array((new.shape[1], new.shape[0])) - _REACH
        seen = np.zeros(self._looks.shape, bool)
        # over so short a way the ground comes from as far on one side as it goes to on the other
        there_and_back = (places, level, before), (2 * grid - places, before, level)
        for k, (at, here, there) in enumerate(there_and_back):
            # OpenCV 5.0.0 interpolates linearly at wrong places where both coordinates come in one map
            x, y = np.ascontiguousarray(at[..., 0]), np.ascontiguousarray(at[..., 1])
            warped = cv2.remap(there, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            # all of the cell lies in the other picture
            centre = at[_CELL // 2 :: _CELL, _CELL // 2 :: _CELL]
            seen[k] = moves & ((centre >= _REACH - 0.5) & (centre <= inside + 0.5)).all(axis=2)
            self._looks[k][seen[k]] = np.minimum(self._looks[k][seen[k]] + 1, _MEMORY)
            gain = seen[k] / np.maximum(self._looks[k], 1.0)
            self._warped[k] += gain * (_cells(cv2.absdiff(here, warped)) - self._warped[k])
        gain = seen.any(axis=0) / np.maximum(self._looks.max(axis=0), 1.0)
        self._still += gain * (still - self._still)

    def _decide(self) -> bool:
        known = self._looks >= _LOOKS
        enough = known.any(axis=0)
        if not enough.any():
            return False
        warped = np.where(known, self._warped, math.inf).min(axis=0)
        usual = float(np.median(self._still[enough]))
        # the rest of the view must show that the ground moves: tiles may fall on themselves
        moves = usual > _SHOWN * float(np.median(warped[enough]))
        still = enough & (self._still < _STILL * warped) & (warped > _SEEN * usual) & moves
        kept = self.cells & ~(enough & (self._still > _MOVES * warped))
        found = still | kept
        changed = int(np.count_nonzero(found != self.cells))
        self._since += 1
        # single cells at an edge come and go: who uses the mask need not follow each of them at once
        if not changed or (changed <= _FEW and self._since < _LOOKS):
            return False
        self.cells, self._since = found, 0
        wide = cv2.dilate(found.astype(np.uint8), np.ones((3, 3), np.uint8))
        mask = np.zeros_like(self.mask)
        big = np.kron(wide, np.ones((self._side, self._side), np.uint8)).astype(bool)
        mask[: big.shape[0], : big.shape[1]] = big
        # what is left over of the picture beyond whole cells is as the last of them
        mask[big.shape[0] :, : big.shape[1]] = big[-1:]
        mask[:, big.shape[1] :] = mask[:, big.shape[1] - 1 : big.shape[1]]
        self.mask = mask
        return True

    def _begin(self, known: Mask) -> None:
        """Start from a mask that was found before; looks at the ground can still take it back."""
        self.mask = known.copy()
        rows, columns = self._shape
        whole = known[: rows * self._side, : columns * self._side].astype(np.uint8)
        share = cv2.resize(255 * whole, (columns, rows), interpolation=cv2.INTER_AREA)
        self.cells = cv2.erode((share > 127).astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)


def _level(image: Image) -> NDArray[np.float32]:
    """The picture without its local mean."""
    image = image.astype(np.float32)
    return np.asarray(image - cv2.blur(image, (_MEAN, _MEAN)), np.float32)


def _cells(difference: Image) -> Array:
    """Mean squares (rows, columns) over cells and, by half, their neighbours."""
    rows, columns = difference.shape[0] // _CELL, difference.shape[1] // _CELL
    square = cv2.multiply(difference, difference)
    small = cv2.resize(square, (columns, rows), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.sepFilter2D(small, -1, _TAPER, _TAPER, borderType=cv2.BORDER_REPLICATE), np.float64)
