"""The paper's estimator: two five-parameter fits to the derotated flow by RANSAC (de Croon et al. 2013, Eqs. 7-12)."""

import math

import numpy as np
from numpy.typing import NDArray

from landing.motion.views import Baseline, Views
from landing.options import EstimatorOptions
from landing.plane.plane import Plane

Array = NDArray[np.float64]

_HYPOTHESES = 20
"""RANSAC hypotheses of a fit."""
_INLIER_PX = 0.5
"""Largest error of an inlier."""
_FLOW_PX = 3.0
"""Median flow of the shortest baseline taken."""
_LEAST_FLOW, _LEAST_DIVERGENCE = 0.04, 0.04
"""Ventral flow for first-order slopes, and divergence for second-order ones, 1/s."""


class QuadraticEstimator:
    """u = pu . [1, x, y, x^2, xy] and v = pv . [1, x, y, y^2, xy]; slopes from their terms."""

    def __init__(self, options: EstimatorOptions, focal_px: float, capacity: int) -> None:
        self.options, self.focal_px = options, focal_px
        self._rng = np.random.default_rng(options.seed)

    def step(self, views: Views) -> Plane:
        """The plane from the shortest baseline whose flow is long enough to measure."""
        o = self.options
        for gap in range(1, min(views.longest, o.quadratic_max_gap) + 1):
            baseline = views.baseline(gap)
            if len(baseline.tracks.slots) < o.min_tracks:
                return Plane("too_few_tracks")
            length = float(np.median(np.hypot(*baseline.flow.T))) * self.focal_px
            if length >= _FLOW_PX:
                break
        else:
            if views.longest < 1:
                return Plane("starting")
        return self.fit(baseline)

    def read_out(self, change_s: float) -> None:
        """Nothing is remembered from frame to frame."""

    def fit(self, baseline: Baseline) -> Plane:
        """Plane from one baseline; the flow is placed at the middle of each track and taken per second."""
        dt = baseline.interval_s
        place = (baseline.tracks.new + baseline.derotated_old) / 2
        flow = baseline.flow / dt
        x, y = place[:, 0], place[:, 1]
        one = np.ones_like(x)
        basis_u = np.column_stack((one, x, y, x * x, x * y))
        basis_v = np.column_stack((one, x, y, y * y, x * y))
        threshold = _INLIER_PX / self.focal_px / dt
        fit_u = ransac(basis_u, flow[:, 0], threshold, _HYPOTHESES, self._rng)
        fit_v = ransac(basis_v, flow[:, 1], threshold, _HYPOTHESES, self._rng)
        if fit_u is None or fit_v is None:
            return Plane("no_fit", gap=baseline.gap)
        pu, cov_u, in_u = fit_u
        pv, cov_v, in_v = fit_v
        inlier = in_u & in_v
        residual = np.column_stack((flow[:, 0] - basis_u @ pu, flow[:, 1] - basis_v @ pv)) * dt
        noise = float(np.sqrt((residual[inlier] ** 2).mean())) if inlier.any() else math.nan
        # Eq. 9 with the sign that the flow equations give: pu0 = -wx, pv0 = -wy
        wx, wy = -pu[0], -pv[0]
        divergence = pu[1] + pv[2]
        result = self._slopes(pu, pv, cov_u, cov_v)
        if result is None:
            a = b = math.nan
            covariance = np.full((2, 2), math.nan)
            # the divergence without the slopes' share is all there is of wz
            wz, status = divergence / 2, "motion_too_small"
        else:
            a, b, wz, covariance = result
            # a rotation that nobody measured turns slopes by any amount, and the residuals do not show it
            status = "ok" if baseline.derotated else "slope_uncertain"
        omega = np.array((wx, wy, wz))
        return Plane(
            status,
            a,
            b,
            covariance,
            omega,
            np.sqrt(np.array((cov_u[0, 0], cov_v[0, 0], (cov_u[1, 1] + cov_v[2, 2]) / 4))),
            divergence,
            2 / divergence if divergence > 0 else math.nan,
            baseline.gap,
            -omega * dt,
            baseline.old_from_new,
            baseline.tracks.slots,
            inlier,
            inlier.astype(np.float64),
            residual,
            noise,
            float(inlier.mean()),
            float(np.hypot(*residual.T).mean()),
        )

    def _slopes(
        self, pu: Array, pv: Array, cov_u: Array, cov_v: Array
    ) -> tuple[float, float, float, Array] | None:
        """(a, b, wz, covariance of (a, b)): first-order terms in sideways motion, second-order along the axis."""
        wx, wy = -pu[0], -pv[0]
        if math.hypot(wx, wy) >= _LEAST_FLOW:
            # pu1 = wx a + wz, pu2 = wx b, pv1 = wy a, pv2 = wy b + wz: four equations, three unknowns
            m = np.array(((wx, 0, 1), (0, wx, 0), (wy, 0, 0), (0, wy, 1)), np.float64)
            solve = np.linalg.pinv(m)
            value = solve @ np.array((pu[1], pu[2], pv[1], pv[2]))
            noise = np.zeros((4, 4))
            noise[:2, :2], noise[2:, 2:] = cov_u[1:3, 1:3], cov_v[1:3, 1:3]
            covariance = solve @ noise @ solve.T
            return float(value[0]), float(value[1]), float(value[2]), covariance[:2, :2]
        wz = (pu[1] + pv[2]) / 2
        if abs(wz) >= _LEAST_DIVERGENCE / 2:
            # pu3 = pv4 = -a wz, pu4 = pv3 = -b wz
            a, b = -(pu[3] + pv[4]) / (2 * wz), -(pu[4] + pv[3]) / (2 * wz)
            covariance = np.zeros((2, 2))
            covariance[0, 0] = (cov_u[3, 3] + cov_v[4, 4]) / (4 * wz**2)
            covariance[1, 1] = (cov_u[4, 4] + cov_v[3, 3]) / (4 * wz**2)
            covariance[0, 1] = covariance[1, 0] = (cov_u[3, 4] + cov_v[3, 4]) / (4 * wz**2)
            return float(a), float(b), float(wz), covariance
        return None


def ransac(
    basis: Array, value: Array, threshold: float, hypotheses: int, rng: np.random.Generator
) -> tuple[Array, Array, NDArray[np.bool_]] | None:
    """Coefficients (k,), covariance (k, k) and inliers (n,) of value = basis @ p; basis is (n, k).

    All hypotheses of k points each are solved and scored as one batch; least squares on the inliers of the best.
    """
    n, k = basis.shape
    if n < 2 * k:
        return None
    pick = rng.random((hypotheses, n)).argpartition(k, axis=1)[:, :k]
    minimal = basis[pick]
    scale = np.abs(minimal).max(axis=1, keepdims=True) + 1e-12
    usable = np.abs(np.linalg.det(minimal / scale)) > 1e-9
    if not usable.any():
        return None
    p = np.linalg.solve(minimal[usable], value[pick][usable][..., None])[..., 0]
    inlier = np.abs(p @ basis.T - value) < threshold
    best = inlier[int(inlier.sum(axis=1).argmax())]
    for _ in range(2):
        if int(best.sum()) < k + 2:
            return None
        part = basis[best]
        normal = part.T @ part
        try:
            inverse = np.linalg.inv(normal)
        except np.linalg.LinAlgError:
            return None
        solution = inverse @ (part.T @ value[best])
        error = value - basis @ solution
        variance = float((error[best] ** 2).sum()) / (int(best.sum()) - k)
        best = np.abs(error) < threshold
    return solution, inverse * variance, best
