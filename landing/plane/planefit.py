"""The exact two-view plane fit: robust, maximum a posteriori, with its covariance.

Model (exact for any motion): a point p = (x, y, 1) of the newest frame on the surface Z = h + aX + bY is seen in
the older frame at the projection of R (p - t (n . p)), with n = (-a, -b, 1), t the camera's displacement from the
newest to the older exposure over h in the newest frame's axes, and R = R0 exp(d): R0 the measured rotation
old_from_new and d its small error, which has a prior. The paper's Eqs. 7 and 8 are the small-motion limit.
"""

import math
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from landing.plane.start import start_from_homography
from landing.rotations import exp_so3, skew
from landing.vision.homography import towards

Points = NDArray[np.float64]
Array = NDArray[np.float64]

_MEDIAN = 2 * math.log(2.0)
"""Median of a chi-square of two degrees."""

_TRUNCATION = 2.5**2 / 2
_SHARE = 1 - _TRUNCATION * math.exp(-_TRUNCATION) / (1 - math.exp(-_TRUNCATION))
"""Mean of a chi-square of two degrees cut at 2.5 sigma, over two."""

_SCALE_ROUNDS, _SCALE_SETTLED = 4, 0.01

PARAMETERS = 8
_NO_LENS: Array = np.zeros((PARAMETERS, 0))
"""t (3), a, b, d (3): the order of ``PlaneFit.covariance``."""
_ELEMENTS = 9
_TURNS = np.stack([skew(axis) for axis in np.eye(3)])
"""Cross products with the axes (3, 3, 3)."""


NOISE_FLOOR = 0.3
"""Smallest track noise believed, over the predicted."""


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
    noise_floor: float = NOISE_FLOOR
    noise_cap: float = 10.0


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """What an unknown that moves the tracks by a known field does to a fit.

    With residuals r + r_u du for a change du of the unknown: ``gradient`` (8,) is J^T W r_u, so that the parameters
    change by covariance @ gradient; ``information`` r_u^T W r_u and ``score`` -r_u^T W r of the unknown itself.
    """

    gradient: Array
    information: float
    score: float


@dataclass(frozen=True, slots=True)
class PlaneFit:
    """Displacement over height t (3,), slope tangents a and b, rotation error d (3,), and their covariance (8, 8).

    ``residual`` is (n, 2), observed minus predicted in the old frame, normalised; ``weight`` (n,) in 0 to 1;
    ``noise`` the scale of the inliers' whitened residuals per coordinate; ``old_from_new`` (3, 3) with d applied;
    ``prior`` the prior of the fit.
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
    prior: FitPrior
    sensitivity: Sensitivity | None = None
    lens: Array = field(default_factory=lambda: _NO_LENS)
    """How the parameters change (8, k) with each of k errors of the lens."""
    own: Array = field(default_factory=lambda: _NO_LENS)
    """The same of errors that are this pair's alone."""

    @property
    def normal(self) -> Array:
        """n = (-a, -b, 1) (3,), not of unit length."""
        return np.array((-self.a, -self.b, 1.0))

    @property
    def slope_covariance(self) -> Array:
        """Of (a, b) (2, 2), with the pair's own errors and without those of the lens."""
        own = self.own[3:5]
        return self.covariance[3:5, 3:5] + own @ own.T


