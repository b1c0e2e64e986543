"""What differs between the autopilots that are simulated: ArduCopter's and PX4's numbers, failsafes, radio and sticks.

Each behaviour was observed on the real one in simulation (ArduCopter 4.7-dev, PX4 main of June 2025); the table is in
docs/simulation.md.
"""

import math
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.current_mode import AvailableModesMessage
from drivers.simulated.vehicle.parameters import Parameters

Kind = Literal["ardupilot", "px4"]
Radio = Literal["ok", "lost", "none"]

MODES = {
    "STABILIZE": 0,
    "ALT_HOLD": 2,
    "AUTO": 3,
    "GUIDED": 4,
    "LOITER": 5,
    "RTL": 6,
    "LAND": 9,
    "POSHOLD": 16,
    "BRAKE": 17,
}
"""Flight mode -> ArduCopter's custom_mode."""
MODE_NAMES = {number: name for name, number in MODES.items()}
MODES["PRECLAND"] = 0
"""PX4's alone."""
PX4_MODES = {
    "STABILIZE": (7, 0),
    "ALT_HOLD": (2, 0),
    "LOITER": (3, 0),
    "POSHOLD": (3, 0),
    "GUIDED": (6, 0),
    "AUTO": (4, 4),
    "RTL": (4, 5),
    "LAND": (4, 6),
    "BRAKE": (4, 3),
    "PRECLAND": (4, 9),
}
"""Our flight mode -> PX4's main and sub mode: LOITER is flown as POSCTL, GUIDED as OFFBOARD, BRAKE as HOLD."""
AUTOMATIC = ("LAND", "RTL", "BRAKE", "AUTO", "PRECLAND")
BY_STICKS = ("STABILIZE", "ALT_HOLD", "LOITER", "POSHOLD")
OFFBOARD_LOST = {0: "LOITER", 1: "ALT_HOLD", 2: "STABILIZE", 3: "RTL", 4: "LAND", 5: "BRAKE"}
"""COM_OBL_RC_ACT -> our mode; one that is flown with sticks becomes the return where none are heard."""
STICK_MOVED_US = 150
FAILSAFE_HOLD_S = 5.0
"""PX4 holds for so long before its failsafe goes on to the return (COM_FAIL_ACT_T)."""


class Controlled(Protocol):
    """What a firmware needs of the flight controller."""

    mode: str
    armed: bool
    pulse_us: list[int]
    texts: list[tuple[int, str]]
    parameters: Parameters

    def set_mode(self, name: str) -> bool:
        """Switch the flight mode."""
        ...


