"""How the two autopilots follow LANDING_TARGET, by their source; where they come down was measured too.

ArduCopter: ``AC_PrecLand`` with PLND_TYPE 1 and its Kalman filter, in mode LAND. PX4: ``PrecLand`` of its navigator,
in mode PRECLAND. Neither here has a rangefinder, without which ArduCopter never retries a landing.
"""

import math
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.simulated.vehicle.quaternion import Quaternion, Vector, rotate
from drivers.simulated.vehicle.vehicle import Multirotor

INIT_S, INIT_GAP_S, LOST_S = 2.0, 0.5, 2.0
"""ArduCopter: measurements before the place is used, the longest gap between them, and after which it is lost."""
REJECTS = 3
"""Outliers in a row that are left out; the next one is believed."""
NIS = 3.0
"""Normalised innovation squared from which a measurement is an outlier."""
SEARCH_S, SEARCH_HEIGHT_M, SEARCHES = 10.0, 10.0, 3
"""PX4: PLD_SRCH_TOUT, PLD_SRCH_ALT, PLD_MAX_SRCH."""

Texts = list[tuple[int, str]]


@dataclass(slots=True)
class _Axis:
    """Position of the place along one axis, (m), with its variance."""

    place: float = 0.0
    variance: float = 1.0


@dataclass(slots=True)
class ArduPilotTarget:
    """What AC_PrecLand makes of the messages; the place is kept in the world, in the real one from the vehicle."""

    parameters: dict[str, float]
    texts: Texts
    acquired: bool = False
    _axes: tuple[_Axis, _Axis] = field(default_factory=lambda: (_Axis(), _Axis()))
    _since_s: float | None = None
    _fused_s: float = -math.inf
    _stepped_s: float = 0.0
    _rejected: int = 0
    _said_frame: bool = False

    def take(self, m: Any, attitude: Quaternion, position: Vector, turning: float, time_s: float) -> None:
        """A LANDING_TARGET message; ``turning`` is the size of the rate of turn, rad/s."""
        p = self.parameters
        if p["PLND_ENABLED"] != 1 or p["PLND_TYPE"] != 1 or m.distance <= 0:
            return
        if m.position_valid != 1 or m.frame != mavlink.MAV_FRAME_BODY_FRD:
            if not self._said_frame:
                self._said_frame = True
                self.texts.append((6, "Plnd: Frame not supported "))
            return
        if m.z <= 0:
            return
        n, e, d = rotate(attitude, (m.x, m.y, m.z))
        noise = (d * (0.01 + 0.01 * turning) + 0.02) ** 2
        measured = (position[0] + n, position[1] + e)
        if self._since_s is None:
            self.texts.append((6, "PrecLand: Target Found"))
            self._since_s = self._fused_s = self._stepped_s = time_s
            self._axes = (_Axis(measured[0], noise), _Axis(measured[1], noise))
            return
        drift = (2.5 * 0.0025) ** 2 * max(time_s - self._stepped_s, 0.0) / 0.0025
        self._stepped_s = time_s
        for axis in self._axes:
            axis.variance += drift
        worst = max(
            (z - a.place) ** 2 / (a.variance + noise) for z, a in zip(measured, self._axes, strict=True)
        )
        if worst >= NIS and self._rejected < REJECTS:
            self._rejected += 1
            return
        self._rejected = 0
        self._fused_s = time_s
        for axis, z in zip(self._axes, measured, strict=True):
            gain = axis.variance / (axis.variance + noise)
            axis.place += gain * (z - axis.place)
            axis.variance *= 1 - gain

    def step(self, time_s: float) -> tuple[float, float] | None:
        """North and east of the place to come down on; None while there is none."""
        if self._since_s is None:
            return None
        silent_s = time_s - self._fused_s
        if self.acquired and silent_s > LOST_S:
            self.texts.append((2, "PrecLand: Target Lost"))
            self.acquired, self._since_s = False, None
        elif not self.acquired and silent_s > INIT_GAP_S:
            self.texts.append((2, "PrecLand: Init Failed"))
            self._since_s = None
        elif not self.acquired and time_s - self._since_s > INIT_S:
            self.texts.append((6, "PrecLand: Init Complete"))
            self.acquired = True
        return (self._axes[0].place, self._axes[1].place) if self.acquired else None


