"""Whether pictures, gyro and velocity speak of one motion; while they do not, there is no estimate.

Four comparisons, each with its own statistic: the rotation that the tracks of a short time show, against the
vehicle's and what both may be wrong by; the motion over the plane against the autopilot's velocity, whose direction
must agree for some height, and whose changes show whether the ground moves by itself; the height by that velocity
against the rangefinder's; the lateness of the frames against what it was and against the bound of the search. All but
the last are means over the last second or two of chi-square per degree of freedom: 1 where all is well, whatever the
noise.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from landing.reasons import Status

Array = NDArray[np.float64]

_FORGET_S = 1.5
"""Time constant of the means, s."""

_ROTATION_FAILS, _VELOCITY_FAILS = 3.0, 4.0
"""Mean chi-square per degree of freedom above which a comparison fails."""

_HEIGHT_FAILS, _LEAST_HEIGHT = 6.0, 12.0
"""The same of the height's two sources, whose errors last: two and a half standard deviations, for about a second."""

_HOLDS = 1.5
"""The same below which it holds again."""

_LEAST_ROTATION, _LEAST_VELOCITY = 12.0, 30.0
"""Degrees of freedom behind a mean before it may fail; rotations come ten times a second, velocities at each frame."""

_DRIFT = 0.3
"""Slow error of the autopilot's velocity, one sigma of an axis, m/s: GPS drift, a slow filter, wind estimates."""

_MOVES_M_S, _MOVES_SIGMAS, _RESTS_M_S = 0.6, 2.0, 0.4
"""Speed of the ground that fails by that many standard deviations, above GPS drift, and the one that holds again."""

_INVERSE_HEIGHTS = 1.0 / np.geomspace(0.3, 200.0, 60)
"""Heights at which the velocity is compared, 1/m."""

_LATE_CHANGE_S, _LATE_SETTLED_S, _LATE_FORGET_S, _LATE_SIGMAS = 0.03, 0.004, 30.0, 5.0


@dataclass(slots=True)
class Mean:
    """A mean of chi-square per degree of freedom that forgets, and whether it fails (with hysteresis)."""

    limit: float
    least_weight: float
    total: float = 0.0
    weight: float = 0.0
    fails: bool = False

    def step(self, chi2: float, freedom: float, passed_s: float) -> None:
        """Take one comparison with ``freedom`` degrees of freedom; 0: none was possible, time passes."""
        kept = math.exp(-max(passed_s, 0.0) / _FORGET_S)
        self.total, self.weight = kept * self.total + chi2, kept * self.weight + freedom
        mean = self.total / self.weight if self.weight > 0 else 0.0
        if self.weight >= self.least_weight:
            self.fails = mean > (_HOLDS if self.fails else self.limit)


def velocity_chi2(velocity: Array, velocity_std: float, omega: Array, omega_std: Array) -> float:
    """Chi-square, 2 degrees of freedom, of omega = velocity / h for the height h that suits best; nan: unknown.

    ``velocity`` (3,) m/s and ``omega`` (3,) 1/s in the camera frame, ``velocity_std`` and ``omega_std`` (3,) one sigma.
    """
    known = np.isfinite(omega) & np.isfinite(omega_std)
    if np.count_nonzero(known) < 2:
        return math.nan
    inverse = _INVERSE_HEIGHTS[:, None]
    variance = omega_std[known] ** 2 + (inverse * math.hypot(velocity_std, _DRIFT)) ** 2
    left = omega[known] - inverse * velocity[known]
    return float(np.min(np.sum(left**2 / variance, axis=1)))


class Contradictions:
    """Feed it every frame; ``failing`` names the comparisons that fail, the first one is the status."""

    def __init__(self) -> None:
        self._anew()
        self._late_before_s: float | None = None
        self._late_fails = self._ground_moves = False
        self._last_s: float | None = None

    @property
    def failing(self) -> tuple[Status, ...]:
        """The comparisons that fail now."""
        all_of_them = (
            (Status.ROTATION_CONTRADICTS, self._rotation.fails),
            (Status.VELOCITY_CONTRADICTS, self._velocity.fails or self._ground_moves),
            (Status.LATENESS_CONTRADICTS, self._late_fails),
            (Status.HEIGHT_CONTRADICTS, self._height.fails),
        )
        return tuple(status for status, fails in all_of_them if fails)

    def step(
        self,
        time_s: float,
        rotation: tuple[float, int],
        velocity_chi2_: float,
        ground: tuple[float, float],
        late_s: float,
        late_std_s: float,
        late_at_bound: bool = False,
        height_chi2: float = math.nan,
    ) -> None:
        """Take a frame's comparisons: chi-square and degrees of freedom, chi-square (nan: none), lateness.

        ``ground``: the ground's own speed with its standard deviation, m/s (nan: unknown). ``late_at_bound``: the
        lateness is at least so much, farther is not looked for. ``height_chi2``, one degree of freedom (nan: none): the
        height's two sources.
        """
        passed_s = 0.0 if self._last_s is None else time_s - self._last_s
        self._last_s = time_s
        self._rotation.step(*rotation, passed_s)
        known = math.isfinite(velocity_chi2_)
        self._velocity.step(velocity_chi2_ if known else 0.0, 2.0 if known else 0.0, passed_s)
        known = math.isfinite(height_chi2)
        self._height.step(height_chi2 if known else 0.0, 1.0 if known else 0.0, passed_s)
        self._step_ground(*ground)
        self._step_lateness(late_s, late_std_s, late_at_bound, passed_s)

    def began_elsewhere(self) -> None:
        """The lateness is found for the first time, far from where it was looked for: it has not changed.

        What was compared before was of other moments.
        """
        self._anew()
        self._late_before_s = None

    def _anew(self) -> None:
        self._rotation = Mean(_ROTATION_FAILS, _LEAST_ROTATION)
        self._velocity = Mean(_VELOCITY_FAILS, _LEAST_VELOCITY)
        self._height = Mean(_HEIGHT_FAILS, _LEAST_HEIGHT)

    def _step_ground(self, speed_m_s: float, std_m_s: float) -> None:
        if speed_m_s - _MOVES_SIGMAS * std_m_s > _MOVES_M_S:
            self._ground_moves = True
        elif speed_m_s < _RESTS_M_S:
            self._ground_moves = False

    def _step_lateness(self, late_s: float, std_s: float, at_bound: bool, passed_s: float) -> None:
        changed = False
        if self._late_before_s is not None:
            change_s = late_s - self._late_before_s
            changed = abs(change_s) > max(_LATE_CHANGE_S, _LATE_SIGMAS * std_s)
            self._late_before_s += change_s * (1 - math.exp(-max(passed_s, 0.0) / _LATE_FORGET_S))
        elif std_s < _LATE_SETTLED_S and not at_bound:
            self._late_before_s = late_s
        self._late_fails = at_bound or changed