@dataclass(slots=True)
class Firmware:
    """One autopilot's manners; ``kind`` and ``vehicle_type`` (a MAV_TYPE) may be set before a flight."""

    kind: Kind = "ardupilot"
    vehicle_type: int = mavlink.MAV_TYPE_QUADROTOR
    vtol_state: int = mavlink.MAV_VTOL_STATE_UNDEFINED
    radio: Radio = "ok"
    radio_failsafe: bool = True
    """ArduCopter: whether a failsafe for the radio is set up (FS_THR_ENABLE)."""
    gps: bool = True
    """Without it the estimator makes its velocity up, and says so."""
    origin: bool = True
    """ArduCopter: without one yet (its first half minute) it sends no LOCAL_POSITION_NED (observed)."""
    critical: bool = False
    chosen: str = ""
    """The mode that the pilot chose last; PX4 goes back to it when it disarms after a landing."""
    _held_us: list[int] = field(default_factory=list)
    _sticks_us: list[int] = field(default_factory=list)
    setpoint_age_s: float = math.inf
    """Since the last setpoint came, in whatever mode."""
    refused: tuple[str, ...] = ()
    """PX4: modes that its checks do not allow now, by our names."""
    _hold_left_s: float | None = None
    _critical_in_s: float | None = None

    @property
    def px4(self) -> bool:
        """Whether it is PX4."""
        return self.kind == "px4"

    @property
    def autopilot(self) -> int:
        """MAV_AUTOPILOT."""
        return int(mavlink.MAV_AUTOPILOT_PX4 if self.px4 else mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)

    def custom_mode(self, mode: str, ardupilot_number: int) -> int:
        """HEARTBEAT's custom_mode."""
        if not self.px4:
            return ardupilot_number
        main, sub = PX4_MODES[mode]
        return main << 16 | sub << 24

    def mode_named(self, main: int, sub: int) -> str | None:
        """Our mode of a DO_SET_MODE to PX4."""
        return next((name for name, numbers in PX4_MODES.items() if numbers == (main, sub)), None)

    def listed_modes(self) -> list[Any]:
        """AVAILABLE_MODES of every mode: ArduCopter names all, PX4 none of the standard ones."""
        names = list(PX4_MODES) if self.px4 else [name for name in MODES if name != "PRECLAND"]
        numbers = [self.custom_mode(name, MODES[name]) for name in names]
        if self.px4:  # POSHOLD and LOITER are one
            numbers = list(dict.fromkeys(numbers))
            names = [""] * len(numbers)
        return [
            AvailableModesMessage(len(numbers), k + 1, 0, number, 0, name.encode())
            for k, (number, name) in enumerate(zip(numbers, names, strict=True))
        ]

    def system_status(self, on_ground: bool) -> int:
        """MAV_STATE."""
        if self.critical:
            return int(mavlink.MAV_STATE_CRITICAL)
        return int(mavlink.MAV_STATE_STANDBY if on_ground else mavlink.MAV_STATE_ACTIVE)

    def radio_bits(self) -> tuple[int, int]:
        """The RC receiver's bits (present and enabled, healthy) of SYS_STATUS.

        A receiver without a signal stays present and enabled (observed on both).
        """
        receiver = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
        return (0 if self.radio == "none" else receiver, receiver if self.radio == "ok" else 0)

    def channels(self, pulse_us: list[int]) -> list[int] | None:
        """RC_CHANNELS, None where none is sent.

        ArduCopter goes on with held values, rssi 255; PX4 sends none without a receiver (observed on both).
        """
        if self.radio == "none":
            return None
        return self._held_us if self.radio == "lost" and self._held_us else pulse_us

    def lose_radio(self, c: Controlled) -> None:
        """The pilot's transmitter is off."""
        self._held_us = list(c.pulse_us)
        self.radio = "lost"
        if self.kind == "ardupilot" and self.radio_failsafe:
            c.texts.append((4, "Radio Failsafe - Continuing Guided Mode"))
            self._critical_in_s = 1.0

    def lose_ground_station(self, c: Controlled) -> None:
        """PX4: CRITICAL and HOLD at once, the return after a while."""
        self.critical = True
        c.set_mode("BRAKE")
        self._hold_left_s = FAILSAFE_HOLD_S

    def breach_fence(self, c: Controlled) -> None:
        """Beyond the fence: ArduCopter says so and returns, ACTIVE as before; PX4 holds, CRITICAL (both observed)."""
        if self.px4:
            c.texts.append((4, "Geofence: exceeding maximum distance to Home"))
            self.critical = True
        else:
            c.texts.append((4, "Circle fence breached"))
        c.set_mode("BRAKE" if self.px4 else "RTL")

    def takes(self, mode: str, parameters: dict[str, float]) -> bool:
        """PX4: OFFBOARD needs setpoints that come, and modes flown with sticks need sticks (both observed)."""
        if not self.px4:
            return mode != "PRECLAND"
        if mode == "GUIDED" and self.setpoint_age_s > parameters["COM_OF_LOSS_T"]:
            return False
        return mode not in self.refused and not (mode in BY_STICKS and self.radio == "lost")

    def lose_offboard(self, c: Controlled, parameters: dict[str, float]) -> None:
        """PX4: setpoints stopped in OFFBOARD (Failsafe::checkModeFallback of its commander): CRITICAL, another mode."""
        mode = OFFBOARD_LOST.get(int(parameters["COM_OBL_RC_ACT"]), "LOITER")
        self.critical = True
        c.set_mode("RTL" if mode in BY_STICKS and self.radio == "lost" else mode)

    def land(self, c: Controlled) -> bool:
        """MAV_CMD_NAV_LAND. PX4 accepts it in a failsafe too, whose return then never comes (observed)."""
        self._hold_left_s = None
        if self.px4:
            self.critical = False
        return c.set_mode("LAND")

    def step(self, c: Controlled, dt: float) -> None:
        """What the autopilot does by itself: failsafes go on, sticks take over, a landing ends."""
        self.setpoint_age_s += dt
        if c.mode not in AUTOMATIC:
            self.chosen = c.mode
        if self._critical_in_s is not None:
            self._critical_in_s -= dt
            if self._critical_in_s <= 0.0:
                self.critical, self._critical_in_s = True, None
        if self._hold_left_s is not None:
            self._hold_left_s -= dt
            if self._hold_left_s <= 0.0:
                self._hold_left_s = None
                c.set_mode("RTL")
        if self.px4:
            self._px4_alone(c)

    def _px4_alone(self, c: Controlled) -> None:
        """PX4: a landing ends in the mode before, setpoints stop, sticks lead to POSCTL (COM_RC_OVERRIDE)."""
        values = c.parameters.values
        override = int(values["COM_RC_OVERRIDE"])
        if c.mode in ("LAND", "PRECLAND"):
            if not c.armed:
                c.set_mode(self.chosen or "LOITER")
            elif override & 1:
                self._leave_by_sticks(c)
        elif c.mode == "GUIDED" and c.armed:
            if override & 2:
                self._leave_by_sticks(c)
            if c.mode == "GUIDED" and self.setpoint_age_s > values["COM_OF_LOSS_T"]:
                self.lose_offboard(c, values)

    def _leave_by_sticks(self, c: Controlled) -> None:
        moved = (abs(now - then) for now, then in zip(c.pulse_us[:4], self._sticks_us, strict=False))
        if max(moved, default=0) > STICK_MOVED_US:
            c.texts.append((6, "Pilot took over using sticks"))
            c.set_mode("LOITER")

    def entered(self, c: Controlled) -> None:
        """A mode began: sticks are compared with where they were then."""
        self._sticks_us = list(c.pulse_us[:4])
        if c.mode == "GUIDED":
            self.critical = self.critical and not self.px4
