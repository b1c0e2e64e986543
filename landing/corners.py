"""Shi-Tomasi corners spread over the view by a grid, and what the texture about a place tells of a match."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from landing.camera import CameraModel
from landing.options import TrackingOptions

Points = NDArray[np.float64]
Image = NDArray[Any]
Tensor = tuple[Image, Image, Image]
"""xx, xy, yy of the structure tensor, each of half the image's size."""

_BLOCK = 2
"""Corners are looked for in blocks of so many pixels a side."""
_MIDDLE = (_BLOCK - 1) / 2
_CELLS = 1.06
"""Cells of the grid over the tracks that are wanted."""


class Corners:
    """Finds corners in the empty cells of a grid over images of one size."""

    def __init__(self, camera: CameraModel, options: TrackingOptions) -> None:
        self.camera, self.options = camera, options
        # about as many cells as tracks: more would leave the faint ones empty, fewer leave tracks unused
        cell = camera.width * camera.height / (_CELLS * options.max_features)
        self.cell_px = max(8, round(cell**0.5))
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

    def cell_of(self, pixels: NDArray[np.float32]) -> NDArray[np.int64]:
        """The grid's cell, row by row, of each pixel (n, 2) of the image."""
        column, row = pixels.astype(np.int64).T
        return self._cell.take(row * self.camera.width + column)

    def occupied(self, pixels: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Which cells hold one of the pixels (n, 2), row by row."""
        cells = np.zeros(self._rows * self._cols, bool)
        cells[self.cell_of(pixels)] = True
        return cells

    def find(self, tensor: Tensor, tracked: NDArray[np.float32]) -> NDArray[np.float32]:
        """The best corner (n, 2) px of each cell without one of ``tracked`` (m, 2) px, the loneliest cells first.

        By the smaller eigenvalue of the structure tensor (Shi and Tomasi, "Good features to track", 1994).
        """
        o = self.options
        occupied = self.occupied(tracked)
        free = (~occupied).take(self._open).nonzero()[0]
        if not len(free):
            return np.empty((0, 2), np.float32)
        side = max(1, o.corner_px // 2)
        xx, xy, yy = (cv2.boxFilter(t, -1, (side, side)) for t in tensor)
        difference = cv2.magnitude(cv2.addWeighted(xx, 0.5, yy, -0.5, 0), xy)
        strength = cv2.subtract(cv2.addWeighted(xx, 0.5, yy, 0.5, 0), difference)
        # not beside a track that is there already
        taken = np.zeros(strength.shape, np.uint8)
        u, v = self._blocks(tracked).T
        taken[v, u] = 1
        side = 2 * (o.spacing_px // 2) + 1
        beside = cv2.dilate(taken, np.ones((side, side), np.uint8)).view(bool)
        members = self._members.take(free, 0)
        among = strength.ravel().take(members)
        among *= ~beside.ravel().take(members)
        best = among.argmax(axis=1)[:, None]
        value, place = np.take_along_axis(among, best, 1)[:, 0], np.take_along_axis(members, best, 1)[:, 0]
        # the match's standard deviation along the weak direction must be bearable
        limit = (o.grey_noise / (o.window_px * o.corner_max_std_px)) ** 2
        found = (value > limit).nonzero()[0]
        # where the fewest tracks are about: strong texture would take all places, and faint things hold none
        held = occupied.reshape(self._rows, self._cols).astype(np.float32)
        around = cv2.boxFilter(held, -1, (3, 3), borderType=cv2.BORDER_REPLICATE).ravel()
        crowd = around.take(self._open).take(free)
        place = place.take(found.take(np.lexsort((-value.take(found), crowd.take(found)))))
        v, u = np.divmod(place, strength.shape[1])
        # in the middle of its window's pixels: a template that is not interpolated has half the bias
        middle = _MIDDLE if o.window_px % 2 == 0 else 0.0
        return np.column_stack((u * _BLOCK + middle, v * _BLOCK + middle)).astype(np.float32)

    def whitener(self, tensor: Tensor, pixels: NDArray[np.float32]) -> Points:
        """c11, c12, c22 (3, n) as in ``TrackPair``, from the texture in the windows about pixels (n, 2)."""
        o = self.options
        side = max(1, o.window_px // 2)
        x, y = self._blocks(pixels).T
        place = y * tensor[0].shape[1] + x
        around = np.array(
            [cv2.boxFilter(t, -1, (side, side)).ravel().take(place) for t in tensor], np.float64
        )
        around *= (o.window_px / o.grey_noise) ** 2
        xx, xy, yy = around
        # the covariance is grey noise through the texture, J^-1, and what no texture helps against (pixel locking):
        # (J^-1 + f I)^-1 = (J + f det J I) / (1 + f tr J + f^2 det J)
        floor = o.match_std_px**2
        determinant = np.maximum(xx * yy - xy * xy, 1e-9)
        whole = 1 + floor * (xx + yy) + floor**2 * determinant
        determinant *= floor
        ixx, iyy = (xx + determinant) / whole, (yy + determinant) / whole
        out = np.empty((3, len(pixels)))
        c11 = np.sqrt(ixx, out=out[0])
        c12 = np.divide(xy / whole, c11, out=out[1])
        np.sqrt(np.maximum(iyy - c12 * c12, 1e-12), out=out[2])
        out *= self.camera.focal_px
        return out

    def _blocks(self, pixels: NDArray[np.float32]) -> NDArray[np.int64]:
        """Column and row (n, 2) of the structure tensor's block that each pixel (n, 2) lies in."""
        last = (self.camera.width // _BLOCK - 1, self.camera.height // _BLOCK - 1)
        return ((pixels + 0.5) // _BLOCK).astype(np.int64).clip(0, last)

    def _places(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The cells (c,) in which a window fits anywhere, and their blocks (c, k) where it does.

        Where a cell has fewer than k the last one is repeated.
        """
        columns, rows = self.camera.width // _BLOCK, self.camera.height // _BLOCK
        y, x = np.divmod(np.arange(rows * columns), columns)
        middle = np.column_stack((x, y)) * _BLOCK + _MIDDLE
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


def structure_tensor(image: Image) -> Tensor:
    """Means of gx^2, gx gy and gy^2 over blocks of 2 x 2 pixels, grey levels squared per pixel squared."""
    height, width = (side // _BLOCK * _BLOCK for side in image.shape)
    gx, gy = cv2.spatialGradient(image[:height, :width])
    scale = 1 / 64  # the Sobel weights add up to eight
    size = (width // _BLOCK, height // _BLOCK)
    products = (cv2.multiply(a, b, scale=scale, dtype=cv2.CV_32F) for a, b in ((gx, gx), (gx, gy), (gy, gy)))
    xx, xy, yy = (cv2.resize(product, size, interpolation=cv2.INTER_AREA) for product in products)
    return xx, xy, yy
