"""Shi-Tomasi corners spread over the view by a grid."""

import cv2
import numpy as np
from numpy.typing import NDArray

from landing.options import TrackingOptions
from landing.vision.camera import CameraModel
from landing.vision.texture import BLOCK, MIDDLE, Tensor, block_of

_SIDE = 3
"""Side of the window a corner is found by, in blocks of the structure tensor."""
_MAX_STD_PX = 0.4
"""Worst predicted error of a corner's match along its weak direction."""
_SPACING = 7
"""Side of the square about a track, in blocks, that gets no other."""


class Corners:
    """Finds corners in the empty cells of a grid over images of one size."""

    def __init__(self, camera: CameraModel, options: TrackingOptions) -> None:
        self.camera, self.options = camera, options
        # no more cells than tracks, or strong texture would leave the faint cells without one
        self.cell_px = 8
        while (camera.height // self.cell_px) * (camera.width // self.cell_px) > options.max_features:
            self.cell_px += 1
        self._rows, self._cols = camera.height // self.cell_px, camera.width // self.cell_px
        top = (camera.height - self._rows * self.cell_px) // 2
        left = (camera.width - self._cols * self.cell_px) // 2
        self._first = np.array((left, top), np.float32)
        # the outermost cells reach to the border
        row, column = (
            np.clip((np.arange(side) - first) // self.cell_px, 0, count - 1)
            for side, first, count in ((camera.height, top, self._rows), (camera.width, left, self._cols))
        )
        self._cell = (row[:, None] * self._cols + column).ravel()
        self._open, self._members = self._places()

    @property
    def cells(self) -> int:
        """How many cells the grid has."""
        return self._rows * self._cols

    def cell_of(self, pixels: NDArray[np.float32]) -> NDArray[np.int64]:
        """The grid's cell, row by row, of each pixel (n, 2) of the image."""
        column, row = pixels.astype(np.int64).T
        return self._cell.take(row * self.camera.width + column)

    def occupied(self, pixels: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Which cells hold one of the pixels (n, 2), row by row."""
        cells = np.zeros(self.cells, bool)
        cells[self.cell_of(pixels)] = True
        return cells

    def find(
        self, tensor: Tensor, tracked: NDArray[np.float32], barred: NDArray[np.bool_] | None = None
    ) -> NDArray[np.float32]:
        """The best corner (n, 2) px of each cell without one of ``tracked`` (m, 2) px, the loneliest cells first.

        None at ``barred`` pixels (height, width).

        By the smaller eigenvalue of the structure tensor (Shi and Tomasi, "Good features to track", 1994).
        """
        o = self.options
        occupied = self.occupied(tracked)
        free = (~occupied).take(self._open).nonzero()[0]
        if not len(free):
            return np.empty((0, 2), np.float32)
        xx, xy, yy = (cv2.boxFilter(t, -1, (_SIDE, _SIDE)) for t in tensor)
        difference = cv2.magnitude(cv2.addWeighted(xx, 0.5, yy, -0.5, 0), xy)
        strength = cv2.subtract(cv2.addWeighted(xx, 0.5, yy, 0.5, 0), difference)
        # not beside a track that is there already
        taken = np.zeros(strength.shape, np.uint8)
        u, v = block_of(tracked, self.camera)
        taken[v, u] = 1
        beside = cv2.dilate(taken, np.ones((_SPACING, _SPACING), np.uint8)).view(bool)
        if barred is not None:
            rows, columns = strength.shape
            beside |= barred[: rows * BLOCK : BLOCK, : columns * BLOCK : BLOCK]
        members = self._members.take(free, 0)
        among = strength.ravel().take(members)
        among *= ~beside.ravel().take(members)
        best = among.argmax(axis=1) + np.arange(len(free)) * members.shape[1]
        value, place = among.ravel().take(best), members.ravel().take(best)
        # the match's standard deviation along the weak direction must be bearable
        limit = (o.grey_noise / (o.window_px * _MAX_STD_PX)) ** 2
        found = (value > limit).nonzero()[0]
        # of tracks of one age that run into one another the first stays: let it be the one with fewer about
        held = occupied.reshape(self._rows, self._cols).astype(np.float32)
        around = cv2.boxFilter(held, -1, (3, 3), borderType=cv2.BORDER_REPLICATE).ravel()
        crowd = around.take(self._open).take(free)
        place = place.take(found.take(np.lexsort((-value.take(found), crowd.take(found)))))
        v, u = np.divmod(place, strength.shape[1])
        # in the middle of its window's pixels: a template that is not interpolated has half the bias
        middle = MIDDLE if o.window_px % 2 == 0 else 0.0
        return np.column_stack((u * BLOCK + middle, v * BLOCK + middle)).astype(np.float32)

    def _places(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The cells (c,) in which a window fits anywhere, and their blocks (c, k) where it does.

        Where a cell has fewer than k the last one is repeated.
        """
        columns, rows = self.camera.width // BLOCK, self.camera.height // BLOCK
        y, x = np.divmod(np.arange(rows * columns), columns)
        middle = np.column_stack((x, y)) * BLOCK + MIDDLE
        far_side = np.array((self.camera.width, self.camera.height)) - 1
        inside = np.minimum(middle, far_side - middle).min(axis=1) >= self.options.window_px / 2 + 1
        side = np.array((self._cols, self._rows)) * self.cell_px
        inside &= ((middle >= self._first) & (middle < self._first + side)).all(axis=1)
        place = np.flatnonzero(inside)
        cell = self.cell_of(middle[place].astype(np.float32))
        order = np.argsort(cell, kind="stable")
        place, cell = place[order], cell[order]
        cells, begin, count = np.unique(cell, return_index=True, return_counts=True)
        most = int(count.max(initial=1))
        return cells, place[begin[:, None] + np.minimum(np.arange(most), count[:, None] - 1)]
