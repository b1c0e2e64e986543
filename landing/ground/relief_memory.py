"""Obstacle points, remembered while the ground about them is out of the tracks' sight."""

import math

import numpy as np
from numpy.typing import NDArray

from landing.vision.camera import CameraModel

Array = NDArray[np.float64]
Marks = NDArray[np.bool_]

_WITH_VEHICLE = -0.95
"""Height over the distance below which a point goes with the vehicle: ground would be 20 times as far as the plane."""
_MARGIN = 0.025
"""Border beyond the view, over its width, in which points are still remembered."""
_MOST = 100
"""Points that are remembered."""
_AHEAD = 0.1
"""A point whose depth shrank below this share of its last one is beside or behind the camera."""


class Cells:
    """The view divided into square cells that count alike, however many tracks they hold."""

    def __init__(self, camera: CameraModel, count: int) -> None:
        self._last = np.array((camera.width - 1, camera.height - 1))
        self._side_px = math.sqrt(camera.width * camera.height / count)
        self._columns = math.ceil(camera.width / self._side_px)
        self._count = self._columns * math.ceil(camera.height / self._side_px)

    def of(self, pixel: NDArray[np.floating]) -> NDArray[np.int64]:
        """The cell (n,) of each pixel (n, 2)."""
        column, row = (np.minimum(np.maximum(pixel, 0), self._last) / self._side_px).astype(np.int64).T
        return np.asarray(row * self._columns + column)

    def marked(self, cell: NDArray[np.int64]) -> Marks:
        """Which of all cells occur in ``cell`` (n,)."""
        marks = np.zeros(self._count, bool)
        marks[cell] = True
        return marks


class ReliefMemory:
    """Obstacle points move with the ground until they leave the view or the ground there is measured as even.

    ``border_px``: no track can lie nearer to the image's border; what is there is known from before alone.
    """

    def __init__(self, camera: CameraModel, cells: Cells, border_px: float) -> None:
        self.camera, self.cells = camera, cells
        self._near, self._far = border_px, np.array((camera.width, camera.height)) - border_px
        self._cell: NDArray[np.int64]
        self._in_border: Marks
        self.forget()

    def forget(self) -> None:
        """Start anew."""
        self._rays, self._pixels, self.heights = np.empty((3, 0)), np.empty((0, 2)), np.empty(0)
        self._locate()

    def take_mask(self) -> None:
        """The camera's mask has changed: obstacle points there are no ground, and no track will show it even."""
        mask = self.camera.mask
        if mask is None or not len(self.heights):
            return
        last = np.array((self.camera.width, self.camera.height)) - 1
        column, row = np.rint(np.clip(self._pixels, 0, last)).astype(np.intp).T
        self._keep(~mask[row, column])

    def move(self, on_plane: Array | None, far_away: Array | None = None) -> None:
        """Carry the points into the next frame; None: forget.

        ``on_plane`` and ``far_away`` (3, 3) are homographies new_from_previous of normalised points. What stands e over
        the plane, over the distance, is displaced (1 + e) times as far as the plane.
        """
        if on_plane is None or far_away is None:
            self.forget()
        if not len(self.heights) or on_plane is None or far_away is None:
            return
        q, far = np.dot(np.concatenate((on_plane, far_away)), self._rays).reshape(2, 3, -1)
        q += self.heights * (q - far)
        ahead = q[2] > _AHEAD
        if not ahead.all():
            q, self.heights = q.compress(ahead, 1), self.heights.compress(ahead)
        q /= q[2]
        self._rays, self._pixels = q, self.camera.project(q[:2].T)
        self._locate()
        margin = _MARGIN * self.camera.width
        beyond = np.array((self.camera.width, self.camera.height)) + margin
        self._keep(_all(np.logical_and(self._pixels >= -margin, self._pixels < beyond)))

    def update(
        self,
        points: Array,
        pixels: NDArray[np.floating],
        heights: Array,
        cell: NDArray[np.int64],
        even: Marks,
    ) -> None:
        """Store ``points`` (k, 2) with significant relief in their cells; the cells ``even`` have none."""
        if len(self.heights):
            replaced = even.copy()
            replaced[cell] = True
            self._keep(np.logical_or(~replaced.take(self._cell), self._in_border))
        ground = heights > _WITH_VEHICLE
        if ground.any():
            self._append(points[ground], pixels[ground].astype(np.float64), heights[ground])

    def add(self, pixels: Array, height: float) -> None:
        """Store places (n, 2) px whose height was measured without any track."""
        self._append(self.camera.undistort(pixels), pixels, np.full(len(pixels), height))

    def unseen(self, seen: Marks) -> tuple[NDArray[np.int64], Array]:
        """Cells (m,) and heights (m,) of the points where nothing is measured: not in ``seen``, or in the border."""
        if not len(self.heights):
            return self._cell, self.heights
        gone = np.logical_or(~seen.take(self._cell), self._in_border)
        return self._cell.compress(gone), self.heights.compress(gone)

    def _append(self, points: Array, pixels: Array, heights: Array) -> None:
        kept = slice(max(0, len(self.heights) + len(heights) - _MOST), None)
        rays = np.concatenate((points.T, np.ones((1, len(points)))))
        self._rays = np.concatenate((self._rays, rays), axis=1)[:, kept]
        self._pixels = np.concatenate((self._pixels, pixels))[kept]
        self.heights = np.concatenate((self.heights, heights))[kept]
        self._locate()

    def _keep(self, keep: Marks) -> None:
        if not keep.all():
            self._rays, self._pixels = self._rays.compress(keep, 1), self._pixels.compress(keep, 0)
            self.heights = self.heights.compress(keep)
            self._cell, self._in_border = self._cell.compress(keep), self._in_border.compress(keep)

    def _locate(self) -> None:
        """The cell of each point, and whether it lies in the border."""
        self._cell = self.cells.of(self._pixels)
        self._in_border = ~_all(np.logical_and(self._pixels >= self._near, self._pixels <= self._far))


def _all(both: Marks) -> Marks:
    """Whether both columns of (n, 2) are true."""
    return np.logical_and(both[:, 0], both[:, 1])
