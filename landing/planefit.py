"""The exact two-view plane fit: robust, maximum a posteriori, with its covariance.

Model (exact for any motion): a point p = (x, y, 1) of the newest frame on the surface Z = h + aX + bY is seen in
the older frame at the projection of R (p - t (n . p)), with n = (-a, -b, 1), t the camera's displacement from the
newest to the older exposure over h in the newest frame's axes, and R = R0 exp(d): R0 the measured rotation
old_from_new and d its small error, which has a prior. The paper's Eqs. 7 and 8 are the small-motion limit.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from landing.rotations import exp_so3

Points = NDArray[np.float64]
Array = NDArray[np.float64]

_MEDIAN = 2 * math.log(2.0)
"""Median of a chi-square of two degrees."""

_TRUNCATION = 2.5**2 / 2
_SHARE = 1 - _TRUNCATION * math.exp(-_TRUNCATION) / (1 - math.exp(-_TRUNCATION))
"""Mean of a chi-square of two degrees cut at 2.5 sigma, over two."""

_SCALE_ROUNDS, _SCALE_SETTLED = 4, 0.01

PARAMETERS = 8
"""t (3), a, b, d (3): the order of ``PlaneFit.covariance``."""


@dataclass(frozen=True, slots=True)
class FitPrior:
    """Standard deviations of what is known before: rotation error (3,) rad, slope tangents, displacement
    over height, track noise bounds.

    ``noise_floor`` is the smallest and ``noise_cap`` the largest track noise believed, in units of the whitened
    residuals.
    """

    rotation_std: Array
    slope_std: float = 1.0
    displacement_std: float = 2.0
    noise_floor: float = 0.3
    noise_cap: float = 10.0


@dataclass(frozen=True, slots=True)
class PlaneFit:
    """Displacement over height t (3,), slope tangents a and b, rotation error d (3,), and their covariance (8, 8).

    ``residual`` is (n, 2), observed minus predicted in the old frame, normalised; ``weight`` (n,) in 0 to 1;
    ``noise`` the scale of the inliers' whitened residuals per coordinate; ``old_from_new`` (3, 3) with d applied.
    """

    t: Array
    a: float
    b: float
    d: Array
    covariance: Array
    residual: Points
    weight: Array
    noise: float
    old_from_new: Array
    converged: bool

    @property
    def normal(self) -> Array:
        """n = (-a, -b, 1) (3,), not of unit length."""
        return np.array((-self.a, -self.b, 1.0))


def fit_plane(
    new: Points,
    old: Points,
    old_from_new: Array,
    whitener: Array,
    prior: FitPrior,
    start: tuple[Array, float, float] | None = None,
    start_d: Array | None = None,
    cut: float = 5.0,
    iterations: int = 15,
    tolerance: float = 2e-2,
) -> PlaneFit | None:
    """Fit the plane to tracks ``new`` and ``old`` (n, 2), normalised coordinates of two frames.

    ``whitener`` (3, n) as in ``TrackPair``. ``start`` is (t, a, b), ``start_d`` (3,) the rotation error; without
    them the fit starts from a robust homography. None with fewer than eight tracks or when no homography explains
    them. Tukey weights on the length of each residual, cut at ``cut`` times the noise, which is estimated along the
    way (median, then the inliers'); done when Newton's decrement is below ``tolerance``.
    """
    if len(new) < PARAMETERS:
        return None
    if start is None:
        start = start_from_homography(new, old, old_from_new)
        if start is None:
            return None
    problem = _Problem(new, old, old_from_new, whitener, prior)
    x = np.zeros(PARAMETERS)
    x[:3], x[3], x[4] = start
    if start_d is not None:
        x[5:] = start_d
    residual = problem.residual(x)
    noise = problem.scale(residual, False)
    damping, converged = 0.0, False
    for iteration in range(iterations):
        weight = problem.weights(residual, noise, cut)
        cost = problem.cost(x, residual, noise, cut)
        hessian, gradient = problem.normal_equations(x, residual, weight, noise)
        while True:
            damped = hessian + np.diag(np.diag(hessian) * damping) if damping else hessian
            tried = x + np.linalg.solve(damped, gradient)
            r = problem.residual(tried)
            if problem.cost(tried, r, noise, cut) <= cost * (1 + 1e-9) + 1e-9 or damping > 1e4:
                break
            damping = max(1e-3, damping * 10)
        # Newton's decrement: twice the cost still to be gained, in units of the noise
        decrement = float(gradient @ (tried - x))
        x, residual = tried, r
        damping = damping / 10 if damping > 1e-3 else 0.0
        if iteration < 2:
            # the scale settles first: a cost that changes under way does not converge
            noise = problem.scale(residual, True)
        if iteration and abs(decrement) < tolerance:
            converged = True
            break
    noise = problem.scale(residual, True)
    weight = problem.weights(residual, noise, cut)
    if not converged:
        # where the last step was short, its matrix serves
        hessian, _ = problem.normal_equations(x, residual, weight, noise)
    try:
        covariance: Array = np.linalg.inv(hessian).astype(np.float64)
    except np.linalg.LinAlgError:
        return None
    return PlaneFit(
        x[:3].copy(),
        float(x[3]),
        float(x[4]),
        x[5:].copy(),
        covariance,
        problem.raw.T,
        weight,
        noise,
        old_from_new @ exp_so3(x[5:]),
        converged,
    )


class _Problem:
    """Residuals, Jacobian and robust scale; arrays have shape (2, n) or (3, n) so that rows are contiguous."""

    def __init__(
        self, new: Points, old: Points, old_from_new: Array, whitener: Array, prior: FitPrior
    ) -> None:
        n = len(new)
        self.p = np.ones((3, n))
        self.p[:2] = new.T
        self.q = np.ascontiguousarray(old.T)
        self.rotation0, self.prior = old_from_new, prior
        self.c11, self.c12, self.c22 = whitener
        self.precision = np.full(PARAMETERS, prior.displacement_std**-2.0)
        self.precision[3:5] = prior.slope_std**-2.0
        self.precision[5:] = prior.rotation_std**-2.0
        self.jacobian = np.empty((2, PARAMETERS, n))
        self.at: Array | None = None

    def residual(self, x: Array) -> Array:
        """Observed minus predicted in the old frame, whitened (2, n)."""
        p, self.at = self.p, x
        self.rotation = self.rotation0 @ exp_so3(x[5:])
        self.depth = 1.0 - x[3] * p[0] - x[4] * p[1]
        self.seen = p - x[:3, None] * self.depth
        there = self.rotation @ self.seen
        self.inverse = 1.0 / there[2]
        self.projected = there[:2] * self.inverse
        raw = self.q - self.projected
        self.raw = raw
        out = np.empty_like(raw)
        np.multiply(self.c11, raw[0], out=out[0])
        out[0] += self.c12 * raw[1]
        np.multiply(self.c22, raw[1], out=out[1])
        return out

    def normal_equations(self, x: Array, residual: Array, weight: Array, noise: float) -> tuple[Array, Array]:
        """Gauss-Newton matrix (8, 8) and right-hand side (8,) at the last ``residual`` call's point."""
        if self.at is not x:
            self.residual(x)
        rotation, seen, j = self.rotation, self.seen, self.jacobian
        # d projection / d seen, whitened: (2, 3, n)
        g = (rotation[:2, :, None] - rotation[2][:, None] * self.projected[:, None]) * self.inverse
        g[0] *= self.c11
        g[0] += self.c12 * g[1]
        g[1] *= self.c22
        np.multiply(g, -self.depth, out=j[:, 0:3])
        along = x[0] * g[:, 0] + x[1] * g[:, 1] + x[2] * g[:, 2]
        np.multiply(along[:, None], self.p[:2], out=j[:, 3:5])
        j[:, 5] = g[:, 2] * seen[1] - g[:, 1] * seen[2]
        j[:, 6] = g[:, 0] * seen[2] - g[:, 2] * seen[0]
        j[:, 7] = g[:, 1] * seen[0] - g[:, 0] * seen[1]
        weighted = j * (weight / noise**2)
        hessian = weighted[0] @ j[0].T + weighted[1] @ j[1].T
        hessian.ravel()[:: PARAMETERS + 1] += self.precision
        gradient = weighted[0] @ residual[0] + weighted[1] @ residual[1] - self.precision * x
        return hessian, gradient

    def scale(self, residual: Array, refine: bool) -> float:
        """Noise per coordinate: from the median, refined by the mean square of the residuals near it."""
        length2 = residual[0] ** 2 + residual[1] ** 2
        noise2 = float(np.partition(length2, len(length2) // 2)[len(length2) // 2]) / _MEDIAN
        if refine:
            # with half the tracks wrong the median is far too large: again until what is inside agrees
            for _ in range(_SCALE_ROUNDS):
                inside = length2[length2 < noise2 * 2 * _TRUNCATION]
                if len(inside) <= PARAMETERS:
                    break
                # about three of the eight parameters' degrees of freedom come off the pairs within the cut
                last, noise2 = noise2, float(inside.sum()) / (2 * _SHARE * max(len(inside) - 3.0, 1.0))
                if abs(noise2 - last) < _SCALE_SETTLED * last:
                    break
        floor, cap = self.prior.noise_floor, self.prior.noise_cap
        return float(min(max(math.sqrt(noise2), floor), cap))

    def weights(self, residual: Array, noise: float, cut: float) -> Array:
        e = (residual[0] ** 2 + residual[1] ** 2) * (1.0 / (cut * noise) ** 2)
        return np.maximum(0.0, 1.0 - e) ** 2

    def cost(self, x: Array, residual: Array, noise: float, cut: float) -> float:
        e = np.minimum((residual[0] ** 2 + residual[1] ** 2) * (1.0 / (cut * noise) ** 2), 1.0)
        tukey = float((1 - (1 - e) ** 3).sum()) * cut**2 / 6
        return tukey + 0.5 * float((self.precision * x * x).sum())


def start_from_homography(new: Points, old: Points, old_from_new: Array) -> tuple[Array, float, float] | None:
    """(t, a, b) from the rank-1 split of a robust homography of the derotated tracks.

    The homography new -> derotated old is (I - t n^T) up to scale; its middle singular value is the scale.
    """
    p = np.column_stack((new, np.ones(len(new))))
    q = np.column_stack((old, np.ones(len(old)))) @ old_from_new
    if (q[:, 2] <= 1e-6).any():
        return None
    q = q / q[:, 2:]
    h = _robust_homography(p[:, :2], q[:, :2])
    if h is None:
        return None
    singular = np.linalg.svd(h, compute_uv=False)
    if singular[1] < 1e-9:
        return None
    h = h / singular[1]
    if np.linalg.det(h) < 0:
        h = -h
    u, s, vt = np.linalg.svd(np.eye(3) - h)
    n = vt[0]
    if abs(n[2]) < 1e-3 * np.linalg.norm(n[:2]) or abs(n[2]) < 1e-6:
        return u[:, 0] * s[0], 0.0, 0.0
    t = u[:, 0] * s[0] * n[2]
    a, b = -n[0] / n[2], -n[1] / n[2]
    limit = 4.0
    return t, float(np.clip(a, -limit, limit)), float(np.clip(b, -limit, limit))


def _robust_homography(p: Points, q: Points, hypotheses: int = 96, seed: int = 1) -> Array | None:
    """Homography (3, 3) of (n, 2) points by a batch of four-point hypotheses and two refits; least median wins."""
    n = len(p)
    rng = np.random.default_rng(seed)
    pick = rng.random((hypotheses, n)).argpartition(3, axis=1)[:, :4]
    x, y, u, v = p[pick, 0], p[pick, 1], q[pick, 0], q[pick, 1]
    rows = np.zeros((hypotheses, 8, 8))
    rows[:, 0::2, 0], rows[:, 0::2, 1], rows[:, 0::2, 2] = x, y, 1
    rows[:, 1::2, 3], rows[:, 1::2, 4], rows[:, 1::2, 5] = x, y, 1
    rows[:, 0::2, 6], rows[:, 0::2, 7] = -u * x, -u * y
    rows[:, 1::2, 6], rows[:, 1::2, 7] = -v * x, -v * y
    right = np.empty((hypotheses, 8, 1))
    right[:, 0::2, 0], right[:, 1::2, 0] = u, v
    rows[:, range(8), range(8)] += 1e-12
    usable = np.abs(np.linalg.det(rows)) > 1e-24
    if not usable.any():
        return None
    h = np.linalg.solve(rows[usable], right[usable])[..., 0]
    h = np.concatenate((h, np.ones((len(h), 1))), axis=1).reshape(-1, 3, 3)
    ones = np.ones((n, 1))
    out = np.concatenate((p, ones), axis=1) @ h.transpose(0, 2, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        error = ((out[..., :2] / out[..., 2:] - q) ** 2).sum(axis=2)
    error = np.where(np.isfinite(error), error, np.inf)
    score = np.partition(error, n // 2, axis=1)[:, n // 2]
    best = int(score.argmin())
    estimate, e = h[best], error[best]
    for _ in range(2):
        inside = e <= max(float(np.median(e)) * 6.0, 1e-12)
        if int(inside.sum()) < 6:
            break
        refit = _linear_homography(p[inside], q[inside])
        out1 = np.concatenate((p, ones), axis=1) @ refit.T
        with np.errstate(divide="ignore", invalid="ignore"):
            e1 = ((out1[:, :2] / out1[:, 2:] - q) ** 2).sum(axis=1)
        if not np.isfinite(e1).all() or np.median(e1) > np.median(e) * 1.5:
            break
        estimate, e = refit, e1
    return estimate


def _linear_homography(p: Points, q: Points) -> Array:
    x, y, u, v = p[:, 0], p[:, 1], q[:, 0], q[:, 1]
    zero, one = np.zeros_like(x), np.ones_like(x)
    top = np.column_stack((x, y, one, zero, zero, zero, -u * x, -u * y))
    bottom = np.column_stack((zero, zero, zero, x, y, one, -v * x, -v * y))
    solution = np.linalg.lstsq(np.concatenate((top, bottom)), np.concatenate((u, v)), rcond=None)[0]
    return np.append(solution, 1.0).reshape(3, 3)