def fit_plane(
    new: Points,
    old: Points,
    old_from_new: Array,
    whitener: Array,
    prior: FitPrior,
    start: tuple[Array, float, float] | None = None,
    carried: tuple[Array, float] | None = None,
    cut: float = 5.0,
    iterations: int = 15,
    tolerance: float = 0.45,
    moves: tuple[Points, Points] | None = None,
    lens_moves: tuple[Array, Array] | None = None,
    own_moves: tuple[Array, Array] | None = None,
) -> PlaneFit | None:
    """Fit the plane to tracks ``new`` and ``old`` (n, 2), normalised coordinates of two frames.

    ``whitener`` (3, n) as in ``TrackPair``. ``start`` is (t, a, b), ``carried`` the tracks' weights (n,) and the
    noise that another fit found, which serve for the first step; without a start the fit begins at a robust
    homography. None with fewer than eight tracks or when no homography explains them. Tukey weights on the length of
    each residual, cut at ``cut`` times the noise, which is estimated along the way (median, then the inliers'); done
    when Newton's decrement is below ``tolerance``: the step was then a quarter of a sigma in each parameter, and what
    is left of it is far less. ``moves`` (n, 2) each: how new and old points move with an unknown of which the
    ``sensitivity`` is wanted; ``lens_moves`` (k, n, 2) each: the same of k errors of the lens, for ``lens``;
    ``own_moves`` those of errors of this pair alone, for ``own``.
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
    if carried is not None:
        # the model is all but linear: with good weights one step leads from afar to the noise's reach
        hessian, gradient = problem.normal_equations(x, *carried)
        solved, step = cv2.solve(hessian, gradient[:, None], flags=cv2.DECOMP_CHOLESKY)
        if not solved:
            return None
        x = x + step[:, 0]
    length2 = problem.residual(x)
    noise = problem.scale(length2, carried is not None)
    weight, cost = problem.weigh(x, length2, noise, cut)
    damping, converged = 0.0, False
    for iteration in range(iterations):
        hessian, gradient = problem.normal_equations(x, weight, noise)
        while True:
            damped = hessian + np.diag(np.diag(hessian) * damping) if damping else hessian
            solved, step = cv2.solve(damped, gradient[:, None], flags=cv2.DECOMP_CHOLESKY)
            if not solved:
                return None
            tried = x + step[:, 0]
            length2 = problem.residual(tried)
            weight, tried_cost = problem.weigh(tried, length2, noise, cut)
            if tried_cost <= cost * (1 + 1e-9) + 1e-9 or damping > 1e4:
                break
            damping = max(1e-3, damping * 10)
        # Newton's decrement: twice the cost still to be gained, in units of the noise
        decrement = float(gradient @ step[:, 0])
        x, cost = tried, tried_cost
        damping = damping / 10 if damping > 1e-3 else 0.0
        converged = (iteration > 0 or carried is not None) and abs(decrement) < tolerance
        if converged or iteration < 2:
            # the scale settles first: a cost that changes under way does not converge
            noise = problem.scale(length2, True)
            weight, cost = problem.weigh(x, length2, noise, cut)
        if converged:
            break
    if not converged:
        # where the last step was short, its matrix serves
        hessian, _ = problem.normal_equations(x, weight, noise)
    regular, covariance = cv2.invert(hessian, flags=cv2.DECOMP_CHOLESKY)
    if not regular:
        return None
    return PlaneFit(
        x[:3].copy(),
        float(x[3]),
        float(x[4]),
        x[5:].copy(),
        np.asarray(covariance, np.float64),
        problem.raw,
        weight,
        noise,
        old_from_new @ exp_so3(x[5:]),
        converged,
        prior,
        None if moves is None else problem.sensitivity(x, weight, noise, *moves),
        _NO_LENS if lens_moves is None else covariance @ problem.gradients(x, weight, noise, *lens_moves),
        _NO_LENS if own_moves is None else covariance @ problem.gradients(x, weight, noise, *own_moves),
    )


class _Problem:
    """Residuals, Gauss-Newton equations and robust scale; arrays have shape (2, n) or (3, n): rows are contiguous.

    All tracks are projected by one matrix M = R (I - t n^T), so the equations are built for its nine elements and then
    taken to the eight parameters by the derivatives of M.
    """

    def __init__(
        self, new: Points, old: Points, old_from_new: Array, whitener: Array, prior: FitPrior
    ) -> None:
        n = len(new)
        self.p = np.empty((3, n))
        self.p[:2], self.p[2] = new.T, 1.0
        self.q = old.T
        self.rotation0, self.prior = old_from_new, prior
        self.c11, self.c12, self.c22 = whitener
        # C of the unit vectors and of the projection, negative: what an element of M's rows does, over the depth
        self.columns = np.empty((3, 2, n))
        self.columns[0, 0], self.columns[0, 1] = self.c11, 0.0
        self.columns[1] = whitener[1:]
        self.observed = np.empty((2, n))
        np.multiply(self.c11, self.q[0], out=self.observed[0])
        self.observed[0] += self.c12 * self.q[1]
        np.multiply(self.c22, self.q[1], out=self.observed[1])
        self.precision = np.empty(PARAMETERS)
        self.precision[:3] = prior.displacement_std**-2.0
        self.precision[3:5] = prior.slope_std**-2.0
        self.precision[5:] = prior.rotation_std**-2.0
        self.rows = np.empty((_ELEMENTS + 1, 2, n))
        self.whitened = self.rows[_ELEMENTS]
        self.derivatives = np.zeros((PARAMETERS, 3, 3))
        self.at: Array | None = None

    def residual(self, x: Array) -> Array:
        """Squared length (n,) of observed minus predicted in the old frame, whitened."""
        self.at = x
        tx, ty, tz, a, b, *turn = x.tolist()
        self.rotation = np.dot(self.rotation0, exp_so3(turn))
        self.to_seen = towards((tx, ty, tz), (-a, -b, 1.0))
        there = np.dot(np.dot(self.rotation, self.to_seen), self.p)
        self.inverse = 1.0 / there[2]
        u, v = self.projected = there[:2] * self.inverse
        seen, out = self.columns[2], self.whitened
        np.multiply(self.c11, u, out=seen[0])
        seen[0] += self.c12 * v
        np.multiply(self.c22, v, out=seen[1])
        np.subtract(self.observed, seen, out=out)
        square = out * out
        return np.add(square[0], square[1])

    @property
    def raw(self) -> Points:
        """Observed minus predicted (n, 2), normalised."""
        return (self.q - self.projected).T

    def normal_equations(self, x: Array, weight: Array, noise: float) -> tuple[Array, Array]:
        """Gauss-Newton matrix (8, 8) and right-hand side (8,) at x."""
        if self.at is not x:
            self.residual(x)
        rows = self.rows
        self._elements()
        weighted = rows[:_ELEMENTS] * (weight * noise**-2)
        product = np.dot(weighted.reshape(_ELEMENTS, -1), rows.reshape(_ELEMENTS + 1, -1).T)
        k = self._derivatives(x)
        reduced = np.dot(k, product)
        hessian = np.dot(reduced[:, :_ELEMENTS], k.T)
        hessian.ravel()[:: PARAMETERS + 1] += self.precision
        return hessian, reduced[:, _ELEMENTS] - self.precision * x

    def sensitivity(
        self, x: Array, weight: Array, noise: float, new_moves: Points, old_moves: Points
    ) -> Sensitivity:
        """What moving the new and the old points by these (n, 2) per unit does, at the solution x."""
        self.residual(x)
        left = self.whitened.copy()
        step = 1e-3
        there = np.dot(np.dot(self.rotation, self.to_seen), self.p + step * _homogeneous(new_moves))
        moved = old_moves.T - (there[:2] / there[2] - self.projected) / step
        changed = np.stack((self.c11 * moved[0] + self.c12 * moved[1], self.c22 * moved[1]))
        weighted = changed * (weight * noise**-2)
        gradient = self._derivatives(x) @ (self._elements() @ weighted.ravel())
        return Sensitivity(gradient, float((weighted * changed).sum()), -float((weighted * left).sum()))

    def gradients(self, x: Array, weight: Array, noise: float, new_moves: Array, old_moves: Array) -> Array:
        """J^T W r_k (8, k) of moving the new and the old points by these (k, n, 2), at the solution x."""
        self.residual(x)
        matrix = np.dot(self.rotation, self.to_seen)
        there = np.matmul(matrix[:, :2], new_moves.transpose(0, 2, 1))
        moved = old_moves.transpose(0, 2, 1) - (there[:, :2] - self.projected * there[:, 2:]) * self.inverse
        changed = np.empty_like(moved)
        changed[:, 0] = self.c11 * moved[:, 0] + self.c12 * moved[:, 1]
        changed[:, 1] = self.c22 * moved[:, 1]
        changed *= weight * noise**-2
        return np.asarray(self._derivatives(x) @ (self._elements() @ changed.reshape(len(moved), -1).T))

    def _elements(self) -> Array:
        """What the elements of M do to the whitened residuals (9, 2n), where ``residual`` was called last."""
        # (row of M, column of M, u and v, track)
        elements = self.rows[:_ELEMENTS].reshape(3, 3, 2, len(self.inverse))
        np.multiply(self.columns[:, None], (self.p * self.inverse)[None, :, None], out=elements)
        # the third row lowers what is projected
        np.negative(elements[2], out=elements[2])
        return self.rows[:_ELEMENTS].reshape(_ELEMENTS, -1)

    def _derivatives(self, x: Array) -> Array:
        """d M / d x (8, 9) at x, M row by row."""
        k, rotation = self.derivatives, self.rotation
        # M = R - (R t) n^T, n = (-a, -b, 1)
        np.multiply(rotation.T[:, :, None], np.array((x[3], x[4], -1.0)), out=k[:3])
        k[3, :, 0] = k[4, :, 1] = np.dot(rotation, x[:3])
        np.matmul(np.matmul(rotation, _TURNS), self.to_seen, out=k[5:])
        return k.reshape(PARAMETERS, _ELEMENTS)

    def scale(self, length2: Array, refine: bool) -> float:
        """Noise per coordinate: from the median, refined by the mean square of the residuals near it."""
        rising = np.sort(length2)
        noise2 = float(rising[len(rising) // 2]) / _MEDIAN
        if refine:
            total = rising.cumsum()
            # with half the tracks wrong the median is far too large: again until what is inside agrees
            for _ in range(_SCALE_ROUNDS):
                inside = int(rising.searchsorted(noise2 * 2 * _TRUNCATION))
                if inside <= PARAMETERS:
                    break
                # about three of the eight parameters' degrees of freedom come off the pairs within the cut
                last, noise2 = noise2, float(total[inside - 1]) / (2 * _SHARE * max(inside - 3.0, 1.0))
                if abs(noise2 - last) < _SCALE_SETTLED * last:
                    break
        floor, cap = self.prior.noise_floor, self.prior.noise_cap
        return float(min(max(math.sqrt(noise2), floor), cap))

    def weigh(self, x: Array, length2: Array, noise: float, cut: float) -> tuple[Array, float]:
        """Tukey's weights (n,) and the cost at x."""
        left = np.maximum(1.0 - length2 * (cut * noise) ** -2.0, 0.0)
        weight = left * left
        tukey = (len(left) - float(np.dot(weight, left))) * cut**2 / 6
        return weight, tukey + 0.5 * float(np.dot(self.precision, x * x))


def _homogeneous(moves: Points) -> Array:
    """Moves (n, 2) of normalised points as those of homogeneous ones (3, n)."""
    return np.concatenate((moves.T, np.zeros((1, len(moves)))))
