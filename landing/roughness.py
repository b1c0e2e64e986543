"""Roughness: RMS relief of the surface over its distance, from the parallax that the plane leaves.

A point that stands e (relative, towards the camera) over the plane is displaced by e times the derivative g of its
projection along the translation; dividing the residual by g makes the measure independent of height, speed and
time to contact. The component across g holds no relief: it measures the tracker's noise and unmasks gross errors.
The noise is taken out by multiplying two measurements of the same point from baselines without a common frame:
what is relief is in both, what is noise is not.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from landing.motion import displacement
from landing.options import EstimatorOptions
from landing.plane import Plane
from landing.tracking import FeatureTracker
from landing.views import Baseline, Views

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Relief:
    """``height`` (n,) over the plane over the distance along the axis of the tracks ``slots``, ``std`` (n,) of it.

    ``roughness`` is the RMS with the noise taken out, ``roughness_std`` one sigma of it, NaN where the motion
    does not tell; ``gross`` counts the tracks refused as tracking errors.
    """

    slots: NDArray[np.intp]
    height: Array
    std: Array
    roughness: float
    roughness_std: float
    gross: int


class ReliefMap:
    """Heights of the tracked points over the plane, frame by frame; each track over the longest gap it has."""

    def __init__(self, options: EstimatorOptions, focal_px: float, capacity: int) -> None:
        self.options, self.focal_px = options, focal_px
        self._heights = np.full((FeatureTracker.HISTORY, capacity), np.nan)
        self._stds = np.full((FeatureTracker.HISTORY, capacity), np.nan)

    def step(self, views: Views, plane: Plane) -> Relief | None:
        """Relief at the newest frame over ``plane``; None when there is no baseline to see it by."""
        tracker, o = views.tracker, self.options
        row = tracker.frame % tracker.HISTORY
        self._heights[row] = np.nan
        if plane.status != "ok" or plane.gap < 1:
            return None
        gross = 0
        weight = np.ones(len(tracker.alive))
        weight[plane.slots] = plane.weight
        for gap in self._gaps(views, plane.gap):
            baseline = views.baseline(gap)
            corrected = plane.old_from_new if gap == plane.gap else None
            measured = heights(baseline, plane.normal, corrected, weight, o.noise_floor, o.gross_sigmas)
            if measured is None:
                continue
            height, std, wrong = measured
            fresh = np.isnan(self._heights[row, baseline.tracks.slots])
            gross += int((wrong & fresh).sum())
            fresh &= ~wrong
            self._heights[row, baseline.tracks.slots[fresh]] = height[fresh]
            self._stds[row, baseline.tracks.slots[fresh]] = std[fresh]
        slots = np.flatnonzero(np.isfinite(self._heights[row]))
        height, std = self._heights[row, slots], self._stds[row, slots]
        if len(slots) < o.min_roughness_tracks:
            return Relief(slots, height, std, math.nan, math.nan, gross)
        # an older measurement of the same track, over other frames
        lag = max(1, plane.gap // 2) if plane.gap > 1 else 2
        older_row = (tracker.frame - lag) % tracker.HISTORY
        twice = (tracker.born[slots] < tracker.frame - lag) & np.isfinite(self._heights[older_row, slots])
        older = np.where(twice, self._heights[older_row, slots], 0.0)
        older_std = np.where(twice, self._stds[older_row, slots], std)
        # a height that did not last is a tracking error
        lasting = ~twice | (np.abs(height - older) < o.lasting_sigmas * np.hypot(std, older_std))
        gross += int((~lasting).sum())
        product = np.where(twice, height * older, height**2 - std**2)[lasting]
        variance = np.where(twice, std * older_std, std**2)[lasting]
        if len(product) < o.min_roughness_tracks:
            return Relief(slots, height, std, math.nan, math.nan, gross)
        mean_square = 0.0
        for _ in range(4):
            weight = 1.0 / (variance + mean_square) ** 2
            total = float(weight.sum())
            mean_square = max(float((weight * product).sum()) / total, 0.0)
        rough = math.sqrt(mean_square)
        spread = math.sqrt(2.0 / total)
        rough_std = math.sqrt(mean_square + spread) - rough
        if rough_std > o.max_roughness_std:
            rough = rough_std = math.nan
        return Relief(slots, height, std, rough, rough_std, gross)

    def _gaps(self, views: Views, longest: int) -> list[int]:
        """The plane's own baseline, then shorter ones for the tracks that are younger."""
        tracker = views.tracker
        ages = tracker.frame - np.unique(tracker.born[tracker.alive])
        younger = sorted((int(age) for age in ages if 2 <= age < longest), reverse=True)
        return [longest, *younger[: self.options.relief_groups]]


def heights(
    baseline: Baseline,
    normal: Array,
    old_from_new: Array | None,
    weight: Array,
    noise_floor: float,
    gross_sigmas: float,
) -> tuple[Array, Array, NDArray[np.bool_]] | None:
    """Height over the plane (n,) over the distance along the axis, its standard deviation, and gross errors.

    ``old_from_new`` replaces the measured rotation where a fit has corrected it; ``weight`` as in ``velocity``.
    """
    tracks = baseline.tracks
    derotated = baseline.derotated_old
    rotation = baseline.old_from_new
    if old_from_new is not None:
        rotation = old_from_new
        q = tracks.old @ rotation[:2] + rotation[2]
        derotated = q[:, :2] / q[:, 2:]
    found = displacement(tracks.new, derotated[None], normal, tracks.whitener, weight[tracks.slots])
    if found is None:
        return None
    t = found[0][0]
    depth = normal[2] + tracks.new @ normal[:2]
    # (x' - x) = d (1 + e) (x' tz - tx): linear in the height e as well
    direction = depth[:, None] * (derotated * t[2] - t[:2])
    residual = derotated - tracks.new - direction
    c11, c12, c22 = tracks.whitener
    g = np.stack((c11 * direction[:, 0] + c12 * direction[:, 1], c22 * direction[:, 1]))
    r = np.stack((c11 * residual[:, 0] + c12 * residual[:, 1], c22 * residual[:, 1]))
    information = g[0] ** 2 + g[1] ** 2
    length = np.sqrt(np.maximum(information, 1e-12))
    across = (g[0] * r[1] - g[1] * r[0]) / length
    noise = max(float(np.partition(np.abs(across), len(across) // 2)[len(across) // 2]) * 1.4826, noise_floor)
    scale = 1.0 / math.sqrt(float(normal @ normal))
    height = (g[0] * r[0] + g[1] * r[1]) / np.maximum(information, 1e-12) * scale
    std = noise / length * scale
    return height, std, np.abs(across) > gross_sigmas * noise
