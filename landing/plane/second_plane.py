"""The other plane that explains the same tracks: without a measured rotation a homography has two decompositions.

A homography R (I - t n^T) has eight degrees of freedom, as many as rotation, displacement and normal together. So the
tracks fit both decompositions alike (Ma, Soatto, Kosecka and Sastry 2004, theorem 5.19); only what is known before
distinguishes them: how far a camera turns, how steep ground is, and that all points lie before it. For a motion without
rotation the second normal points along the motion.
"""

import math

import numpy as np
from numpy.typing import NDArray

from landing.plane.planefit import PlaneFit
from landing.rotations import log_so3
from landing.vision.homography import towards

Array = NDArray[np.float64]

_ALONE = 1e-6
"""Squared singular values that differ by less: there is one decomposition, or the camera has not moved."""
_LEAST_DEPTH = 0.05
"""A normal of this component along the axis, or less, is no ground in view."""


def second_plane(fit: PlaneFit, rotation0: Array, new: Array) -> tuple[Array, float] | None:
    """(a, b) (2,) of the other plane, and its probability against both; None where points would lie behind.

    ``rotation0`` (3, 3) is the rotation that the fit's prior is about, ``new`` (n, 2) the points of the newest frame.
    """
    other = _decomposed(fit.old_from_new @ towards(fit.t, fit.normal), fit.normal)
    if other is None:
        return None
    rotation, slopes = other
    depth = 1.0 - new @ slopes
    if float(depth.min()) <= _LEAST_DEPTH:
        return None
    rotation_std, slope_std = fit.prior.rotation_std, fit.prior.slope_std
    turned = log_so3(rotation0.T @ rotation) / rotation_std
    first = np.sum(np.square(fit.d / rotation_std)) + (fit.a**2 + fit.b**2) / slope_std**2
    second = np.sum(np.square(turned)) + float(slopes @ slopes) / slope_std**2
    # of equal likelihood but for the priors
    return slopes, 1.0 / (1.0 + math.exp(min(max(float(second - first) / 2, -50.0), 50.0)))


def _decomposed(homography: Array, normal: Array) -> tuple[Array, Array] | None:
    """Rotation (3, 3) and slopes (2,) of the decomposition whose normal is farther from ``normal`` (3,)."""
    _, singular, vt = np.linalg.svd(homography)
    h = homography / singular[1]
    s1, _, s3 = np.square(singular / singular[1]).tolist()
    if s1 - s3 < _ALONE or s1 < 1 or s3 > 1:
        return None
    if np.linalg.det(h) < 0:
        h = -h
    v1, v2, v3 = vt
    if np.linalg.det(vt) < 0:
        v3 = -v3
    found = []
    for sign in (1.0, -1.0):
        u = (math.sqrt(1 - s3) * v1 + sign * math.sqrt(s1 - 1) * v3) / math.sqrt(s1 - s3)
        across = np.cross(v2, u)
        before = np.column_stack((v2, u, across))
        after = np.column_stack((h @ v2, h @ u, np.cross(h @ v2, h @ u)))
        found.append((after @ before.T, across if across[2] > 0 else -across))
    unit = normal / np.linalg.norm(normal)
    rotation, other = min(found, key=lambda solution: float(solution[1] @ unit))
    if other[2] <= _LEAST_DEPTH:
        return None
    return np.asarray(rotation, np.float64), np.asarray(-other[:2] / other[2], np.float64)
