"""Displacement over a known plane between two frames, by linear least squares."""

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
    c11, c12, c22 = whitener * np.sqrt(weight)
    d = normal[2] + new @ normal[:2]
    g, n = derotated_old.shape[:2]
    x, y = derotated_old[..., 0], derotated_old[..., 1]
    unknowns = 3 if rotation_std is None else 6
    # rows of the whitened equations, u before v: unknowns, then what is observed
    rows = np.empty((g, unknowns + 1, 2, n))
    rows[:, 0, 0], rows[:, 0, 1] = -d * c11, 0.0
    rows[:, 1, 0], rows[:, 1, 1] = -d * c12, -d * c22
    whitened(x, y, c11, c12, c22, rows[:, 2])
    if rotation_std is not None:
        for k, (ru, rv) in enumerate(rotation_flow(x, y)):
            whitened(ru, rv, c11, c12, c22, rows[:, 3 + k])
    observed = rows[:, -1]
    whitened(new[:, 0], new[:, 1], c11, c12, c22, observed)
    np.subtract(rows[:, 2], observed, out=observed)
    rows[:, 2] *= d
    flat = rows.reshape(g, unknowns + 1, 2 * n)
    product = flat @ flat.transpose(0, 2, 1)
    matrix = product[:, :unknowns, :unknowns]
    if rotation_std is not None:
        matrix[:, (3, 4, 5), (3, 4, 5)] += rotation_std**-2.0
    try:
        inverse: Array = np.linalg.inv(matrix).astype(np.float64, copy=False)
    except np.linalg.LinAlgError:
        return None
    return (inverse @ product[:, :unknowns, unknowns:])[..., 0], inverse


def whitened(u: Array, v: Array, c11: Array, c12: Array, c22: Array, out: Array) -> None:
    """C (u, v) of displacements (g, n) or (n,) into ``out`` (g, 2, n); C triangular, as in ``TrackPair``."""
    np.multiply(c11, u, out=out[:, 0])
    out[:, 0] += c12 * v
    np.multiply(c22, v, out=out[:, 1])


def rotation_flow(x: Array, y: Array) -> tuple[tuple[Array, Array], ...]:
    """Displacement of points (x, y) by small rotations about the camera's x, y and z axes, per radian."""
    xy = x * y
    return (-xy, -1 - y * y), (1 + x * x, xy), (-y, x)
