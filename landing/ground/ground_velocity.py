"""Whether the ground below moves by itself: its velocity, from how the vehicle's velocity follows the ventral flow.

The view shows w = (v - g) / d: the velocity over the ground divided by the distance d along the plane's normal, with v
the vehicle's velocity and g the ground's. So v = d w + g + b with b the autopilot's slow error: a line whose slope is
the distance and whose intercept is the ground's velocity. Level b and g are one number here. The vehicle's velocity is
the response and the flow the regressor, since the flow has the smaller error: noise of a regressor would make the slope
too small (Fuller, Measurement Error Models, 1987, section 1.1). Where the velocity does not vary the line is not
known, and the covariance says so. A Kalman filter carries slope and intercept on: d changes by the approach that the
view shows, g and b wander.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from landing.motion.velocity import displacements
from landing.motion.views import Views
from landing.options import EstimatorOptions
from landing.plane.plane import Plane
from landing.reasons import Status

Array = NDArray[np.float64]

_FIRST_M, _FIRST_STD_M, _FIRST_STD_M_S = 5.0, 50.0, 2.0
"""Distance and its standard deviation before anything is seen, and that of the ground's velocity (of an axis)."""
_VERTICAL_STD_M_S = 0.3
"""Slow error of the vertical velocity, one sigma: ground that lies does not rise."""
_LAG_STD_S = 0.2
"""How late a slow filter's velocity is, one sigma."""
_WANDERS_M_S = 0.05
"""What the slow error of the velocity changes by within a second, one sigma of an axis."""
_UNEVEN = 0.05
"""Relative change of the distance within a second that the approach does not show: new ground comes below."""
_UNSEEN, _UNSEEN_M_S = 0.1, 0.3
"""Both while nothing is seen of the ground: the height is kept, and what comes below may be another ground."""
_NOISE_M_S = 0.03
"""Error of the vehicle's mean velocity over the interval, beside its noise, one sigma of an axis."""
_SHARE, _SHARE_LEVEL = 0.02, 0.2
"""Error of a ventral flow as a share of it: the ground is not one plane, or the plane is taken to be level."""
_FARTHEST_M = 60.0
"""Distance up to which an error of the flow counts as an error of the velocity."""
_GATE = 16.0
"""Chi-square, 3 degrees of freedom, above which what was known does not hold: another ground below."""
_ANEW_M_S = 0.5
"""What the ground's velocity may have changed by then, and half the distance with it."""
_KNOWN = 0.5
"""Largest relative standard deviation of a distance that is known."""
_EVERY_S = 0.1
"""From one measurement to the next: those of half a second that overlap by more say the same again."""
_LONGEST_S = 5.0
"""After a gap longer than this all begins anew."""


@dataclass(frozen=True, slots=True)
class Passage:
    """How vehicle and view moved over the ``interval_s`` before the newest frame; vectors (3,) NED.

    ``flow`` 1/s: the mean velocity over the ground by the distance along the plane's normal at the newest frame, with
    ``flow_std``. ``velocity`` m/s: the vehicle's mean velocity, with ``noise`` of an axis, and ``acceleration`` m/s^2
    its mean change. ``approach`` 1/s: the speed towards the plane over the distance.
    """

    interval_s: float
    flow: Array
    flow_std: Array
    velocity: Array
    noise: float
    acceleration: Array
    approach: float


def passage(views: Views, plane: Plane, options: EstimatorOptions) -> Passage | None:
    """What the newest frames show; None where tracks, attitude or the vehicle's velocity are missing.

    In a hover too little moves for a plane; for so small a flow any plane gives the velocity, and a level one is taken.
    """
    newest, o = views.newest, options
    if views.longest < 1 or newest.ned_from_camera is None:
        return None
    gap = views.reach(o.guided_span_s)
    gaps = np.array([gap])
    way = views.detour(gaps, o.velocity_max_age_s, o.max_acceleration)
    before = views.view(gap).velocity_ned
    if way is None or newest.velocity_ned is None or before is None:
        return None
    normal, noise, share = plane.normal, plane.noise, _SHARE
    if not np.all(np.isfinite(normal)):
        if plane.status != Status.MOTION_TOO_SMALL or newest.ned_from_camera[2, 2] <= 0:
            return None
        normal, share = newest.ned_from_camera[2] / newest.ned_from_camera[2, 2], _SHARE_LEVEL
    weight = plane.weights(len(views.tracker.alive))
    moved = displacements(
        views, gaps, normal, weight, noise if math.isfinite(noise) else 1.0, views.baseline_std(gap), o
    )
    if moved is None:
        return None
    interval_s, length = float(moved.tau[-1]), float(np.linalg.norm(normal))
    share = math.hypot(share, misfit(plane.fit_error, float(np.linalg.norm(moved.t[-1]))))
    to_ned = newest.ned_from_camera * (-length / interval_s)
    flow = to_ned @ moved.t[-1]
    flow_std = np.sqrt(to_ned**2 @ moved.covariance[:, -1, -1] + (share * float(np.linalg.norm(flow))) ** 2)
    return Passage(
        interval_s,
        flow,
        flow_std,
        newest.ned_from_camera @ (way[0] - way[1][-1] / interval_s),
        newest.velocity_noise / 2,
        (newest.velocity_ned - before) / interval_s,
        float(newest.ned_from_camera @ normal @ flow) / length,
    )


