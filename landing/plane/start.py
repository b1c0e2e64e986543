"""Where the plane fit starts without a plane before: a homography of the tracks alone."""

import numpy as np
from numpy.typing import NDArray

from landing.vision.homography import robust

Array = NDArray[np.float64]


def start_from_homography(new: Array, old: Array, old_from_new: Array) -> tuple[Array, float, float] | None:
    """(t, a, b) from the rank-1 split of a robust homography of the derotated tracks.

    The homography new -> derotated old is (I - t n^T) up to scale; its middle singular value is the scale.
    """
    p = np.column_stack((new, np.ones(len(new))))
    q = np.column_stack((old, np.ones(len(old)))) @ old_from_new
    if (q[:, 2] <= 1e-6).any():
        return None
    q = q / q[:, 2:]
    h = robust(p[:, :2], q[:, :2])
    if h is None:
        return None
    singular = np.linalg.svd(h, compute_uv=False)
    if singular[1] < 1e-9:
        return None
    h = h / singular[1]
    if np.linalg.det(h) < 0:
        h = -h
    u, s, vt = np.linalg.svd(np.eye(3) - h)
    n = vt[0]
    if abs(n[2]) < 1e-3 * np.linalg.norm(n[:2]) or abs(n[2]) < 1e-6:
        return u[:, 0] * s[0], 0.0, 0.0
    t = u[:, 0] * s[0] * n[2]
    a, b = -n[0] / n[2], -n[1] / n[2]
    limit = 4.0
    return t, float(np.clip(a, -limit, limit)), float(np.clip(b, -limit, limit))
