"""MAVLink messages to samples: one decoder for recorded telemetry and for the live link."""

import math
from collections.abc import Callable
from typing import Any, Literal

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink import current_mode as current_mode  # before the ids are taken from the table
from drivers.mavlink import estimator_report
from drivers.mavlink.flight_modes import AUTOPILOTS, mode_name, vehicle_type
from drivers.quaternions import euler_of
from drivers.refusals import RefusalCode
from drivers.samples import (
    GRAVITY,
    Attitude,
    ClockOffset,
    CommandAnswer,
    CurrentMode,
    Distance,
    Heartbeat,
    Imu,
    LandedState,
    ManualControl,
    RcChannels,
    Refusal,
    Sample,
    StatusText,
    SystemStatus,
    SystemTime,
    Vector3,
    Velocity,
)

MILLI_G = GRAVITY * 1e-3
HALF_MS_US = 500
"""Boot times in milliseconds are cut off, not rounded; samples carry the middle of the millisecond."""

ATTITUDE_GRACE_US = 2_000_000
"""How long (boot time) ATTITUDE may be missing before ATTITUDE_QUATERNION stands in for it."""

GYRO_GRACE_US = 1_000_000
"""How long (boot time) the chosen gyro may be silent before a lesser one stands in for it."""

TIMESYNC_MAX_TRIP_US = 1_000_000
"""A longer TIMESYNC round trip is somebody else's, or crossed a jump of the clock."""

GYRO_RANK = {"HIGHRES_IMU": 0, "RAW_IMU": 1, "SCALED_IMU": 2, "SCALED_IMU2": 3, "SCALED_IMU3": 4}
"""Gyro sources, best first: by resolution of the rate, then of the time stamp."""

_LANDED = {0: "undefined", 1: "on_ground", 2: "in_air", 3: "takeoff", 4: "landing"}
_VTOL = {1: "transition", 2: "transition", 3: "multicopter", 4: "fixed_wing"}
_RADIO = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
_DOWN = mavlink.MAV_SENSOR_ROTATION_PITCH_270
_BAD_SIGNAL, _NO_COVARIANCE = 1, 0xFF
"""DISTANCE_SENSOR: signal_quality 1 is an invalid signal; a covariance in cm^2 of 255, or 0, is unknown."""
_NO_AXIS = 0x7FFF
_RC_FIELDS = tuple(f"chan{i}_raw" for i in range(1, 19))
_RC_NONE = 0xFFFF
_OF_MANY = frozenset(
    {
        "TIMESYNC",
        "COMMAND_ACK",
        "RC_CHANNELS",
        "SYS_STATUS",
        "STATUSTEXT",
        "MANUAL_CONTROL",
        "CURRENT_MODE",
        "ODOMETRY",
        "SYSTEM_TIME",
    }
)
"""Messages that gimbals, companions and ground stations send too: another component's is nothing to report."""
_RESULTS = {n: e.name.removeprefix("MAV_RESULT_") for n, e in mavlink.enums["MAV_RESULT"].items()}


