"""Homographies of normalised image points: least squares, a robust start, and warps of whole images.

A homography ``new_from_old`` (3, 3) takes homogeneous points (x, y, 1) of one image to another up to scale (Hartley
and Zisserman, Multiple View Geometry, chapter 4). Two views of a plane are related by one. Points are (n, 2),
normalised (Z = 1).
"""

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from landing.vision.camera import CameraModel

Points = NDArray[np.float64]
Array = NDArray[np.float64]

_NO_SECOND_MAP = np.empty((0, 0), np.float32)

_STEP = 8
"""Pixels between the nodes of a warp; between them the map is interpolated linearly."""
_ALL = slice(None)


def apply(h: Array, points: Points) -> Points:
    """Points (n, 2) transformed by the homography ``h`` (3, 3)."""
    if not len(points):
        return np.empty((0, 2))
    return np.asarray(cv2.perspectiveTransform(points[:, None], h)[:, 0], np.float64)


def towards(t: Sequence[float] | Array, normal: Sequence[float] | Array) -> Array:
    """I - t n^T (3, 3), the homography of a plane: normal n = (-a, -b, 1), camera displacement over distance t (3,)."""
    (x, y, z), (a, b, c) = t, normal
    return np.array(((1 - x * a, -x * b, -x * c), (-y * a, 1 - y * b, -y * c), (-z * a, -z * b, 1 - z * c)))


def least_squares(p: Points, q: Points) -> Array | None:
    """Least-squares homography (3, 3) from p to q (n, 2), with its last element 1; None where undetermined.

    The points must be centred near the origin and of size about one, as normalised image points are.
    """
    x, y, u, v = p[:, 0], p[:, 1], q[:, 0], q[:, 1]
    n = len(p)
    rows = np.zeros((9, 2, n))
    rows[0, 0], rows[1, 0], rows[2, 0] = x, y, 1.0
    rows[3:6, 1] = rows[:3, 0]
    rows[6:8, 0] = p.T * -u
    rows[6:8, 1] = p.T * -v
    rows[8] = q.T
    flat = rows.reshape(9, -1)
    product = flat[:8] @ flat.T
    product[range(8), range(8)] += 1e-12
    solved, h = cv2.solve(product[:, :8].copy(), product[:, 8:].copy(), flags=cv2.DECOMP_CHOLESKY)
    return np.append(h[:, 0], 1.0).reshape(3, 3) if solved else None


