"""The last check between MAVSDK and the vehicle: what MAVSDK repeats passes only while it is still wanted.

MAVSDK sends a setpoint again every 50 ms and an unanswered command again every 0.5 s, whatever has happened since
(``OffboardImpl`` and ``MavlinkCommandSender`` of its source). The gate is on our side of the link, hears the
vehicle's own words first, and shuts before they reach anybody else.
"""

import math
import struct
import threading
import time
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as dialect

from drivers.mavlink.framing import MARKER_V2, WireFrame
from drivers.samples import CurrentMode, Heartbeat, Sample, StatusText

SETPOINT_ID = dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
NEVER = frozenset(
    {
        dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT,
        dialect.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
        dialect.MAVLINK_MSG_ID_SET_ACTUATOR_CONTROL_TARGET,
        dialect.MAVLINK_MSG_ID_MANUAL_CONTROL,
        dialect.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE,
    }
)
"""Messages that fly the vehicle and that nothing here has a use for."""
COMMAND_IDS = (dialect.MAVLINK_MSG_ID_COMMAND_LONG, dialect.MAVLINK_MSG_ID_COMMAND_INT)
_COMMAND_OFFSET = 28
"""Of the command in the payload: seven floats before it, in both messages."""
FLYING = frozenset({dialect.MAV_CMD_NAV_LAND, dialect.MAV_CMD_DO_SET_MODE})
"""Commands that change what the vehicle does, of those that MAVSDK is asked to send here."""

_SETPOINT = struct.Struct("<I11fH3B")
_IGNORED = 0b0000_1001_1100_0111
"""Type mask of a velocity with a heading: position, acceleration and rate of yaw are ignored."""
_FAILSAFE = frozenset(
    {dialect.MAV_STATE_CRITICAL, dialect.MAV_STATE_EMERGENCY, dialect.MAV_STATE_FLIGHT_TERMINATION}
)
_TAKE_OVER = "pilot took over"

SHUT, MODE, FAILSAFE, PILOT, LEASE, NOT_A_VELOCITY, TOO_FAST, NO_USE = (
    "shut", "mode_left", "failsafe", "pilot", "order_too_old", "not_a_velocity", "too_fast", "no_use",
)  # fmt: skip
"""Why a frame was kept back."""


class CommandGate:
    """Setpoints pass only while it is ``open`` and its lease is renewed; commands only in the modes expected.

    The vehicle's own messages end what was allowed, for good: a mode that was not expected, a failsafe, the
    autopilot's word that the pilot took over; disarming ends setpoints. Only the next ``expect`` begins anew. Safe to
    call from any thread.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._mode: str | None = None
        self._modes: frozenset[str] | None = None
        self._goal: frozenset[str] = frozenset()
        self._ended = ""
        self._limit_m_s = 0.0
        self._lease_s = 0.0
        self._until_s = -math.inf

    @property
    def mode(self) -> str | None:
        """The flight mode that was heard last."""
        return self._mode

    @property
    def ended(self) -> str:
        """What of the vehicle's own words ended the last order; empty while nothing did."""
        return self._ended

    @property
    def is_open(self) -> bool:
        """Whether a setpoint would pass now."""
        with self._lock:
            return not self._shut()

    def expect(self, given_in: str | None, goal: frozenset[str], *, after: bool = False) -> bool:
        """An order that was given in mode ``given_in`` goes out, towards the modes ``goal``; setpoints are shut.

        False, and nothing passes, when the vehicle flies neither now, or, of an order that comes ``after`` another,
        when that one has ended. Once one of ``goal`` was heard only those are expected.
        """
        with self._lock:
            self._until_s = -math.inf
            if after and self._ended:
                return False
            self._goal = goal
            self._modes = goal if given_in is None else goal | {given_in}
            self._ended = "" if self._mode is None or self._mode in self._modes else MODE
            self._narrow()
            return not self._ended

    def open(self, limit_m_s: float, lease_s: float) -> None:
        """Let velocities of at most ``limit_m_s`` pass for ``lease_s``, unless the order has ended."""
        with self._lock:
            self._limit_m_s, self._lease_s = limit_m_s, lease_s
            if not self._ended and self._modes is not None:
                self._until_s = self._clock() + lease_s

    def renew(self) -> bool:
        """The order holds, looked at anew; False when it has ended or was never opened, which this does not change."""
        with self._lock:
            if self._shut() not in ("", LEASE):
                return False
            self._until_s = self._clock() + self._lease_s
            return True

    def shut(self) -> None:
        """No setpoint from now on."""
        with self._lock:
            self._until_s = -math.inf

    def saw(self, sample: Sample) -> None:
        """Take what the vehicle says, before anybody else hears it."""
        with self._lock:
            if isinstance(sample, Heartbeat | CurrentMode):
                self._mode = sample.mode
                self._narrow()
                if self._modes is not None and sample.mode not in self._modes:
                    self._end(MODE)
            if isinstance(sample, Heartbeat):
                if sample.system_status in _FAILSAFE:
                    self._end(FAILSAFE)
                elif not sample.armed:
                    self._until_s = -math.inf
            elif isinstance(sample, StatusText) and _TAKE_OVER in sample.text.lower():
                self._end(PILOT)

    def refusal(self, frame: WireFrame) -> str:
        """Why a frame of MAVSDK's may not go out; empty when it may."""
        if frame.message_id == SETPOINT_ID:
            with self._lock:
                return self._ended or self._shut() or self._wrong(frame)
        if frame.message_id in NEVER:
            return NO_USE
        if frame.message_id == dialect.MAVLINK_MSG_ID_SET_MODE or (
            frame.message_id in COMMAND_IDS and _command_of(frame) in FLYING
        ):
            return self._ended
        return ""

    def _end(self, why: str) -> None:
        if self._modes is not None and not self._ended:
            self._ended = why
        self._until_s = -math.inf

    def _narrow(self) -> None:
        if self._modes is not None and self._mode in self._goal:
            self._modes = self._goal

    def _shut(self) -> str:
        if self._ended:
            return self._ended
        if self._until_s == -math.inf:
            return SHUT
        return "" if self._clock() <= self._until_s else LEASE

    def _wrong(self, frame: WireFrame) -> str:
        payload = _payload(frame).ljust(_SETPOINT.size, b"\0")
        _, *values, mask, _, _, axes = _SETPOINT.unpack(payload[: _SETPOINT.size])
        if mask != _IGNORED or axes != dialect.MAV_FRAME_LOCAL_NED:
            return NOT_A_VELOCITY
        speed = math.hypot(*values[3:6])
        return "" if speed <= self._limit_m_s and math.isfinite(values[9]) else TOO_FAST


def _payload(frame: WireFrame) -> bytes:
    start = 10 if frame.data[0] == MARKER_V2 else 6
    return frame.data[start : start + frame.data[1]]


def _command_of(frame: WireFrame) -> int:
    payload = _payload(frame).ljust(_COMMAND_OFFSET + 2, b"\0")
    return int.from_bytes(payload[_COMMAND_OFFSET : _COMMAND_OFFSET + 2], "little")
