"""From the plane in the camera frame to the surface in the world: inclination, bearing, per-axis slopes."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

NAN = math.nan
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Surface:
    """The surface relative to gravity, degrees; NaN without an attitude.

    ``pitch`` and ``roll`` are the slope angles with the vehicle's angle subtracted per axis: positive pitch
    rises ahead, positive roll falls to the right, as the vehicle's own angles that would match the surface.
    """

    inclination_deg: float = NAN
    inclination_std_deg: float = NAN
    bearing_deg: float = NAN
    pitch_deg: float = NAN
    roll_deg: float = NAN


def surface_in_ned(
    a: float, b: float, covariance: Array, ned_from_camera: Array, attitude_std_rad: float
) -> tuple[float, float, float]:
    """Inclination, its standard deviation and the downhill bearing, in degrees.

    The standard deviation is the root of the expected squared error: near level both axes count, because any
    error tilts the normal away from the vertical; on a slope only the error along the slope counts.
    """
    n = np.array((-a, -b, 1.0))
    down = ned_from_camera @ n
    down /= math.sqrt(float(n @ n))
    if down[2] < 0:
        down = -down
    horizontal = math.hypot(down[0], down[1])
    inclination = math.atan2(horizontal, down[2])
    # error of the unit normal, in ned: the part along and across the slope
    length2 = float(n @ n)
    jacobian = np.array(((-1.0, 0.0), (0.0, -1.0), (0.0, 0.0))) / math.sqrt(length2)
    jacobian = jacobian - np.outer(n, n @ jacobian) / length2
    spread = ned_from_camera @ (jacobian @ covariance @ jacobian.T) @ ned_from_camera.T
    along = np.array((down[0], down[1])) / horizontal if horizontal > 1e-9 else np.array((1.0, 0.0))
    across = np.array((-along[1], along[0]))
    var_attitude = attitude_std_rad**2
    tilt = spread[:2, :2]
    cos2 = max(down[2] ** 2, 1e-6)
    var_along = float(along @ tilt @ along) / cos2 + var_attitude
    var_across = float(across @ tilt @ across) + var_attitude
    # E[(|s + e| - s)^2] between the two limits: s = 0 gives both variances, large s the one along the slope. What is
    # measured is |s + e|: near level it is mostly error, and no evidence of a slope.
    slope2 = max(horizontal**2 - var_along - var_across, 0.0)
    share = (var_across / (var_across + slope2)) ** 2 if var_across > 0 else 0.0
    std = math.sqrt(var_along + share * var_across)
    return math.degrees(inclination), math.degrees(std), math.degrees(math.atan2(-down[1], -down[0])) % 360


def slopes_in_body(a: float, b: float, body_from_camera: Array) -> tuple[float, float]:
    """Slope angles (rad) of the surface along body x and body y: dz/dx and dz/dy of the plane, arc tangent."""
    n = body_from_camera @ np.array((-a, -b, 1.0))
    return math.atan2(-n[0], n[2]), math.atan2(-n[1], n[2])


def surface(
    a: float,
    b: float,
    covariance: Array,
    ned_from_camera: Array | None,
    body_from_camera: Array,
    roll: float,
    pitch: float,
    attitude_std_rad: float,
) -> Surface:
    """All of the above for one plane; NaN where the attitude is unknown."""
    if ned_from_camera is None or not math.isfinite(a + b):
        return Surface()
    inclination, std, bearing = surface_in_ned(a, b, covariance, ned_from_camera, attitude_std_rad)
    along_x, along_y = slopes_in_body(a, b, body_from_camera)
    # depth that grows ahead by tan(along_x) is ground that falls ahead; a nose-up pitch alone does the same
    return Surface(inclination, std, bearing, math.degrees(-along_x + pitch), math.degrees(along_y + roll))
