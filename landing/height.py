"""Height from the velocity that the autopilot knows and the ventral flow that the camera sees: h = V / omega."""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def height(
    velocity: Array, velocity_std: float, omega: Array, omega_std: Array, max_relative_std: float
) -> tuple[float, float]:
    """Distance to the surface along the optical axis and its standard deviation, m.

    ``velocity`` (3,) m/s and ``omega`` (3,) 1/s in the camera frame; the inverse height that fits all three axes
    best. NaN where the motion does not tell it within ``max_relative_std``.
    """
    speed = math.sqrt(float(velocity @ velocity))
    if speed <= 0 or not np.isfinite(omega).all():
        return math.nan, math.nan
    weight = 1.0 / np.maximum(omega_std, 1e-9) ** 2
    information = float((weight * velocity) @ velocity)
    inverse = float((weight * velocity) @ omega) / information
    if inverse <= 0:
        return math.nan, math.nan
    relative = math.hypot(1.0 / (math.sqrt(information) * inverse), velocity_std / speed)
    if relative > max_relative_std:
        return math.nan, math.nan
    return 1.0 / inverse, relative / inverse
