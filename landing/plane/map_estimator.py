"""The default estimator: exact plane fit over the best baseline, fused over time, motion from the newest interval."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from landing.motion.velocity import velocity
from landing.motion.views import Baseline, Views
from landing.options import EstimatorOptions
from landing.plane.evidence import Evidence, EvidenceOptions, slope_std
from landing.plane.plane import Plane, RotationError, RowsError
from landing.plane.planefit import FitPrior, PlaneFit, fit_plane
from landing.plane.second_plane import second_plane
from landing.vision.rolling_shutter import Motion

Array = NDArray[np.float64]

_UNEVEN = 0.0035
"""How much the slopes of one surface differ from place to place, when they are evidence of something else."""
_KEEP_TRACKS = 0.5
"""Share of the tracks that a baseline keeps."""
_CUT = 4.5
"""Residual, in standard deviations, beyond which a track counts as an outlier (Tukey's biweight)."""
_UNMEASURED_ROTATION_STD = 0.1
"""Rotation without any measurement, rad."""
_RESTART_BELOW = 0.6
"""Share of inliers at which the fit is started afresh."""
_KEEP_SEEN = 0.6
"""Share of tracks still seen for a remembered slope to hold."""
_SAMPLE = 40
"""Tracks that the choice of the baseline looks at."""


class MapEstimator:
    """Maximum a posteriori plane between the newest frame and the older one with the most information about it."""

    def __init__(self, options: EstimatorOptions, focal_px: float, capacity: int) -> None:
        self.options, self.focal_px = options, focal_px
        self.evidence = Evidence(EvidenceOptions(options.memory_s))
        self._normal: Array | None = None
        self._weight = np.ones(capacity)
        self._noise = 1.0
        self._rate = np.full(3, math.nan)

    def step(self, views: Views) -> Plane:
        """The plane at the newest frame."""
        o = self.options
        if views.longest < 1:
            self._normal = None
            return Plane("starting")
        if views.corrected:
            self.evidence.clear()
        gap, flow_px = self._choose(views)
        baseline = views.baseline(gap)
        if len(baseline.tracks.slots) < o.min_tracks:
            self._normal = None
            return Plane("too_few_tracks")
        fit = self._fit(views, baseline) if flow_px >= o.map_min_flow_px else None
        if fit is not None and not views.rows.moving:
            # now that the motion is known, the tracks can be taken to their frames' times
            views.rows.saw(Motion(fit.t / -baseline.interval_s, fit.normal))
            baseline = views.baseline(gap)
            fit = self._fit(views, baseline)
        newest = views.newest
        rows_error = self._rows_error(views, fit)
        if fit is not None and newest.ned_from_camera is not None and baseline.derotated:
            self.evidence.add(
                views.tracker.frame,
                newest.time_s,
                newest.ned_from_camera,
                fit.a,
                fit.b,
                fit.slope_covariance,
                gap,
                None if fit.sensitivity is None else (fit.covariance @ fit.sensitivity.gradient)[3:5],
                fit.lens[3:5],
            )
        if newest.ned_from_camera is None:
            return self._without_attitude(views, baseline, fit)
        if not baseline.derotated:
            # what was fused with attitudes is surer than a plane that may be the wrong one of two
            fused = (
                self.evidence.fuse(newest.time_s, newest.ned_from_camera, views.rows.std_s)
                if self._still_seen(views)
                else None
            )
            if fused is None:
                return self._without_attitude(views, baseline, fit)
            return self._plane(views, baseline, fit, *fused)
        if fit is None and not self._still_seen(views):
            self.evidence.clear()
        fused = self.evidence.fuse(newest.time_s, newest.ned_from_camera, views.rows.std_s)
        if fused is None:
            return Plane("motion_too_small", gap=gap)
        plane = self._plane(views, baseline, fit, *fused)
        return plane if rows_error is None else replace(plane, rows_error=rows_error)

    def _without_attitude(self, views: Views, baseline: Baseline, fit: PlaneFit | None) -> Plane:
        """The plane of one baseline whose rotation nobody measured: it may be the other one of two."""
        if fit is None:
            return Plane("motion_too_small", gap=baseline.gap)
        lens = fit.lens[3:5]
        covariance = fit.slope_covariance + lens @ lens.T
        second = second_plane(fit, baseline.old_from_new, baseline.tracks.new)
        if second is not None:
            slopes, share = second
            apart = slopes - (fit.a, fit.b)
            covariance = covariance + share * np.outer(apart, apart)
        return self._plane(views, baseline, fit, fit.a, fit.b, covariance)

    def _rows_error(self, views: Views, fit: PlaneFit | None) -> RowsError | None:
        """What the fit, and its slopes against those fused before, say of the rows' readout."""
        attitude = views.newest.ned_from_camera
        if fit is None or fit.sensitivity is None or attitude is None:
            return None
        effect, covariance = fit.sensitivity, fit.slope_covariance
        difference, before_gradient = np.zeros((2, 2))
        before: Array = np.zeros((2, 2))
        known = self.evidence.expected(views.newest.time_s, attitude)
        if known is not None:
            slopes, fused, old_gradient = known
            apart = np.array((fit.a, fit.b)) - slopes
            changes = (fit.covariance @ effect.gradient)[3:5] - old_gradient
            old: Array = np.asarray(fused + np.eye(2) * _UNEVEN**2, np.float64)
            spread = covariance + old + np.outer(changes, changes) * views.rows.std_s**2
            if float(apart @ np.linalg.solve(spread, apart)) <= self.evidence.options.agreement:
                difference, before_gradient = apart, old_gradient
                before = np.asarray(np.linalg.inv(old), np.float64)
        x = np.concatenate((fit.t, (fit.a, fit.b), fit.d))
        return RowsError(
            x,
            fit.covariance,
            effect.gradient,
            effect.information,
            effect.score,
            difference,
            before,
            before_gradient,
        )

    def read_out(self, change_s: float) -> None:
        """The rows' readout is known to be longer by so much: the slopes remembered change with it."""
        self.evidence.shift(change_s)

    def _choose(self, views: Views) -> tuple[int, float]:
        """The gap of most information, about tracks times flow squared, within the limits; and its RMS flow."""
        o = self.options
        gaps, count, flow = views.profile(o.min_tracks, _KEEP_TRACKS, _SAMPLE)
        flow_px = flow * self.focal_px
        information = np.where(flow_px <= o.map_max_flow_px, count * flow_px**2, -1.0)
        measured = np.array([views.measured(gap) for gap in gaps.tolist()])
        if (measured & (flow_px >= o.map_min_flow_px)).any():
            # without a rotation a plane is one of two
            information = np.where(measured, information, -1.0)
        best = int(information.argmax())
        return int(gaps[best]), float(flow_px[best])

    def _still_seen(self, views: Views) -> bool:
        """Whether most of what is in view was in view when the remembered slopes were measured."""
        frame = self.evidence.newest_frame
        if frame is None:
            return False
        tracker = views.tracker
        born = tracker.born[tracker.alive]
        return len(born) > 0 and float((born <= frame).mean()) >= _KEEP_SEEN

    def _fit(self, views: Views, baseline: Baseline) -> PlaneFit | None:
        o = self.options
        if baseline.derotated:
            std = np.array((o.rotation_std_rad, o.rotation_std_rad, o.yaw_std_rad))
            std = np.hypot(std, baseline.rotation_std_rad)
        else:
            std = np.full(3, _UNMEASURED_ROTATION_STD)
        prior = FitPrior(std)
        tracks = baseline.tracks
        fit = None
        start = self._predicted(views, baseline.interval_s)
        if start is not None:
            fit = self._refine(views, baseline, prior, start, (self._weight[tracks.slots], self._noise))
        if fit is None or np.count_nonzero(fit.weight) < _RESTART_BELOW * len(fit.weight):
            # a wrong plane would otherwise carry itself on
            other = self._refine(views, baseline, prior)
            if fit is None or (other is not None and other.noise < fit.noise):
                fit = other
        return fit

    def _predicted(self, views: Views, interval_s: float) -> tuple[Array, float, float] | None:
        """(t, a, b) of the last plane and motion, over ``interval_s``, in the axes of the newest frame."""
        if self._normal is None or not math.isfinite(self._rate[0]):
            return None
        t, normal = self._rate * interval_s, self._normal
        last_from_new = views.rotation(1)
        if last_from_new is not None:
            t, normal = t @ last_from_new, normal @ last_from_new
        x, y, z = normal.tolist()
        return t, -x / z, -y / z

    def _refine(
        self,
        views: Views,
        baseline: Baseline,
        prior: FitPrior,
        start: tuple[Array, float, float] | None = None,
        carried: tuple[Array, float] | None = None,
    ) -> PlaneFit | None:
        t = baseline.tracks
        return fit_plane(
            t.new,
            t.old,
            baseline.old_from_new,
            t.whitener,
            prior,
            start,
            carried,
            _CUT,
            moves=baseline.moves,
            lens_moves=views.lens_moves(baseline.gap, t.slots),
            own_moves=views.row_moves(baseline.gap, t.slots),
        )

    def _plane(
        self, views: Views, baseline: Baseline, fit: PlaneFit | None, a: float, b: float, covariance: Array
    ) -> Plane:
        o = self.options
        normal = np.array((-a, -b, 1.0))
        if fit is not None:
            self._weight[:] = 1.0
            self._weight[baseline.tracks.slots] = fit.weight
            self._noise = fit.noise
        self._normal = normal
        moving = velocity(views, normal, self._weight, self._noise, baseline.rotation_std_rad, o)
        omega, omega_std = moving if moving is not None else (np.full(3, math.nan), np.full(3, math.nan))
        self._rate = -omega if fit is None else fit.t / baseline.interval_s
        divergence = float(2 * omega[2] + omega[0] * a + omega[1] * b)
        status = (
            "ok"
            if slope_std(covariance) <= math.tan(math.radians(o.max_slope_std_deg))
            else "slope_uncertain"
        )
        ttc = 2 / divergence if divergence > 0 else math.nan
        if fit is None:
            return Plane(status, a, b, covariance, omega, omega_std, divergence, ttc)
        inlier = fit.weight > 0
        return Plane(
            status,
            a,
            b,
            covariance,
            omega,
            omega_std,
            divergence,
            ttc,
            baseline.gap,
            fit.t,
            fit.old_from_new,
            baseline.tracks.slots,
            inlier,
            fit.weight,
            fit.residual,
            fit.noise,
            np.count_nonzero(inlier) / len(inlier),
            float(np.hypot(*fit.residual.T).sum()) / len(inlier),
            RotationError(fit.d, fit.covariance[5:, 5:], fit.prior.rotation_std)
            if baseline.derotated
            else None,
        )
