"""What every estimator returns: the plane under the camera and the motion over it, at the newest frame."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

NAN = math.nan
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RotationError:
    """Error of the measured rotation old_from_new that a fit found: R = R0 exp(mean), in the newest camera's axes.

    ``mean`` (3,) rad with its ``covariance`` (3, 3), under a prior of zero mean and ``prior_std`` (3,).
    """

    mean: Array
    covariance: Array
    prior_std: Array


@dataclass(frozen=True, slots=True)
class RowsError:
    """What a fit says of the rows' readout: the fit and how it changes, per second of readout.

    ``parameters`` (8,) and ``covariance`` (8, 8) as in ``PlaneFit``; ``gradient``, ``information`` and ``score`` as in
    ``Sensitivity``. ``difference`` (2,) of the slopes to those fused before, the information (2, 2) of the latter and
    how they change themselves (2,), zero where nothing was there before or it disagrees.
    """

    parameters: Array
    covariance: Array
    gradient: Array
    information: float
    score: float
    difference: Array
    before: Array
    before_gradient: Array


@dataclass(frozen=True, slots=True)
class Plane:
    """Surface Z = h + aX + bY in the newest camera frame, and omega = V / h in 1/s.

    ``status`` is "ok" or a reason. ``slope_covariance`` (2, 2) is of (a, b). ``slots`` (n,) names the tracks
    used, ``inlier`` (n,) which of them move as the plane says, ``weight`` (n,) how much each
    counted. ``t`` (3,) is the displacement from the newest
    to the older exposure over h, ``baseline`` the gap in frames. Unknown numbers are NaN.
    """

    status: str
    a: float = NAN
    b: float = NAN
    slope_covariance: Array = field(default_factory=lambda: np.full((2, 2), NAN))
    omega: Array = field(default_factory=lambda: np.full(3, NAN))
    omega_std: Array = field(default_factory=lambda: np.full(3, NAN))
    divergence: float = NAN
    time_to_contact_s: float = NAN
    gap: int = 0
    t: Array = field(default_factory=lambda: np.full(3, NAN))
    old_from_new: Array = field(default_factory=lambda: np.eye(3))
    slots: NDArray[np.intp] = field(default_factory=lambda: np.empty(0, np.intp))
    inlier: NDArray[np.bool_] = field(default_factory=lambda: np.empty(0, bool))
    weight: Array = field(default_factory=lambda: np.empty(0))
    residual: Array = field(default_factory=lambda: np.empty((0, 2)))
    noise: float = NAN
    inlier_fraction: float = NAN
    fit_error: float = NAN
    """Mean distance of the tracks, outliers too, from where the fit has them, normalised units."""
    rotation_error: RotationError | None = None
    rows_error: RowsError | None = None

    def weights(self, capacity: int) -> Array:
        """The weight of every slot (capacity,); those that were not used count as inliers."""
        out = np.ones(capacity)
        out[self.slots] = self.weight
        return out

    @property
    def normal(self) -> Array:
        """(-a, -b, 1) (3,): from the surface towards the ground, camera frame, not of unit length."""
        return np.array((-self.a, -self.b, 1.0))
