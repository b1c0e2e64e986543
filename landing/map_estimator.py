"""The default estimator: exact plane fit over the best baseline, motion from the newest interval."""

import math

import numpy as np
from numpy.typing import NDArray

from landing.options import EstimatorOptions
from landing.plane import Plane
from landing.planefit import FitPrior, PlaneFit, fit_plane
from landing.views import Baseline, Views

Array = NDArray[np.float64]


class MapEstimator:
    """Maximum a posteriori plane from the tracks between the newest frame and a keyframe chosen by the data."""

    def __init__(self, options: EstimatorOptions, focal_px: float) -> None:
        self.options, self.focal_px = options, focal_px
        self._gap = 0
        self._last: PlaneFit | None = None

    def step(self, views: Views) -> Plane:
        """The plane at the newest frame."""
        o = self.options
        if views.longest < 1:
            self._gap, self._last = 0, None
            return Plane("starting")
        baseline = self._choose(views)
        if baseline is None:
            self._last = None
            return Plane("too_few_tracks")
        length = float(np.median(np.hypot(*baseline.flow.T))) * self.focal_px
        if length < o.map_min_flow_px:
            return Plane("motion_too_small", gap=baseline.gap)
        fit = self._fit(baseline)
        if fit is None:
            return Plane("no_fit", gap=baseline.gap)
        return self._plane(views, baseline, fit)

    def _choose(self, views: Views) -> Baseline | None:
        """The gap whose flow comes nearest the target, one frame longer than the last at most."""
        o = self.options
        gap = min(self._gap + 1, views.longest)
        baseline = views.baseline(gap)
        while gap > 1:
            enough = len(baseline.tracks.slots) >= max(
                o.min_tracks, o.map_keep_tracks * views.tracker.alive.sum()
            )
            if enough and float(np.median(np.hypot(*baseline.flow.T))) * self.focal_px <= o.map_flow_px:
                break
            gap -= 1
            baseline = views.baseline(gap)
        self._gap = gap
        return baseline if len(baseline.tracks.slots) >= o.min_tracks else None

    def _fit(self, baseline: Baseline) -> PlaneFit | None:
        o, f = self.options, self.focal_px
        if baseline.derotated:
            std = np.array((o.rotation_std_rad, o.rotation_std_rad, o.yaw_std_rad))
            std = np.hypot(std, baseline.rotation_std_rad)
        else:
            std = np.full(3, o.unmeasured_rotation_std_rad)
        prior = FitPrior(std, o.slope_std, noise_floor=o.noise_floor_px / f, noise_cap=o.noise_cap_px / f)
        return fit_plane(baseline.tracks.new, baseline.tracks.old, baseline.old_from_new, prior)

    def _plane(self, views: Views, baseline: Baseline, fit: PlaneFit) -> Plane:
        dt = baseline.interval_s
        omega = -fit.t / dt
        omega_std = np.sqrt(np.diag(fit.covariance)[:3]) / dt
        divergence = 2 * omega[2] + omega[0] * fit.a + omega[1] * fit.b
        inlier = fit.weight > 0
        return Plane(
            "ok",
            fit.a,
            fit.b,
            fit.covariance[3:5, 3:5],
            omega,
            omega_std,
            float(divergence),
            2 / float(divergence) if divergence > 0 else math.nan,
            baseline.gap,
            fit.t,
            fit.old_from_new,
            baseline.tracks.slots,
            inlier,
            fit.residual,
            fit.noise,
            float(inlier.mean()),
            float(np.hypot(*fit.residual.T).mean()),
        )
