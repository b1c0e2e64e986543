"""The velocity over height at the newest frame, from displacements over a few short gaps.

Over a longer interval noise counts less, but the vehicle accelerates under way. What the autopilot knows of its own
velocity gives its change: slow errors of the velocity cancel in the difference.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from landing.motion.motion import OverPlane
from landing.motion.views import Views
from landing.options import EstimatorOptions

Array = NDArray[np.float64]

_PARTS = (1 / 3, 2 / 3, 1.0)
"""The gaps, as parts of the interval."""
_SHARED_NOISE = 2.0
"""Noise of a displacement, over that of tracks that share no errors."""


@dataclass(frozen=True, slots=True)
class Moved:
    """Displacements over height ``t`` (g, 3) to the frames ``tau`` (g,) s before the newest.

    ``covariance`` (3, g, g) of their errors, for each axis.
    """

    tau: Array
    t: Array
    covariance: Array

    def accelerated(self, acceleration_std: float) -> Array:
        """The covariance with that of an unknown constant acceleration over height, 1/s^2."""
        bend = self.tau * self.tau * (acceleration_std / 2)
        return self.covariance + bend[:, None] * bend


@dataclass(frozen=True, slots=True)
class VehicleVelocity:
    """What the vehicle says of its velocity, in camera axes: ``velocity`` (3,) m/s at the newest frame.

    ``detour`` (g, 3) m: where the camera was in earlier frames, less where it would have been at that velocity.
    ``std`` m/s is that of the slow error of all axes, ``noise`` m/s that of the newest alone.
    """

    velocity: Array
    detour: Array
    std: float
    noise: float


def velocity(
    views: Views, normal: Array, weight: Array, noise: float, rotation_std: Array, options: EstimatorOptions
) -> tuple[Array, Array] | None:
    """omega = V / h (3,) at the newest frame and its standard deviation (3,), 1/s.

    ``weight`` holds one weight for every slot of the tracker, ``noise`` the whitened noise. Displacements are fitted
    by t(T) = -omega T + A T^2 / 2, so that the result holds at the newest frame and not in the middle of a gap. The
    vehicle's velocity, where it is known and the images do not contradict it, gives A but for a remainder.
    """
    if views.longest < 1:
        return None
    o = options
    guided = _guided(views, normal, weight, noise, rotation_std, o)
    if guided is not None:
        return guided
    moved = displacements(views, _gaps(views, o.motion_span_s), normal, weight, noise, rotation_std, o)
    return None if moved is None else newest(moved.tau, moved.t, moved.accelerated(o.acceleration_std))


def _guided(
    views: Views, normal: Array, weight: Array, noise: float, rotation_std: Array, options: EstimatorOptions
) -> tuple[Array, Array] | None:
    """The velocity with its changes taken from the autopilot; None where it does not know them or is mistaken."""
    o = options
    gaps = _gaps(views, o.guided_span_s)
    change = views.detour(gaps, o.velocity_max_age_s, o.max_acceleration)
    if change is None:
        return None
    moved = displacements(views, gaps, normal, weight, noise, rotation_std, o)
    if moved is None:
        return None
    measured = VehicleVelocity(
        *change, o.guided_velocity_std * views.newest.velocity_factor, views.newest.velocity_noise
    )
    # the whole way over the longest gap, in heights and in metres
    way = measured.detour[-1] - measured.velocity * moved.tau[-1]
    square = float(np.dot(way, way))
    per_metre = float(np.dot(way, moved.t[-1])) / square if square > 0 else 0.0
    if per_metre <= 0:
        return None
    covariance = moved.accelerated(o.guided_acceleration_std * per_metre)
    found = newest_guided(moved.tau, moved.t, covariance, measured, per_metre)
    return found[:2] if found[2] <= o.velocity_agreement else None


def _gaps(views: Views, span_s: float) -> NDArray[np.intp]:
    reach = views.reach(span_s)
    return np.array(sorted({max(1, round(part * reach)) for part in _PARTS}))


def displacements(
    views: Views,
    gaps: NDArray[np.intp],
    normal: Array,
    weight: Array,
    noise: float,
    rotation_std: Array,
    options: EstimatorOptions,
) -> Moved | None:
    tracks, derotated = views.stack(gaps)
    # a rotation shows in the curvature of the flow alone, where errors that neighbouring tracks share count most
    noise *= _SHARED_NOISE
    over = OverPlane(tracks.new, derotated, normal, tracks.whitener, turns=True)
    found = over.displacement(weight.take(tracks.slots), rotation_std / noise)
    if found is None:
        return None
    newest_s = views.newest.time_s
    tau = np.array([newest_s - views.view(gap).time_s for gap in gaps.tolist()])
    alone = np.eye(len(gaps))
    covariance = found[1].diagonal(axis1=1, axis2=2)[:, :3].T[:, :, None] * (alone * noise**2)
    # what is wrong with a whole frame, its attitude or all its matches alike: the newest one's is in every gap
    matches = (options.shared_error_px / views.camera.focal_px) ** 2
    covariance[:2] += (options.attitude_error_std_rad**2 + matches) * (alone + 1.0)
    covariance[2] += matches * (alone + 1.0)
    return Moved(tau, found[0][:, :3], covariance)


def newest(tau: Array, t: Array, covariance: Array) -> tuple[Array, Array]:
    """omega (3,) and its standard deviation (3,) from t(T) = -omega T, by generalised least squares.

    ``t`` (g, 3) over ``tau`` (g,) with errors of ``covariance`` (3, g, g). NaN where nothing is left of omega.
    """
    weighted = np.linalg.solve(covariance, np.broadcast_to(tau[:, None], (3, len(tau), 1)))[..., 0]
    information = weighted @ tau
    information[information <= 0] = math.nan
    return -(weighted * t.T).sum(axis=1) / information, information**-0.5


def newest_guided(
    tau: Array, t: Array, covariance: Array, measured: VehicleVelocity, per_metre: float
) -> tuple[Array, Array, float]:
    """omega (3,), its standard deviation (3,) and the chi-square of the fit, by generalised least squares.

    t(T) = -omega T + k detour(T), omega = k (velocity - error): four unknowns, omega and the scale k (1/m), for which
    ``per_metre`` stands in the error's share only. ``t`` and ``covariance`` as for ``newest``.
    """
    columns = np.empty((3, 3, len(tau)))
    columns[:, 0], columns[:, 1], columns[:, 2] = -tau, measured.detour.T, t.T
    product = columns @ np.linalg.solve(covariance, columns.transpose(0, 2, 1))
    precision = (per_metre * measured.std) ** -2.0
    omega, slope, std2 = [0.0] * 3, [0.0] * 3, [0.0] * 3
    information = right = 0.0
    for axis, ((vv, vk, vt), (_, kk, kt), _) in enumerate(product.tolist()):
        measured_speed = float(measured.velocity[axis])
        vv, vk, kk = (
            vv + precision,
            vk - precision * measured_speed,
            kk + precision * measured_speed * measured_speed,
        )
        # omega is eliminated
        omega[axis], slope[axis], std2[axis] = vt / vv, vk / vv, 1 / vv
        information += kk - vk * vk / vv
        right += kt - vk * vt / vv
    # numbers that no vehicle flies at leave nothing of it
    k = right / information if information > 0 else 0.0
    if not k > 0:
        return np.full(3, math.nan), np.full(3, math.nan), math.inf
    found = np.array([w - s * k for w, s in zip(omega, slope, strict=True)])
    std = np.sqrt(
        [v + s * s / information + (k * measured.noise) ** 2 for v, s in zip(std2, slope, strict=True)]
    )
    # from the residuals: the difference of the sums above cancels to below zero when the velocity is absurd
    left = t.T + found[:, None] * tau - k * measured.detour.T
    chi_square = float((left * np.linalg.solve(covariance, left[..., None])[..., 0]).sum())
    return found, std, chi_square + precision * float(np.square(found - k * measured.velocity).sum())
