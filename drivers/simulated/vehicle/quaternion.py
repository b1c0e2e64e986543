"""Unit quaternions (w, x, y, z) as plain tuples, for dynamics stepped hundreds of times a second."""

import math

from drivers.quaternions import angles_of

Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """a then b in a's axes: the rotation chain a_from_b."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


def normalised(q: Quaternion) -> Quaternion:
    """The same direction with length 1."""
    n = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return (q[0] / n, q[1] / n, q[2] / n, q[3] / n)


def conjugate(q: Quaternion) -> Quaternion:
    """The inverse rotation."""
    return (q[0], -q[1], -q[2], -q[3])


def rotate(q: Quaternion, v: Vector) -> Vector:
    """``v`` given in the axes right of the chain, in the axes left of it."""
    w, x, y, z = q
    tx, ty, tz = 2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])
    return (
        v[0] + w * tx + y * tz - z * ty,
        v[1] + w * ty + z * tx - x * tz,
        v[2] + w * tz + x * ty - y * tx,
    )


def from_euler(roll: float, pitch: float, yaw: float) -> Quaternion:
    """ned_from_body of the aerospace angles (yaw, then pitch, then roll)."""
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def to_euler(q: Quaternion) -> Vector:
    """Roll, pitch, yaw of ned_from_body."""
    return angles_of(*q)


def to_matrix(q: Quaternion) -> tuple[Vector, Vector, Vector]:
    """The rotation matrix's rows."""
    w, x, y, z = q
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


def from_thrust_and_yaw(thrust: Vector, yaw: float) -> Quaternion:
    """The attitude with heading ``yaw`` whose body -z points along ``thrust`` (NED, not zero)."""
    n = math.sqrt(thrust[0] ** 2 + thrust[1] ** 2 + thrust[2] ** 2)
    zx, zy, zz = -thrust[0] / n, -thrust[1] / n, -thrust[2] / n
    c, s = math.cos(yaw), math.sin(yaw)
    # In the heading's axes body z is (sin pitch cos roll, -sin roll, cos pitch cos roll).
    ahead, aside = c * zx + s * zy, -s * zx + c * zy
    roll = -math.asin(min(1.0, max(-1.0, aside)))
    return from_euler(roll, math.atan2(ahead, zz), yaw)
