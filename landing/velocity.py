"""The velocity over height at the newest frame, from displacements over a few short gaps.

Over a longer interval noise counts less, but the vehicle accelerates under way. What the autopilot knows of its own
velocity tells how it changed: slow errors, which spoil the velocity itself, fall out of the difference.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from landing.motion import OverPlane
from landing.options import EstimatorOptions
from landing.views import Views

Array = NDArray[np.float64]

_PARTS = (1 / 3, 2 / 3, 1.0)
"""The gaps, as parts of the interval."""


@dataclass(frozen=True, slots=True)
class _Moved:
    """Displacements over height ``t`` (g, 3) to the frames ``tau`` (g,) s before the newest, ``variance`` (g, 3)."""

    tau: Array
    t: Array
    variance: Array


def velocity(
    views: Views, normal: Array, weight: Array, noise: float, rotation_std: float, options: EstimatorOptions
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
    moved = _moved(views, _gaps(views, o.motion_span_s), normal, weight, noise, rotation_std, o.shared_noise)
    return None if moved is None else _newest(moved, moved.t, o.acceleration_std)[:2]


def _guided(
    views: Views, normal: Array, weight: Array, noise: float, rotation_std: float, options: EstimatorOptions
) -> tuple[Array, Array] | None:
    """The velocity with its changes taken from the autopilot; None where it does not know them or is mistaken."""
    o = options
    gaps = _gaps(views, o.guided_span_s)
    change = views.detour(gaps, o.velocity_max_age_s, o.max_acceleration)
    if change is None:
        return None
    moved = _moved(views, gaps, normal, weight, noise, rotation_std, o.shared_noise)
    if moved is None:
        return None
    vehicle, detour = change
    # the whole way over the longest gap, in heights and in metres
    way = (detour[-1] - vehicle * moved.tau[-1]).tolist()
    square = sum(x * x for x in way)
    per_metre = (
        sum(x * t for x, t in zip(way, moved.t[-1].tolist(), strict=True)) / square if square > 0 else 0.0
    )
    if per_metre <= 0:
        return None
    known = per_metre * detour
    share_std = math.hypot(o.guided_share_std, o.guided_velocity_std * moved.tau[-1] / math.sqrt(square))
    omega, std, chi_square = _newest(moved, moved.t - known, o.guided_acceleration_std, share_std * known)
    return (omega, std) if chi_square <= o.velocity_agreement else None


def _gaps(views: Views, span_s: float) -> NDArray[np.intp]:
    reach = views.reach(span_s)
    return np.array(sorted({max(1, round(part * reach)) for part in _PARTS}))


def _moved(
    views: Views,
    gaps: NDArray[np.intp],
    normal: Array,
    weight: Array,
    noise: float,
    rotation_std: float,
    shared_noise: float,
) -> _Moved | None:
    tracks, derotated = views.stack(gaps)
    # a rotation shows in the curvature of the flow alone, where errors that neighbouring tracks share count most
    std = np.full(3, rotation_std / (shared_noise * noise))
    over = OverPlane(tracks.new, derotated, normal, tracks.whitener, turns=True)
    found = over.displacement(weight.take(tracks.slots), std)
    if found is None:
        return None
    tau = np.array([views.newest.time_s - views.view(int(gap)).time_s for gap in gaps])
    variance = found[1].diagonal(axis1=1, axis2=2)[:, :3] * noise**2
    return _Moved(tau, found[0][:, :3], variance)


def _newest(
    moved: _Moved, t: Array, acceleration_std: float, doubtful: Array | None = None
) -> tuple[Array, Array, float]:
    """omega (3,), its standard deviation (3,), and the chi-square of the displacements ``t`` (g, 3).

    ``doubtful`` (g, 3) is a displacement at one standard deviation that each axis may have a share of.
    """
    # columns: velocity, acceleration and share at one standard deviation, what is observed
    columns = np.zeros((3, 4, len(t)))
    columns[:, 0], columns[:, 1] = -moved.tau, moved.tau**2 * (acceleration_std / 2)
    if doubtful is not None:
        columns[:, 2] = doubtful.T
    columns[:, 3] = t.T
    weighted = columns / moved.variance.T[:, None]
    found = [_solved(product) for product in np.matmul(weighted, columns.transpose(0, 2, 1)).tolist()]
    omega, std, chi_square = zip(*found, strict=True)
    return np.array(omega), np.array(std), sum(chi_square)


def _solved(product: list[list[float]]) -> tuple[float, float, float]:
    """The velocity, its standard deviation and the chi-square, from the products of the columns.

    Acceleration and share have a prior of zero mean and unit variance; they are eliminated one after the other. NaN and
    an infinite chi-square where nothing of the velocity is left.
    """
    (vv, va, vs, vt), (_, aa, sa, at), (_, _, ss, st), (_, _, _, tt) = product
    aa += 1.0
    v, s, t = va / aa, sa / aa, at / aa
    vv, vs, vt, ss, st, tt = (
        vv - v * va,
        vs - v * sa,
        vt - v * at,
        ss - s * sa + 1.0,
        st - s * at,
        tt - t * at,
    )
    v, t = vs / ss, st / ss
    vv, vt, tt = vv - v * vs, vt - v * st, tt - t * st
    if not vv > 0:
        return math.nan, math.nan, math.inf
    return vt / vv, 1.0 / math.sqrt(vv), tt - vt * vt / vv