@dataclass(slots=True)
class Px4Target:
    """PX4's PRECLAND: over the place at the height it has, then down; without a place it climbs and looks for it."""

    parameters: dict[str, float]
    texts: Texts
    _place: tuple[float, float] = (math.nan, math.nan)
    _heard_s: float = -math.inf
    _state: str = "start"
    _since_s: float = 0.0
    _height_d: float = 0.0
    _searches: int = 0

    def take(self, m: Any, time_s: float) -> None:
        """A LANDING_TARGET message."""
        if m.position_valid and m.frame == mavlink.MAV_FRAME_LOCAL_NED:
            self._place, self._heard_s = (m.x, m.y), time_s
        elif m.position_valid:
            self.texts.append((2, f"Landing target: coordinate system {m.frame} unsupported"))

    def begin(self, position: Vector, time_s: float) -> None:
        """The mode was entered."""
        self._state, self._since_s, self._height_d, self._searches = "start", time_s, position[2], 0

    def step(self, position: Vector, ground_d: float, time_s: float) -> tuple[Vector, bool]:
        """Where to be (NED), and whether to sink there."""
        seen = time_s - self._heard_s <= self.parameters["PLD_BTOUT"]
        here = (position[0], position[1], self._height_d)
        if self._state in ("start", "search") and seen:
            self._go("approach", time_s)
        if self._state == "start" and time_s - self._since_s > 2.0:
            self._searches += 1
            self._go("search" if self._searches <= SEARCHES else "fallback", time_s)
        if self._state == "search":
            if time_s - self._since_s > SEARCH_S:
                self.texts.append((4, "Search timed out"))
                self._go("fallback", time_s)
            return (here[0], here[1], ground_d - SEARCH_HEIGHT_M), False
        if self._state in ("approach", "descend") and not seen:
            self.texts.append((4, "Lost landing target while landing"))
            self._go("start", time_s)
        if self._state == "start":
            return here, False
        if self._state == "fallback":
            return here, True
        n, e = self._place
        if self._state == "approach":
            if max(abs(n - position[0]), abs(e - position[1])) < self.parameters["PLD_HACC_RAD"]:
                self._go("descend", time_s)
            return (n, e, self._height_d), False
        return (n, e, position[2]), True

    def _go(self, state: str, time_s: float) -> None:
        self._state, self._since_s = state, time_s


class PrecisionLanding:
    """Both autopilots' halves over one set of parameters."""

    def __init__(self, parameters: dict[str, float], texts: Texts) -> None:
        self._parameters = parameters
        self._ardupilot = ArduPilotTarget(parameters, texts)
        self._px4 = Px4Target(parameters, texts)
        self._texts = texts
        self._place: tuple[float, float] | None = None
        self._failsafe_measures = False
        """Whether ArduCopter has reported that it lands without a target; its word for that is no failsafe."""

    def take(self, m: Any, px4: bool, v: Multirotor) -> None:
        """A LANDING_TARGET message."""
        if px4:
            self._px4.take(m, v.time_s)
        else:
            self._ardupilot.take(m, v.attitude, v.position, math.hypot(*v.rates), v.time_s)

    def step(self, v: Multirotor) -> None:
        """Time passes, in whatever mode: ArduCopter takes measurements and loses them again."""
        self._place = self._ardupilot.step(v.time_s)

    def begin(self, v: Multirotor) -> None:
        """A flight mode was entered."""
        self._failsafe_measures = False
        self._px4.begin(v.position, v.time_s)

    def precland(self, v: Multirotor) -> tuple[Vector, bool]:
        """PX4's PRECLAND: where to be, and whether to sink there."""
        return self._px4.step(v.position, -v.ground(v.position[0], v.position[1]), v.time_s)

    def land(self, v: Multirotor) -> tuple[tuple[float, float] | None, bool]:
        """ArduCopter's LAND: the place to come down on, if any, and whether to sink now (PLND_XY_DIST_MAX)."""
        place = self._place
        if place is None:
            if self._parameters["PLND_ENABLED"] == 1 and not self._failsafe_measures:
                self._failsafe_measures = True
                self._texts.append((6, "PrecLand: Failsafe Measures"))
            return None, True
        far_m = self._parameters["PLND_XY_DIST_MAX"]
        away_m = math.hypot(place[0] - v.position[0], place[1] - v.position[1])
        return place, not 0 < far_m < away_m
