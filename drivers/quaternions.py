"""Attitude quaternions (body to NED) as roll, pitch and yaw."""

import math

Euler = tuple[float, float, float]


def euler_of(w: float, x: float, y: float, z: float) -> Euler | None:
    """Roll, pitch and yaw (rad) of what an autopilot sends or logs, of about unit length; None where it is not."""
    norm = math.hypot(w, x, y, z)
    if not 0.9 < norm < 1.1:  # of NaN too
        return None
    return angles_of(w / norm, x / norm, y / norm, z / norm)


def angles_of(w: float, x: float, y: float, z: float) -> Euler:
    """Roll, pitch and yaw (rad) of a quaternion of unit length."""
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
    return roll, pitch, math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
