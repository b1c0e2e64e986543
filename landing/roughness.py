"""Roughness: RMS relief of the surface over its distance, from the parallax that the plane leaves.

A point that stands e (relative, towards the camera) over the plane is displaced by e times the derivative g of its
projection along the translation; dividing the residual by g makes the measure independent of height, speed and
time to contact. The component across g holds no relief: it measures the tracker's noise and unmasks gross errors.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Relief:
    """``height`` (n,) over the plane over the distance along the axis, NaN where unknown, its ``std`` (n,).

    ``roughness`` is the RMS with the noise taken out, ``roughness_std`` one sigma of it, ``noise`` the tracker's
    noise per coordinate (normalised), ``gross`` (n,) the tracks refused as tracking errors.
    """

    height: Array
    std: Array
    roughness: float
    roughness_std: float
    noise: float
    gross: NDArray[np.bool_]


def relief(
    new: Array,
    old: Array,
    old_from_new: Array,
    t: Array,
    normal: Array,
    noise_floor: float,
    min_tracks: int,
    gross_sigmas: float = 4.0,
) -> Relief:
    """Relief of tracks (n, 2) over the plane ``normal`` = (-a, -b, 1) with displacement over height ``t`` (3,)."""
    count = len(new)
    p = np.ones((3, count))
    p[:2] = new.T
    depth = normal @ p
    seen = old_from_new @ (p - t[:, None] * depth)
    predicted = seen[:2] / seen[2]
    residual = old.T - predicted
    turned = old_from_new @ t
    g = -(turned[:2, None] - turned[2] * predicted) * (depth / seen[2])
    length = np.hypot(g[0], g[1])
    unit = g / np.maximum(length, 1e-12)
    along = unit[0] * residual[0] + unit[1] * residual[1]
    across = unit[0] * residual[1] - unit[1] * residual[0]
    noise = max(float(np.median(np.abs(across))) * 1.4826, noise_floor)
    gross = np.abs(across) > gross_sigmas * noise
    scale = 1.0 / math.sqrt(float(normal @ normal))
    with np.errstate(divide="ignore", invalid="ignore"):
        height = along / length * scale
        std = noise / length * scale
    height[length < 1e-9] = np.nan
    use = ~gross & (length > 1e-9)
    if int(use.sum()) < min_tracks:
        return Relief(height, std, math.nan, math.nan, noise, gross)
    e2, s2 = height[use] ** 2, std[use] ** 2
    rho2 = 0.0
    for _ in range(4):
        weight = 1.0 / (s2 + rho2) ** 2
        total = float(weight.sum())
        value = float((weight * (e2 - s2)).sum()) / total
        rho2 = max(value, 0.0)
    # the noise is itself known to about 1 / sqrt(2 n) only
    share = float((weight * s2).sum()) / total
    n = int(use.sum())
    spread = math.sqrt(2.0 / total + 2 * share**2 / n)
    rough = math.sqrt(rho2)
    return Relief(height, std, rough, math.sqrt(rho2 + spread) - rough, noise, gross)
