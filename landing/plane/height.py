"""Height from the velocity that the autopilot knows and the ventral flow that the camera sees: h = V / omega."""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ROUNDS = 3
_LEAST = 1e-9
"""Where neither has an error, 1/s."""


def height(
    velocity: Array, velocity_std: float, omega: Array, omega_std: Array, max_relative_std: float
) -> tuple[float, float]:
    """Distance to the surface along the optical axis and its standard deviation, m.

    ``velocity`` (3,) m/s and ``omega`` (3,) 1/s in the camera frame; the inverse height that fits all three axes
    best, both with their errors. NaN where the motion does not determine it within ``max_relative_std``.
    """
    axes = list(zip(velocity.tolist(), omega.tolist(), omega_std.tolist(), strict=True))
    speed2 = sum(v * v for v, _, _ in axes)
    inverse = sum(v * w for v, w, _ in axes) / speed2 if speed2 > 0 else math.nan
    if not math.isfinite(inverse):
        return math.nan, math.nan
    for _ in range(_ROUNDS):
        if inverse <= 0:
            return math.nan, math.nan
        # an error of the velocity counts by what it makes of omega
        floor = (velocity_std * inverse) ** 2 + _LEAST**2
        information = sum(v * v / (std * std + floor) for v, _, std in axes)
        inverse = sum(v * w / (std * std + floor) for v, w, std in axes) / information
    relative = 1.0 / (math.sqrt(information) * inverse)
    if not 0 < relative <= max_relative_std:
        return math.nan, math.nan
    return 1.0 / inverse, relative / inverse
