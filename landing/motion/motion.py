"""Tracks over a known plane: the displacement between two frames, by linear least squares."""

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_FEWEST = 6
"""Fewest tracks for a displacement."""


class OverPlane:
    """What a displacement over height and a small error of the rotation do to the tracks of a known plane.

    With the plane and the rotation known the exact model is linear in the displacement t: for p = (x, y) seen at
    (x', y') in an older frame after derotation, x' - x = d (x' tz - tx) and y' - y = d (y' tz - ty) with d = n . p;
    there is no small-motion limit. Equations are whitened.
    """

    def __init__(
        self, new: Array, derotated_old: Array, normal: Array, whitener: Array, turns: bool = False
    ) -> None:
        """``new`` is (n, 2), ``derotated_old`` (g, n, 2): the same tracks in g older frames; ``normal`` (3,).

        ``whitener`` (3, n) as in ``TrackPair``. With ``turns`` an error of the rotation is solved for as well, what it
        does worked out at the newest places: off by the error times the flow, below the tracks' noise.
        """
        g, n = derotated_old.shape[:2]
        self._gaps, self._fixed = g, 5 if turns else 2
        # unit displacements along x and y, unit turns, those along z over each gap, what is observed over each gap
        rows = self._rows = np.empty((self._fixed + 2 * g, 2, n))
        x, y = new[:, 0], new[:, 1]
        c11, along_y = whitener[0], whitener[1:]
        d = np.dot(new, normal[:2])
        d += normal[2]
        negative = -d
        np.multiply(c11, negative, out=rows[0, 0])
        rows[0, 1] = 0.0
        np.multiply(along_y, negative, out=rows[1])
        now = along_y * y
        now[0] += c11 * x
        if turns:
            # -(xy, 1 + y^2), (1 + x^2, xy), (-y, x)
            np.multiply(now, -y, out=rows[2])
            rows[2] -= along_y
            np.multiply(now, x, out=rows[3])
            rows[3, 0] += c11
            np.multiply(along_y, x, out=rows[4])
            rows[4, 0] -= c11 * y
        along_z, observed = rows[self._fixed : -g], rows[-g:]
        np.multiply(along_y, derotated_old[:, None, :, 1], out=observed)
        observed[:, 0] += c11 * derotated_old[..., 0]
        np.multiply(observed, d, out=along_z)
        observed -= now

    def displacement(
        self, weight: Array, rotation_std: Array | None = None, chosen: NDArray[np.bool_] | None = None
    ) -> tuple[Array, Array] | None:
        """Displacements over height t (g, 3) and their covariances (g, 3, 3) in units of the whitened noise squared.

        With ``turns`` an error of the rotation follows, (g, 6) and (g, 6, 6), under a prior of ``rotation_std`` (3,)
        over the whitened noise. ``weight`` (n,) leaves out what a robust fit refused, ``chosen`` (n,) what the older
        frames did not see. None with fewer than six tracks or a singular pattern.
        """
        rows = self._rows
        if chosen is not None:
            rows, weight = rows.compress(chosen, -1), weight.compress(chosen)
        if np.count_nonzero(weight) < _FEWEST:
            return None
        product = np.dot((rows * weight).reshape(len(rows), -1), rows.reshape(len(rows), -1).T)
        across, down, observed = _places(self._fixed, self._gaps)
        matrix = product[across, down]
        if rotation_std is not None:
            matrix.reshape(self._gaps, -1)[:, 21::7] += rotation_std**-2.0
        inverse = np.empty_like(matrix)
        for one, out in zip(matrix, inverse, strict=True):
            regular, _ = cv2.invert(one, out, cv2.DECOMP_CHOLESKY)
            if not regular:
                return None
        return np.matmul(inverse, product[down, observed])[..., 0], inverse

    def against(self, motion: Array, gap: NDArray[np.intp]) -> tuple[Array, Array]:
        """What each track's own displacement over the plane is and what of its way that leaves, whitened (2, n).

        ``motion`` (g, 6) is what ``displacement`` found; ``gap`` (n,) the number of the older frame for each track.
        """
        n = self._rows.shape[-1]
        both = self._rows[self._fixed :].reshape(2, -1)
        place = gap * (2 * n)
        place += np.arange(n)
        z, observed = both.take(np.concatenate((place, place + n)), 1).reshape(2, 2, n)
        own = motion.T.take(gap, 1)
        along = self._rows[0] * own[0]
        along += self._rows[1] * own[1]
        z *= own[2]
        along += z
        observed -= along
        turned = self._rows[2 : self._fixed] * own[3:, None]
        observed -= turned.sum(axis=0)
        return along, observed


@cache
def _places(fixed: int, gaps: int) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of each gap's matrix in the product of all rows, and the columns of what is observed."""
    along_z = fixed + np.arange(gaps)[:, None]
    known = np.tile(np.arange(fixed), (gaps, 1))
    order = np.concatenate((known[:, :2], along_z, known[:, 2:]), axis=1)
    return order[:, None, :], order[:, :, None], (along_z + gaps)[:, :, None]
