"""A ground station's half of a flight: takes an autopilot's link and flies it with setpoints, as a script does."""

import threading
import time
from typing import Any

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.errors import DriverError

ASK_EVERY_S = 1.0
HEARTBEAT_S = 1.0
VELOCITY_ONLY = 0b0000110111000111
"""Type mask: velocity and yaw; no position, acceleration, yaw rate."""
COPTER_MODES = {"GUIDED": 4, "LOITER": 5, "RTL": 6, "ALT_HOLD": 2, "BRAKE": 17, "LAND": 9}


class MavlinkPilot:
    """Connects as ground station 255; arms, takes off, sends velocities and moves the radio's switches.

    Nothing here waits: ``step`` is called some ten times a second and asks for the next thing that is missing.
    """

    def __init__(self, connection: str, timeout_s: float = 30.0) -> None:
        try:
            self._link: Any = mavutil.mavlink_connection(connection, source_system=255, retries=30)
        except OSError as error:
            raise DriverError(
                f"no autopilot at {connection}: {error.strerror or error}; is SITL running?"
            ) from None
        if self._link.wait_heartbeat(timeout=timeout_s) is None:
            self._link.close()
            raise DriverError(f"no heartbeat on {connection} within {timeout_s:g} s")
        self.armed = False
        self.mode = -1
        self._lock = threading.Lock()
        self._asked_s = -ASK_EVERY_S
        self._beat_s = 0.0

    @property
    def mode_name(self) -> str:
        """The flight mode; empty for one that is not flown here."""
        return next((name for name, number in COPTER_MODES.items() if number == self.mode), "")

    def listen(self) -> None:
        """Take in what came; keep the ground station's heartbeat."""
        with self._lock:
            while (message := self._link.recv_match(blocking=False)) is not None:
                if message.get_type() == "HEARTBEAT" and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID:
                    self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
                    self.mode = int(message.custom_mode)
            if time.monotonic() - self._beat_s > HEARTBEAT_S:
                self._beat_s = time.monotonic()
                self._link.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)

    def get_airborne(self, height_m: float) -> None:
        """Ask for what still lacks: GUIDED, armed, takeoff; once a second."""
        if time.monotonic() - self._asked_s < ASK_EVERY_S:
            return
        self._asked_s = time.monotonic()
        if self.mode != COPTER_MODES["GUIDED"]:
            self.set_mode("GUIDED")
        elif not self.armed:
            self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        else:
            self._command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height_m)

    def set_mode(self, name: str) -> None:
        """Ask for a flight mode."""
        self._command(mavlink.MAV_CMD_DO_SET_MODE, 1, COPTER_MODES[name])

    def fly(self, velocity: tuple[float, float, float], yaw: float) -> None:
        """A velocity (NED, m/s) and a heading."""
        with self._lock:
            self._link.mav.set_position_target_local_ned_send(
                0, self._link.target_system, 1, mavlink.MAV_FRAME_LOCAL_NED, VELOCITY_ONLY,
                0, 0, 0, *velocity, 0, 0, 0, yaw, 0,
            )  # fmt: skip

    def set_channel(self, channel: int, pulse_us: int) -> None:
        """Override one of the radio's first eight channels."""
        pulses = [65535] * 8
        pulses[channel - 1] = pulse_us
        with self._lock:
            self._link.mav.rc_channels_override_send(self._link.target_system, 1, *pulses)

    def close(self) -> None:
        """Hang up."""
        self._link.close()

    def _command(self, command: int, *params: float) -> None:
        padded = [*params, *[0.0] * (7 - len(params))]
        with self._lock:
            self._link.mav.command_long_send(self._link.target_system, 1, command, 0, *padded)
