"""What is not known of the lens: a calibration's errors move every place in the picture, alike in every frame.

An error of the intrinsics with covariance S = sum of e_k e_k^T (its scaled eigenvectors) moves an undistorted point by
the sum of xi_k f_k(pixel), f_k the difference between undistorting with e_k added and without, xi_k of unit variance.
A flow is then wrong by its own share, however long the baseline is, and whatever number of frames says the same.
"""

import numpy as np
from numpy.typing import NDArray

from landing.vision.camera import CameraModel

Array = NDArray[np.float64]

CELL_PX = 8
"""The fields are smooth: one value a cell of this size."""
_STEP = 0.1
"""The share of a mode by which its field is measured: small, as the fields are linear then."""
_LEAST = 1e-5
"""Modes that move no place by more than this, normalised, are left out."""
FOCAL_SHARE, ASPECT_SHARE = 0.003, 0.001
"""Doubt about the focal length, and about the ratio of both, as shares."""
CENTRE_SHARE = 0.0025
"""Doubt about the principal point, over the picture's width."""
RADIAL, TANGENTIAL = 0.012, 2e-4
"""Doubt about k1, about p1 and p2. All of these were chosen on recorded flights, not measured on calibrations."""


def usual_covariance(camera: CameraModel) -> Array:
    """Covariance of (fx, fy, cx, cy, distortion...) of a usual calibration by a board, where none is stated.

    Errors of k1 are mostly balanced by k2 at the picture's corner, as a board that covers the picture leaves them.
    """
    count = 4 + len(camera.distortion)
    fx, fy = camera.matrix[0, 0], camera.matrix[1, 1]
    corner = np.array(((0.0, 0.0), (camera.width - 1.0, camera.height - 1.0)))
    radius2 = float(np.square(camera.undistort(corner)).sum(axis=1).mean())
    modes = np.zeros((6 if camera.equidistant else 8, count))
    modes[0, :2] = FOCAL_SHARE * fx, FOCAL_SHARE * fy
    modes[1, :2] = ASPECT_SHARE * fx / 2, -ASPECT_SHARE * fy / 2
    modes[2, 2] = modes[3, 3] = CENTRE_SHARE * camera.width
    modes[4, 4:6] = RADIAL, -RADIAL / max(radius2, 1e-6)
    modes[5, 4] = RADIAL / 4
    if not camera.equidistant:
        modes[6, 6] = modes[7, 7] = TANGENTIAL
    return np.asarray(modes.T @ modes, np.float64)


class LensDoubt:
    """The fields f_k on a grid over the picture."""

    def __init__(self, camera: CameraModel) -> None:
        """``camera.intrinsics_covariance`` is that of (fx, fy, cx, cy, distortion...); None: the usual one."""
        covariance = camera.intrinsics_covariance
        if covariance is None:
            covariance = usual_covariance(camera)
        self._columns = -(-camera.width // CELL_PX)
        rows = -(-camera.height // CELL_PX)
        x, y = np.meshgrid(np.arange(self._columns), np.arange(rows))
        centres = (np.column_stack((x.ravel(), y.ravel())) + 0.5) * CELL_PX - 0.5
        pixels = np.minimum(centres, (camera.width - 1.0, camera.height - 1.0))
        variance, axes = np.linalg.eigh(_scaled(covariance))
        scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        there, fields = camera.undistort(pixels), []
        for k in range(len(variance)):
            if variance[k] > 0:
                mode = axes[:, k] * np.sqrt(variance[k]) * scale
                moved = (camera.changed(_STEP * mode).undistort(pixels) - there) / _STEP
                if np.abs(moved).max() > _LEAST:
                    fields.append(moved)
        self.modes = len(fields)
        """How many unknowns there are, each of unit variance."""
        self._fields = np.concatenate(fields, axis=1) if fields else np.zeros((len(pixels), 0))

    def moves(self, pixels: NDArray[np.floating]) -> Array:
        """f_k (modes, n, 2) at pixels (n, 2), normalised units per sigma."""
        # of places that are not known the first cell: fmax takes the number beside NaN
        cell = (np.fmax(pixels, 0.0) * (1 / CELL_PX)).astype(np.intp)
        found = self._fields.take(cell[:, 1] * self._columns + cell[:, 0], 0)
        return found.reshape(len(pixels), self.modes, 2).transpose(1, 0, 2)


def _scaled(covariance: Array) -> Array:
    """The correlations, zero where there is no variance."""
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    inverse = np.divide(1.0, std, out=np.zeros_like(std), where=std > 0)
    return np.asarray(covariance * inverse[:, None] * inverse, np.float64)
