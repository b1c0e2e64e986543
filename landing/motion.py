"""Displacement over a known plane between two frames, by linear least squares."""

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def displacement(
    new: Array,
    derotated_old: Array,
    normal: Array,
    whitener: Array,
    weight: Array,
    rotation_std: Array | None = None,
) -> tuple[Array, Array] | None:
    """Displacements over height t (g, 3) and their covariances (g, 3, 3) in units of the whitened noise squared.

    ``new`` is (n, 2), ``derotated_old`` (g, n, 2): the same tracks in g older frames. With the plane and the
    rotation known the exact model is linear in t: for p = (x, y) seen at (x', y') after derotation,
    x' - x = d (x' tz - tx) and y' - y = d (y' tz - ty) with d = n . p; there is no small-motion limit.
    With ``rotation_std`` (3,), over the whitened noise, a small error of the rotation is solved for as well and
    the results are (g, 6) and (g, 6, 6). ``weight`` (n,) leaves out what a robust fit refused. None with fewer
    than six tracks or a singular pattern.
    """
    if np.count_nonzero(weight) < 6:
        return None
    c = whitener * np.sqrt(weight)
    # C of the unit vector along x (its lower half is zero) and along y
    along_x, along_y = c[0], c[1:]
    d = normal[2] + np.dot(new, normal[:2])
    g, n = derotated_old.shape[:2]
    x, y = derotated_old[..., 0], derotated_old[..., 1]
    unknowns = 3 if rotation_std is None else 6
    # rows of the whitened equations, u before v: unknowns, then what is observed
    rows = np.empty((g, unknowns + 1, 2, n))
    rows[:, 0, 0], rows[:, 0, 1] = -d * along_x, 0.0
    rows[:, 1] = -d * along_y
    old, observed = rows[:, 2], rows[:, -1]
    whitened(x, y, c, old)
    if rotation_std is not None:
        # what small turns do: -(xy, 1 + y^2), (1 + x^2, xy), (-y, x)
        np.multiply(old, -y[:, None], out=rows[:, 3])
        rows[:, 3] -= along_y
        np.multiply(old, x[:, None], out=rows[:, 4])
        rows[:, 4, 0] += along_x
        np.multiply(along_y, x[:, None], out=rows[:, 5])
        rows[:, 5, 0] -= along_x * y
    now = np.empty((2, n))
    whitened(new[:, 0], new[:, 1], c, now)
    np.subtract(old, now, out=observed)
    old *= d
    flat = rows.reshape(g, unknowns + 1, 2 * n)
    product = np.matmul(flat, flat.transpose(0, 2, 1))
    matrix = product[:, :unknowns, :unknowns]
    if rotation_std is not None:
        matrix[:, (3, 4, 5), (3, 4, 5)] += rotation_std**-2.0
    inverse = np.empty((g, unknowns, unknowns))
    for k in range(g):
        regular, _ = cv2.invert(matrix[k], inverse[k], cv2.DECOMP_CHOLESKY)
        if not regular:
            return None
    return np.matmul(inverse, product[:, :unknowns, unknowns:])[..., 0], inverse


def whitened(u: Array, v: Array, whitener: Array, out: Array) -> None:
    """C (u, v) of displacements (g, n) or (n,) into ``out`` (g, 2, n) or (2, n); C triangular, as in ``TrackPair``."""
    c11, c12, c22 = whitener
    along_u = out[..., 0, :]
    np.multiply(c11, u, out=along_u)
    along_u += c12 * v
    np.multiply(c22, v, out=out[..., 1, :])
