"""A ground station's half of a flight: takes an autopilot's link and flies it with setpoints, as a script does."""

import math
import threading
import time
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.errors import DriverError
from drivers.mavlink.ports import Port, open_port, parse_port

ASK_EVERY_S = 1.0
HEARTBEAT_S = 1.0
VELOCITY_ONLY = 0b0000110111000111
"""Type mask: velocity and yaw; no position, acceleration, yaw rate."""
COPTER_MODES = {
    "GUIDED": (4, 0),
    "LOITER": (5, 0),
    "RTL": (6, 0),
    "ALT_HOLD": (2, 0),
    "BRAKE": (17, 0),
    "LAND": (9, 0),
}
PX4_MODES = {
    "GUIDED": (6, 0),
    "LOITER": (3, 0),
    "RTL": (4, 5),
    "ALT_HOLD": (2, 0),
    "BRAKE": (4, 3),
    "LAND": (4, 6),
}
"""A scenario's mode -> DO_SET_MODE's second and third parameter: PX4 is flown in OFFBOARD, LOITER is POSCTL."""
CLIMB_M_S = 0.8
POSES_US = {mavlink.MAVLINK_MSG_ID_ODOMETRY: 8_000, mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: 20_000}
"""What a camera follows -> microseconds between two of them."""


class MavlinkPilot:
    """Connects as ground station 255; arms, takes off, sends velocities and moves the radio's switches.

    Nothing here waits: ``step`` is called some ten times a second and asks for the next thing that is missing.
    """

    def __init__(
        self, connection: str, timeout_s: float = 30.0, follow: Callable[[Any], None] | None = None
    ) -> None:
        """``follow`` is given every ODOMETRY and HIL_STATE_QUATERNION, which are then asked for."""
        self.armed = False
        self.mode = (-1, 0)
        self.may_arm = False
        """Whether the autopilot's checks before arming pass: its estimator needs some 40 s for that."""
        self._system = 0
        self._px4 = False
        self._follow = follow
        self._lock = threading.Lock()
        self._asked_s = -ASK_EVERY_S
        self._beat_s = 0.0
        self._codec: Any = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self._codec.robust_parsing = True
        end = time.monotonic() + timeout_s
        self._port = _opened(connection, end)
        while self._system == 0:
            if time.monotonic() > end:
                self._port.close()
                raise DriverError(f"no heartbeat on {connection} within {timeout_s:g} s")
            self.listen()
            time.sleep(0.02)

    @property
    def mode_name(self) -> str:
        """The flight mode; empty for one that is not flown here."""
        return next((name for name, numbers in self._modes.items() if numbers == self.mode), "")

    @property
    def _modes(self) -> dict[str, tuple[int, int]]:
        return PX4_MODES if self._px4 else COPTER_MODES

    def listen(self, wait_s: float = 0.0) -> None:
        """Take in what came; keep the ground station's heartbeat. Raises DriverError when the link broke."""
        with self._lock:
            try:
                while (received := self._port.read(wait_s)) is not None:
                    wait_s = 0.0
                    for message in self._codec.parse_buffer(received[0]) or ():
                        self._take(message)
            except OSError as error:
                raise DriverError(f"the autopilot hung up on its pilot: {error}") from error
        if time.monotonic() - self._beat_s > HEARTBEAT_S:
            self._beat_s = time.monotonic()
            self._send(
                mavlink.MAVLink_heartbeat_message(
                    mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0, 3
                )
            )

    def _take(self, message: Any) -> None:
        if message.get_type() == "HEARTBEAT" and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID:
            self._system = message.get_srcSystem()
            self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            self._px4 = message.autopilot == mavlink.MAV_AUTOPILOT_PX4
            mode = int(message.custom_mode)
            self.mode = ((mode >> 16) & 0xFF, mode >> 24) if self._px4 else (mode, 0)
        elif message.get_type() == "SYS_STATUS":
            self.may_arm = bool(message.onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_PREARM_CHECK)
        elif message.get_msgId() in POSES_US and self._follow is not None:
            self._follow(message)

    def ask_poses(self) -> None:
        """Ask for what ``follow`` takes."""
        for number, interval_us in POSES_US.items():
            self._command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, interval_us)

    def get_ready(self) -> None:
        """Ask for what shows that it may arm: a mode whose checks count, and SYS_STATUS twice a second.

        That mode is GUIDED; PX4's OFFBOARD is refused until setpoints come, so there it is HOLD.
        """
        if time.monotonic() - self._asked_s < ASK_EVERY_S:
            return
        self._asked_s = time.monotonic()
        checked = "BRAKE" if self._px4 else "GUIDED"
        if self.mode != self._modes[checked]:
            self.set_mode(checked)
        self._command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_SYS_STATUS, 500_000)

    def get_airborne(self, height_m: float) -> None:
        """Ask for what still lacks: GUIDED, armed, takeoff; once a second. PX4 climbs by setpoints of velocity."""
        if self._px4:
            self.fly((0.0, 0.0, -CLIMB_M_S), math.nan)
        if time.monotonic() - self._asked_s < ASK_EVERY_S:
            return
        self._asked_s = time.monotonic()
        if self.mode != self._modes["GUIDED"]:
            self.set_mode("GUIDED")
        elif not self.armed:
            self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        elif not self._px4:
            self._command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height_m)

    def set_mode(self, name: str) -> None:
        """Ask for a flight mode."""
        self._command(mavlink.MAV_CMD_DO_SET_MODE, 1, *self._modes[name])

    def fly(self, velocity: tuple[float, float, float], yaw: float) -> None:
        """A velocity (NED, m/s) and a heading; without one (NaN) it is kept."""
        mask = VELOCITY_ONLY | (0 if math.isfinite(yaw) else mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE)
        self._send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, self._system, 1, mavlink.MAV_FRAME_LOCAL_NED, mask,
                0, 0, 0, *velocity, 0, 0, 0, yaw if math.isfinite(yaw) else 0.0, 0,
            )
        )  # fmt: skip

    def set_channel(self, channel: int, pulse_us: int) -> None:
        """Override one of the radio's first eight channels."""
        pulses = [65535] * 8
        pulses[channel - 1] = pulse_us
        self._send(mavlink.MAVLink_rc_channels_override_message(self._system, 1, *pulses))

    def close(self) -> None:
        """Hang up."""
        self._port.close()

    def _command(self, command: int, *params: float) -> None:
        padded = [*params, *[0.0] * (7 - len(params))]
        self._send(mavlink.MAVLink_command_long_message(self._system, 1, command, 0, *padded))

    def _send(self, message: Any) -> None:
        with self._lock:
            packet = bytes(message.pack(self._codec))
            self._codec.seq = (self._codec.seq + 1) % 256
            try:
                self._port.write(packet)
            except OSError as error:
                raise DriverError(f"the autopilot hung up on its pilot: {error}") from error


def _opened(connection: str, end: float) -> Port:
    """The port, once the other side listens."""
    name = parse_port(connection)
    while True:
        try:
            return open_port(name)
        except OSError as error:
            if time.monotonic() > end:
                raise DriverError(f"no autopilot at {connection}: {error}; is SITL running?") from None
            time.sleep(0.2)