class TelemetryDecoder:
    """One MAVLink message in, samples out; refuses with a reason what it cannot trust.

    ``system_id`` 0 takes the first vehicle that speaks; another one's messages are then refused as
    SECOND_VEHICLE (with a system id given, as FOREIGN_SYSTEM). ``component_id`` is the autopilot's.
    ``own_component``: answers to commands of other components are none of ours.
    Of attitudes, ATTITUDE is taken, ATTITUDE_QUATERNION only where no ATTITUDE comes; of gyros, the best there is.
    """

    def __init__(self, system_id: int = 0, component_id: int = 1, own_component: int = 191) -> None:
        self.system_id = system_id
        self.vehicles: set[int] = set()
        """System ids of all autopilots heard."""
        self.gyro_source: str | None = None
        self._given = system_id != 0
        self._component = component_id
        self._own_component = own_component
        self._ardupilot = True
        self._kind: tuple[int, int] | None = None
        self._attitude_us: int | None = None
        self._quaternion_since_us: int | None = None
        self._gyro_us = 0

    def decode(self, message: Any, arrival_us: int) -> list[Sample]:
        """The samples in one pymavlink message that arrived at ``arrival_us`` on the companion's clock."""
        name = message.get_type()
        handler = _HANDLERS.get(name)
        if handler is None:
            return []
        reason = self._foreign(message, name)
        if reason == "":
            return []
        if reason is not None:
            source = f"{message.get_srcSystem()}:{message.get_srcComponent()}"
            return [Refusal(arrival_us, name, reason, f"from {source}")]
        return handler(self, message, arrival_us)

    def _foreign(self, message: Any, name: str) -> RefusalCode | Literal[""] | None:
        """Why a message is not our autopilot's: None if it is, "" where that is nothing to report."""
        system, component = message.get_srcSystem(), message.get_srcComponent()
        if name == "HEARTBEAT" and message.autopilot == mavlink.MAV_AUTOPILOT_INVALID:
            return ""  # ground stations, companions, gimbals
        if name in _OF_MANY and component != self._component:
            return ""
        if component == self._component:
            self.vehicles.add(system)
            if self.system_id == 0:
                self.system_id = system
        if system != self.system_id:
            named = self._given or component != self._component
            return RefusalCode.FOREIGN_SYSTEM if named else RefusalCode.SECOND_VEHICLE
        return None if component == self._component else RefusalCode.FOREIGN_COMPONENT

    def _attitude(self, m: Any, arrival_us: int) -> list[Sample]:
        values = (m.roll, m.pitch, m.yaw, m.rollspeed, m.pitchspeed, m.yawspeed)
        if not _finite(values):
            return [_not_finite("ATTITUDE", arrival_us)]
        boot_us = _boot_us(m.time_boot_ms)
        self._attitude_us = boot_us
        return [Attitude(arrival_us, boot_us, *values)]

    def _attitude_quaternion(self, m: Any, arrival_us: int) -> list[Sample]:
        boot_us = _boot_us(m.time_boot_ms)
        if self._quaternion_since_us is None or boot_us < self._quaternion_since_us:
            self._quaternion_since_us = boot_us
        heard = self._quaternion_since_us if self._attitude_us is None else self._attitude_us
        if 0 <= boot_us - heard < ATTITUDE_GRACE_US:
            return []
        values = (m.q1, m.q2, m.q3, m.q4, m.rollspeed, m.pitchspeed, m.yawspeed)
        if not _finite(values):
            return [_not_finite("ATTITUDE_QUATERNION", arrival_us)]
        angles = euler_of(*values[:4])
        if angles is None:
            detail = f"norm {math.hypot(*values[:4]):.3g}"
            return [Refusal(arrival_us, "ATTITUDE_QUATERNION", RefusalCode.NOT_A_ROTATION, detail)]
        return [Attitude(arrival_us, boot_us, *angles, *values[4:])]

    def _imu_counts(self, m: Any, arrival_us: int) -> list[Sample]:
        name = m.get_type()
        if name == "RAW_IMU":
            # Only ArduPilot promises mrad/s here; elsewhere the unit is the sensor's own.
            if not self._ardupilot:
                return []
            boot_us = int(m.time_usec)
        else:
            boot_us = _boot_us(m.time_boot_ms)
        rate = (m.xgyro * 1e-3, m.ygyro * 1e-3, m.zgyro * 1e-3)
        return self._imu(
            name, arrival_us, boot_us, rate, (m.xacc * MILLI_G, m.yacc * MILLI_G, m.zacc * MILLI_G)
        )

    def _imu_highres(self, m: Any, arrival_us: int) -> list[Sample]:
        rates = (m.xgyro, m.ygyro, m.zgyro)
        if not _finite(rates):
            return [_not_finite("HIGHRES_IMU", arrival_us)]
        return self._imu("HIGHRES_IMU", arrival_us, int(m.time_usec), rates, (m.xacc, m.yacc, m.zacc))

    def _imu(self, name: str, arrival_us: int, boot_us: int, rate: Vector3, force: Vector3) -> list[Sample]:
        if name != self.gyro_source:
            silent = not 0 <= boot_us - self._gyro_us < GYRO_GRACE_US
            if self.gyro_source is not None and not silent and GYRO_RANK[name] > GYRO_RANK[self.gyro_source]:
                return []
            self.gyro_source = name
        self._gyro_us = boot_us
        # an accelerometer that is not there says zero
        there = _finite(force) and any(force)
        return [Imu(arrival_us, boot_us, rate, force if there else None, name)]

    def _local_position(self, m: Any, arrival_us: int) -> list[Sample]:
        values = (m.x, m.y, m.z, m.vx, m.vy, m.vz)
        if not _finite(values):
            return [_not_finite("LOCAL_POSITION_NED", arrival_us)]
        return [Velocity(arrival_us, _boot_us(m.time_boot_ms), values[:3], values[3:])]

    def _distance(self, m: Any, arrival_us: int) -> list[Sample]:
        if m.orientation != _DOWN:
            return []
        low, high, now = (cm * 0.01 for cm in (m.min_distance, m.max_distance, m.current_distance))
        # at a limit nothing was measured: that is what sensors report when there is no echo
        measured = low < now < high and m.signal_quality != _BAD_SIGNAL
        std_m = math.sqrt(m.covariance) * 0.01 if 0 < m.covariance < _NO_COVARIANCE else None
        return [Distance(arrival_us, _boot_us(m.time_boot_ms), now if measured else None, std_m, low, high)]

    def _heartbeat(self, m: Any, arrival_us: int) -> list[Sample]:
        self._ardupilot = m.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        autopilot = AUTOPILOTS.get(m.autopilot, f"autopilot {m.autopilot}")
        armed = bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        mode = mode_name(m.autopilot, m.type, m.custom_mode)
        self._kind = (m.autopilot, m.type)
        return [Heartbeat(arrival_us, armed, mode, autopilot, m.system_status, vehicle_type(m.type))]

    def _current_mode(self, m: Any, arrival_us: int) -> list[Sample]:
        if self._kind is None:
            return []  # which autopilot's numbers these are, its heartbeat says
        intended = mode_name(*self._kind, m.intended_custom_mode) if m.intended_custom_mode else ""
        return [CurrentMode(arrival_us, mode_name(*self._kind, m.custom_mode), intended)]

    def _ekf_status_report(self, m: Any, arrival_us: int) -> list[Sample]:
        return [estimator_report.ekf_status_report(m, arrival_us)]

    def _estimator_status(self, m: Any, arrival_us: int) -> list[Sample]:
        return [estimator_report.estimator_status(m, arrival_us)]

    def _odometry(self, m: Any, arrival_us: int) -> list[Sample]:
        return [estimator_report.odometry(m, arrival_us)]

    def _system_status(self, m: Any, arrival_us: int) -> list[Sample]:
        present = bool(m.onboard_control_sensors_present & _RADIO)
        enabled = bool(m.onboard_control_sensors_enabled & _RADIO)
        healthy = bool(m.onboard_control_sensors_health & _RADIO)
        return [SystemStatus(arrival_us, present, enabled, healthy)]

    def _status_text(self, m: Any, arrival_us: int) -> list[Sample]:
        return [StatusText(arrival_us, m.severity, m.text.rstrip("\0"))]

    def _manual_control(self, m: Any, arrival_us: int) -> list[Sample]:
        x, y, z, r = (None if axis == _NO_AXIS else int(axis) for axis in (m.x, m.y, m.z, m.r))
        return [ManualControl(arrival_us, (x, y, z, r))]

    def _extended_state(self, m: Any, arrival_us: int) -> list[Sample]:
        landed, vtol = _LANDED.get(m.landed_state, "undefined"), _VTOL.get(m.vtol_state, "undefined")
        return [LandedState(arrival_us, landed, vtol)]

    def _rc_channels(self, m: Any, arrival_us: int) -> list[Sample]:
        pulses = (getattr(m, f) for f in _RC_FIELDS[: m.chancount])
        return [RcChannels(arrival_us, tuple(0 if p == _RC_NONE else p for p in pulses))]

    def _timesync(self, m: Any, arrival_us: int) -> list[Sample]:
        sent_us, boot_us = m.ts1 // 1000, m.tc1 // 1000
        trip_us = arrival_us - sent_us
        if m.tc1 == 0 or not 0 <= trip_us <= TIMESYNC_MAX_TRIP_US:
            return []  # the autopilot's own request, or an answer to somebody else
        return [ClockOffset(arrival_us, boot_us, (sent_us + arrival_us) // 2 - boot_us, trip_us)]

    def _system_time(self, m: Any, arrival_us: int) -> list[Sample]:
        return [SystemTime(arrival_us, int(m.time_unix_usec))]

    def _command_ack(self, m: Any, arrival_us: int) -> list[Sample]:
        if m.target_component not in (0, self._own_component):
            return []
        return [CommandAnswer(arrival_us, m.command, _RESULTS.get(m.result, f"RESULT_{m.result}"))]


def _finite(values: tuple[float, ...]) -> bool:
    return all(map(math.isfinite, values))


def _not_finite(source: str, arrival_us: int) -> Refusal:
    return Refusal(arrival_us, source, RefusalCode.NOT_FINITE)


def _boot_us(time_boot_ms: int) -> int:
    return time_boot_ms * 1000 + HALF_MS_US


_HANDLERS: dict[str, Callable[[TelemetryDecoder, Any, int], list[Sample]]] = {
    "ATTITUDE": TelemetryDecoder._attitude,
    "ATTITUDE_QUATERNION": TelemetryDecoder._attitude_quaternion,
    "RAW_IMU": TelemetryDecoder._imu_counts,
    "SCALED_IMU": TelemetryDecoder._imu_counts,
    "SCALED_IMU2": TelemetryDecoder._imu_counts,
    "SCALED_IMU3": TelemetryDecoder._imu_counts,
    "HIGHRES_IMU": TelemetryDecoder._imu_highres,
    "LOCAL_POSITION_NED": TelemetryDecoder._local_position,
    "EKF_STATUS_REPORT": TelemetryDecoder._ekf_status_report,
    "ESTIMATOR_STATUS": TelemetryDecoder._estimator_status,
    "ODOMETRY": TelemetryDecoder._odometry,
    "DISTANCE_SENSOR": TelemetryDecoder._distance,
    "HEARTBEAT": TelemetryDecoder._heartbeat,
    "CURRENT_MODE": TelemetryDecoder._current_mode,
    "SYS_STATUS": TelemetryDecoder._system_status,
    "STATUSTEXT": TelemetryDecoder._status_text,
    "MANUAL_CONTROL": TelemetryDecoder._manual_control,
    "EXTENDED_SYS_STATE": TelemetryDecoder._extended_state,
    "RC_CHANNELS": TelemetryDecoder._rc_channels,
    "TIMESYNC": TelemetryDecoder._timesync,
    "SYSTEM_TIME": TelemetryDecoder._system_time,
    "COMMAND_ACK": TelemetryDecoder._command_ack,
}

MESSAGE_IDS = frozenset(i for i, m in mavlink.mavlink_map.items() if m.msgname in _HANDLERS)
"""Ids of the messages that samples are made of; all others may be skipped by their header."""

STREAM_IDS = frozenset(
    i
    for i, m in mavlink.mavlink_map.items()
    if m.msgname in {"ATTITUDE", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "ODOMETRY", *GYRO_RANK}
)
"""Ids of what comes many times a second. No command needs them, and each would wake MAVSDK's threads."""
