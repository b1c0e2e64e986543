"""What differs between the autopilots that are simulated: ArduCopter's and PX4's numbers, failsafes, radio and sticks.

Each behaviour was observed on the real one in simulation (ArduCopter 4.7-dev, PX4 main of June 2025); the table is in
docs/simulation.md.
"""

from dataclasses import dataclass, field
from typing import Literal, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

Kind = Literal["ardupilot", "px4"]
Radio = Literal["ok", "lost", "none"]

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
}
"""Our flight mode -> PX4's main and sub mode: LOITER is flown as POSCTL, GUIDED as OFFBOARD, BRAKE as HOLD."""
AUTOMATIC = ("LAND", "RTL", "BRAKE", "AUTO")
STICK_MOVED_US = 150
FAILSAFE_HOLD_S = 5.0
"""PX4 holds for so long before its failsafe goes on to the return (COM_FAIL_ACT_T)."""


class Controlled(Protocol):
    """What a firmware needs of the flight controller."""

    mode: str
    armed: bool
    pulse_us: list[int]
    texts: list[tuple[int, str]]

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
    critical: bool = False
    chosen: str = ""
    """The mode that the pilot chose last; PX4 goes back to it when it disarms after a landing."""
    _held_us: list[int] = field(default_factory=list)
    _sticks_us: list[int] = field(default_factory=list)
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

    def land(self, c: Controlled) -> bool:
        """MAV_CMD_NAV_LAND. PX4 accepts it in a failsafe too, whose return then never comes (observed)."""
        self._hold_left_s = None
        if self.px4:
            self.critical = False
        self._sticks_us = list(c.pulse_us[:4])
        return c.set_mode("LAND")

    def step(self, c: Controlled, dt: float) -> None:
        """What the autopilot does by itself: failsafes go on, sticks take over, a landing ends."""
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
        if self.px4 and c.mode == "LAND":
            self._leave_landing(c)

    def _leave_landing(self, c: Controlled) -> None:
        """PX4: sticks lead from LAND to POSCTL (COM_RC_OVERRIDE), disarming to the mode before."""
        if not c.armed:
            c.set_mode(self.chosen or "LOITER")
        elif any(
            abs(now - then) > STICK_MOVED_US
            for now, then in zip(c.pulse_us[:4], self._sticks_us, strict=False)
        ):
            c.texts.append((6, "Pilot took over using sticks"))
            c.set_mode("LOITER")