def misfit(fit_error: float, shift: float) -> float:
    """Share of the motion over the ground that one plane leaves unexplained: over a roof's ridge or a step it is large.

    ``fit_error``: mean residual of the tracks, normalised units; ``shift``: the displacement over the distance.
    """
    if not math.isfinite(fit_error):
        return 0.0
    return min(fit_error / shift, 1.0) if shift > 0 else 1.0


class GroundVelocity:
    """Feed it every frame; ``speed_m_s`` with ``std_m_s`` is the ground's own speed, with the velocity's slow error."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Nothing is known."""
        # distance; the ground's velocity north, east, and the vertical error; the velocity's lateness
        self._state = np.array((_FIRST_M, 0.0, 0.0, 0.0, 0.0))
        self._covariance = np.diag(
            np.square((_FIRST_STD_M, _FIRST_STD_M_S, _FIRST_STD_M_S, _VERTICAL_STD_M_S, _LAG_STD_S))
        )
        self._approach = math.nan
        """That of the last measurement; NaN: the last frame showed none."""
        self._since_s = 0.0
        """Since the last measurement."""

    @property
    def distance_m(self) -> float:
        """Distance along the plane's normal, m; NaN where it is not known."""
        distance, std = float(self._state[0]), math.sqrt(self._covariance[0, 0])
        return distance if std <= _KNOWN * distance else math.nan

    @property
    def distance_std_m(self) -> float:
        """Standard deviation of the distance, m; NaN where it is not known."""
        return math.sqrt(self._covariance[0, 0]) if math.isfinite(self.distance_m) else math.nan

    @property
    def velocity(self) -> Array:
        """The ground's velocity (2,) north and east, m/s."""
        return self._state[1:3].copy()

    @property
    def speed_m_s(self) -> float:
        """The ground's speed; NaN where it is unknown."""
        known = math.isfinite(self.distance_m)
        return float(np.linalg.norm(self._state[1:3])) if known else math.nan

    @property
    def std_m_s(self) -> float:
        """Standard deviation of the ground's velocity along the axis that is known least; NaN: unknown."""
        if not math.isfinite(self.distance_m):
            return math.nan
        (nn, ne), (_, ee) = self._covariance[1:3, 1:3].tolist()
        return math.sqrt((nn + ee) / 2 + math.hypot((nn - ee) / 2, ne))

    def follow(self, passed_s: float, look: Callable[[], Passage | None], sink_m_s: float = 0.0) -> None:
        """Take a frame ``passed_s`` after the last one: ``look`` where it is time to, else carry on as seen last."""
        due = self._since_s + passed_s >= 0.9 * _EVERY_S
        if due or not math.isfinite(self._approach) or not 0 <= passed_s <= _LONGEST_S:
            self.step(passed_s, look(), sink_m_s)
        else:
            self._since_s += passed_s
            self._carry(passed_s, self._approach, sink_m_s)

    def step(self, passed_s: float, seen: Passage | None, sink_m_s: float = 0.0) -> None:
        """Take what a frame ``passed_s`` after the last one shows; the vehicle sinks at ``sink_m_s``."""
        if not 0 <= passed_s <= _LONGEST_S:
            self.forget()
            return
        self._approach = math.nan if seen is None else seen.approach
        self._carry(passed_s, self._approach, sink_m_s)
        if seen is not None:
            self._update(self._since_s + passed_s, seen)
        self._since_s = 0.0

    def _carry(self, passed_s: float, approach: float, sink_m_s: float) -> None:
        x, p = self._state, self._covariance
        if math.isfinite(approach):
            uneven, wanders = _UNEVEN, _WANDERS_M_S
            nearer = math.exp(-min(max(approach * passed_s, -0.5), 0.5))
            x[0] *= nearer
            p[0] *= nearer
            p[:, 0] *= nearer
        else:
            uneven, wanders = _UNSEEN, _UNSEEN_M_S
            x[0] -= sink_m_s * passed_s
        p[0, 0] += (uneven * x[0]) ** 2 * passed_s
        for axis, rate in ((1, wanders), (2, wanders), (3, _WANDERS_M_S)):
            p[axis, axis] += rate**2 * passed_s

    def _update(self, passed_s: float, seen: Passage) -> None:
        x, p = self._state, self._covariance
        distance = min(max(float(x[0]), 0.0), _FARTHEST_M)
        rows = np.zeros((3, 5))
        rows[:, 0], rows[:, 4] = seen.flow, -seen.acceleration
        rows[:, 1:4] = np.eye(3)
        noise = np.diag(_NOISE_M_S**2 + seen.noise**2 + (distance * seen.flow_std) ** 2)
        left = seen.velocity - rows @ x
        # intervals that overlap share their errors
        share = min(1.0, passed_s / seen.interval_s)
        if float(left @ np.linalg.solve(rows @ p @ rows.T + noise, left)) > _GATE:
            p += share * np.diag((0.25 * distance**2, *[_ANEW_M_S**2] * 3, 0.0))
        noise /= max(share, 1e-6)
        gain = np.linalg.solve(rows @ p @ rows.T + noise, rows @ p).T
        kept = np.eye(5) - gain @ rows
        self._state = x + gain @ left
        self._covariance = kept @ p @ kept.T + gain @ noise @ gain.T
