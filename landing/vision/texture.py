"""Information of the texture in a window about a match: its covariance, and its bias under a deformation."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from landing.options import TrackingOptions
from landing.vision.camera import CameraModel

Array = NDArray[np.float64]
Image = NDArray[Any]
Tensor = tuple[Image, Image, Image]
"""xx, xy, yy of the structure tensor, one value a block."""

BLOCK = 2
"""The structure tensor is that of blocks of so many pixels a side."""
MIDDLE = (BLOCK - 1) / 2


def structure_tensor(image: Image) -> Tensor:
    """Means of gx^2, gx gy and gy^2 over blocks of 2 x 2 pixels, grey levels squared per pixel squared."""
    height, width = (side // BLOCK * BLOCK for side in image.shape)
    gx, gy = cv2.spatialGradient(image[:height, :width])
    scale = 1 / 64  # the Sobel weights add up to eight
    size = (width // BLOCK, height // BLOCK)
    products = (cv2.multiply(a, b, scale=scale, dtype=cv2.CV_32F) for a, b in ((gx, gx), (gx, gy), (gy, gy)))
    xx, xy, yy = (cv2.resize(product, size, interpolation=cv2.INTER_AREA) for product in products)
    return xx, xy, yy


def block_of(pixels: NDArray[np.float32], camera: CameraModel) -> NDArray[np.int64]:
    """Column and row (2, n) of the structure tensor's block that each pixel (n, 2) lies in."""
    last = (camera.width // BLOCK - 1, camera.height // BLOCK - 1)
    return ((pixels + 0.5) // BLOCK).astype(np.int64).clip(0, last).T


class Texture:
    """Sums of the structure tensor over Lucas-Kanade's window."""

    def __init__(self, camera: CameraModel, options: TrackingOptions) -> None:
        self.camera, self.options = camera, options
        # the window's half side in blocks; those at its ends count by what of them lies inside
        half = options.window_px / (2 * BLOCK)
        reach = int(np.ceil(half - 0.5))
        step = np.arange(-reach, reach + 1)
        inside = np.clip(half + 0.5 - np.abs(step), 0.0, 1.0)
        weight = np.outer(inside, inside).ravel()
        weight /= weight.sum()
        down, across = (part.ravel() for part in np.meshgrid(step, step, indexing="ij"))
        self._columns, self._rows = camera.width // BLOCK, camera.height // BLOCK
        self._reach, self._window = reach, down * self._columns + across
        self._places = np.empty((options.max_features, len(weight)), np.intp)
        self._sums = np.column_stack((weight, BLOCK * across * weight, BLOCK * down * weight)).astype(
            np.float32
        )

    def about(self, tensor: Tensor, pixels: NDArray[np.float32]) -> tuple[Array, Array]:
        """``whitener`` (3, n) as in ``TrackPair`` and ``bias`` (2, 4, n) px for the windows about pixels (n, 2).

        Where a patch deforms by A, a search for a shift alone ends J^-1 sum(g g^T A x) off, x from the window's middle,
        g the gradient, J = sum(g g^T): the normal equations of Lucas and Kanade with A x in the place of a noise. That
        is nothing when the texture is spread evenly and most of A x when it lies at one side. ``bias`` is what each
        element of A does, row by row.
        """
        x, y = block_of(pixels, self.camera)
        edge = self._reach
        x, y = x.clip(edge, self._columns - 1 - edge), y.clip(edge, self._rows - 1 - edge)
        # in memory that is there already: fresh pages cost more than the sums
        places = self._places[: len(x)]
        np.add((y * self._columns + x)[:, None], self._window, out=places)
        total, along_x, along_y = np.stack(
            [np.dot(t.ravel().take(places), self._sums).T for t in tensor], 1
        ).astype(np.float64)
        return self.camera.whitener(self._whitener_px(total), pixels), self._bias(total, along_x, along_y)

    def _whitener_px(self, tensor: Array) -> Array:
        o = self.options
        xx, xy, yy = tensor * (o.window_px / o.grey_noise) ** 2
        # the covariance is grey noise through the texture, J^-1, and what no texture helps against (pixel locking):
        # (J^-1 + f I)^-1 = (J + f det J I) / (1 + f tr J + f^2 det J)
        floor = o.match_std_px**2
        determinant = np.maximum(xx * yy - xy * xy, 1e-9)
        whole = 1 + floor * (xx + yy) + floor**2 * determinant
        determinant *= floor
        ixx, iyy = (xx + determinant) / whole, (yy + determinant) / whole
        out = np.empty_like(tensor)
        c11 = np.sqrt(ixx, out=out[0])
        c12 = np.divide(xy / whole, c11, out=out[1])
        np.sqrt(np.maximum(iyy - c12 * c12, 1e-12), out=out[2])
        return out

    def _bias(self, tensor: Array, along_x: Array, along_y: Array) -> Array:
        # along an edge nothing is known: there a pixel of doubt holds it
        doubt = (self.options.grey_noise / self.options.window_px) ** 2
        xx, xy, yy = tensor[0] + doubt, tensor[1], tensor[2] + doubt
        # sum(g g^T A x) for each element of A
        by_x = np.stack((along_x[0], along_y[0], along_x[1], along_y[1]))
        by_y = np.stack((along_x[1], along_y[1], along_x[2], along_y[2]))
        return np.stack((yy * by_x - xy * by_y, xx * by_y - xy * by_x)) / (xx * yy - xy * xy)