def robust(p: Points, q: Points, hypotheses: int = 96, seed: int = 1) -> Array | None:
    """Homography (3, 3) from p to q (n, 2) in spite of outliers; None where the points determine none.

    Least median of squares: of ``hypotheses`` random samples of four points, the homography with the smallest median
    squared error, then two refits to the points within six medians. ``seed`` makes it repeatable.
    """
    n = len(p)
    rng = np.random.default_rng(seed)
    pick = rng.random((hypotheses, n)).argpartition(3, axis=1)[:, :4]
    x, y, u, v = p[pick, 0], p[pick, 1], q[pick, 0], q[pick, 1]
    rows = np.zeros((hypotheses, 8, 8))
    rows[:, 0::2, 0], rows[:, 0::2, 1], rows[:, 0::2, 2] = x, y, 1
    rows[:, 1::2, 3], rows[:, 1::2, 4], rows[:, 1::2, 5] = x, y, 1
    rows[:, 0::2, 6], rows[:, 0::2, 7] = -u * x, -u * y
    rows[:, 1::2, 6], rows[:, 1::2, 7] = -v * x, -v * y
    right = np.empty((hypotheses, 8, 1))
    right[:, 0::2, 0], right[:, 1::2, 0] = u, v
    rows[:, range(8), range(8)] += 1e-12
    usable = np.abs(np.linalg.det(rows)) > 1e-24
    if not usable.any():
        return None
    h = np.linalg.solve(rows[usable], right[usable])[..., 0]
    h = np.concatenate((h, np.ones((len(h), 1))), axis=1).reshape(-1, 3, 3)
    ones = np.ones((n, 1))
    out = np.concatenate((p, ones), axis=1) @ h.transpose(0, 2, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        error = ((out[..., :2] / out[..., 2:] - q) ** 2).sum(axis=2)
    error = np.where(np.isfinite(error), error, np.inf)
    score = np.partition(error, n // 2, axis=1)[:, n // 2]
    best = int(score.argmin())
    estimate, e = h[best], error[best]
    for _ in range(2):
        inside = e <= max(float(np.median(e)) * 6.0, 1e-12)
        if int(inside.sum()) < 6:
            break
        refit = least_squares(p[inside], q[inside])
        if refit is None:
            break
        out1 = np.concatenate((p, ones), axis=1) @ refit.T
        with np.errstate(divide="ignore", invalid="ignore"):
            e1 = ((out1[:, :2] / out1[:, 2:] - q) ** 2).sum(axis=1)
        if not np.isfinite(e1).all() or np.median(e1) > np.median(e) * 1.5:
            break
        estimate, e = refit, e1
    return estimate


def stretch(h: Array) -> float:
    """How much ``h`` deforms a small pattern at the image centre: its largest change of length over its size.

    The larger singular value of the Jacobian at the origin minus the identity; 0 for a pure shift.
    """
    (a, b, x), (c, d, y), (p, q, w) = h.tolist()
    a, b, c, d = (a - x / w * p) / w - 1, (b - x / w * q) / w, (c - y / w * p) / w, (d - y / w * q) / w - 1
    # the larger singular value of a (2, 2) matrix
    return (math.hypot(a + d, c - b) + math.hypot(a - d, c + b)) / 2


class Warp:
    """Warps an image of a plane to the viewpoint of another image, including the lens distortion."""

    def __init__(self, camera: CameraModel) -> None:
        self.camera = camera
        columns, rows = -(-camera.width // _STEP) + 2, -(-camera.height // _STEP) + 2
        # the nodes lie in the middle of blocks, one block beyond the image on every side
        x = np.arange(columns) * _STEP - _STEP / 2 - 0.5
        y = np.arange(rows) * _STEP - _STEP / 2 - 0.5
        nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        self._nodes = camera.undistort(nodes).reshape(rows, columns, 2)

    def __call__(self, image: NDArray[np.uint8], new_from_old: Array) -> NDArray[np.uint8]:
        """The old ``image`` (height, width) as seen in the new view; outside of it its border is mirrored."""
        old_from_new = np.linalg.inv(new_from_old).astype(np.float64, copy=False)
        places = self.places(old_from_new)
        warped = cv2.remap(image, places, _NO_SECOND_MAP, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101)
        return np.asarray(warped, np.uint8)

    def places(
        self, other_from_this: Array, rows: slice = _ALL, columns: slice = _ALL
    ) -> NDArray[np.float32]:
        """Pixel coordinates (rows, columns, 2), x and y, in another view of this view's pixels.

        They are exact at the nodes every ``_STEP`` pixels and interpolated linearly between them.
        """
        (top, bottom, first_row, last_row), (left, right, first, last) = (
            _span(part, size) for part, size in ((rows, self.camera.height), (columns, self.camera.width))
        )
        nodes = self._nodes[first_row : last_row + 1, first : last + 1]
        coarse = self.camera.project(apply(other_from_this, nodes.reshape(-1, 2))).astype(np.float32)
        size = (nodes.shape[1] * _STEP, nodes.shape[0] * _STEP)
        full = cv2.resize(coarse.reshape(nodes.shape), size, interpolation=cv2.INTER_LINEAR)
        # node k lies in the middle of the block of pixels that begins at (k - 1) times the step
        y, x = top - (first_row - 1) * _STEP, left - (first - 1) * _STEP
        return np.asarray(full[y : y + bottom - top, x : x + right - left], np.float32)


def _span(part: slice, size: int) -> tuple[int, int, int, int]:
    """Beginning and end of some of ``size`` pixels, and the first and the last node about them."""
    begin, end, _ = part.indices(size)
    return begin, end, begin // _STEP, (end - 1) // _STEP + 2
