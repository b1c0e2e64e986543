"""Rotations: matrices named ``a_from_b``, aerospace angles, the exponential map."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]


def matrix_from_euler(roll: float, pitch: float, yaw: float) -> Matrix:
    """ned_from_body (3, 3) of aerospace angles in radians: Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        (
            (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
            (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
            (-sp, cp * sr, cp * cr),
        )
    )


def euler_from_matrix(ned_from_body: Matrix) -> tuple[float, float, float]:
    """Roll, pitch, yaw in radians of ned_from_body (3, 3)."""
    r = ned_from_body
    pitch = math.asin(max(-1.0, min(1.0, -float(r[2, 0]))))
    return math.atan2(r[2, 1], r[2, 2]), pitch, math.atan2(r[1, 0], r[0, 0])


def skew(v: NDArray[np.float64]) -> Matrix:
    """The (3, 3) matrix of the cross product with v (3,)."""
    x, y, z = v
    return np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))


def exp_so3(v: Sequence[float] | NDArray[np.float64]) -> Matrix:
    """Rotation (3, 3) by the rotation vector v (3,) in radians (Rodrigues)."""
    x, y, z = float(v[0]), float(v[1]), float(v[2])
    angle2 = x * x + y * y + z * z
    if angle2 < 1e-16:
        a, b = 1.0, 0.5
    else:
        angle = math.sqrt(angle2)
        a, b = math.sin(angle) / angle, (1 - math.cos(angle)) / angle2
    c = 1 - b * angle2
    return np.array(
        (
            (c + b * x * x, b * x * y - a * z, b * x * z + a * y),
            (b * x * y + a * z, c + b * y * y, b * y * z - a * x),
            (b * x * z - a * y, b * y * z + a * x, c + b * z * z),
        )
    )


def log_so3(rotation: Matrix) -> NDArray[np.float64]:
    """Rotation vector (3,) in radians of a rotation (3, 3); angles below pi."""
    r = rotation
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = r.tolist()
    w = np.array(((zy - yz) / 2, (xz - zx) / 2, (yx - xy) / 2))
    sine, cosine = math.sqrt(float(w @ w)), (xx + yy + zz - 1) / 2
    angle = math.atan2(sine, cosine)
    if sine > 1e-9:
        return w * (angle / sine)
    if cosine > 0:
        return w
    axis = np.sqrt(np.maximum(np.diag(r) + 1, 0) / 2)
    largest = int(np.argmax(axis))
    axis = np.copysign(axis, (r + np.eye(3))[largest])
    return axis * (angle / np.linalg.norm(axis))
