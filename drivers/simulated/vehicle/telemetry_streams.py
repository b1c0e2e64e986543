"""The messages that the simulated autopilot sends by itself, each at its own rate."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.current_mode import CURRENT_MODE_ID, CurrentModeMessage
from drivers.samples import GRAVITY
from drivers.simulated.vehicle import estimator_streams
from drivers.simulated.vehicle.firmware import MODES
from drivers.simulated.vehicle.flight_controller import FlightController
from drivers.simulated.vehicle.quaternion import to_euler
from drivers.simulated.vehicle.sensors import Sensors

EARTH_RADIUS_M = 6378137.0
SENSORS_PRESENT = (
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | mavlink.MAV_SYS_STATUS_SENSOR_GPS
    | mavlink.MAV_SYS_STATUS_AHRS
    | mavlink.MAV_SYS_STATUS_PREARM_CHECK
)
DEFAULT_RATES_HZ = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 2.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 10.0,
    mavlink.MAVLINK_MSG_ID_RAW_IMU: 10.0,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 5.0,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 5.0,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 2.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 2.0,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: 2.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 2.0,
}
"""Message id -> rate after a boot, 1/s; what is not here comes on demand."""


@dataclass(frozen=True, slots=True)
class Origin:
    """Where the local frame's zero lies on the Earth."""

    latitude_deg: float = 51.99
    longitude_deg: float = 4.376
    altitude_m: float = 20.0

    def to_global(self, north: float, east: float) -> tuple[float, float]:
        """Latitude and longitude in degrees of a place a few kilometres away at most."""
        shrink = math.cos(math.radians(self.latitude_deg))
        return (
            self.latitude_deg + math.degrees(north / EARTH_RADIUS_M),
            self.longitude_deg + math.degrees(east / (EARTH_RADIUS_M * shrink)),
        )

    def to_local(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """North and east in metres."""
        shrink = math.cos(math.radians(self.latitude_deg))
        return (
            math.radians(latitude_deg - self.latitude_deg) * EARTH_RADIUS_M,
            math.radians(longitude_deg - self.longitude_deg) * EARTH_RADIUS_M * shrink,
        )


@dataclass(slots=True)
class TelemetryStreams:
    """Builds the vehicle's messages and knows which are due."""

    controller: FlightController
    sensors: Sensors
    origin: Origin = field(default_factory=Origin)
    boot_s: float = 0.0
    """Simulated time minus the time since boot: what a message's time_boot_ms counts from."""
    rates_hz: dict[int, float] = field(default_factory=lambda: dict(DEFAULT_RATES_HZ))
    _due_s: dict[int, float] = field(default_factory=dict)
    _mode: str = ""

    def since_boot_s(self, time_s: float) -> float:
        """Seconds since the autopilot booted."""
        return time_s - self.boot_s

    def set_rate(self, message_id: int, rate_hz: float) -> None:
        """Send a message at a rate; 0 stops it."""
        if rate_hz > 0.0:
            self.rates_hz[message_id] = rate_hz
            self._due_s.pop(message_id, None)
        else:
            self.rates_hz.pop(message_id, None)

    def reset(self) -> None:
        """The rates after a boot."""
        self.rates_hz = dict(DEFAULT_RATES_HZ)
        self._due_s.clear()

    def due(self, time_s: float) -> list[Any]:
        """The messages whose time has come."""
        messages = []
        if self.controller.mode != self._mode and not self.controller.firmware.px4:
            self._due_s[mavlink.MAVLINK_MSG_ID_HEARTBEAT] = (
                time_s  # set_mode of ArduPilot's vehicles ends with one
            )
        self._mode = self.controller.mode
        for message_id, rate in self.rates_hz.items():
            due = self._due_s.get(message_id, time_s)
            if time_s + 1e-9 < due:
                continue
            period = 1.0 / rate
            # A late caller gets one message, not a burst of all that it missed.
            self._due_s[message_id] = due + period if due + period > time_s else time_s + period
            message = self.build(message_id, time_s)
            if message is not None:
                messages.append(message)
        return messages

    def can_build(self, message_id: int) -> bool:
        """Whether this autopilot has such a message."""
        return message_id in _BUILDERS

    def build(self, message_id: int, time_s: float) -> Any | None:
        """One message as of now, or None where this autopilot has none of that kind."""
        builder = _BUILDERS.get(message_id)
        return None if builder is None else builder(self, self.since_boot_s(time_s))


def _ms(boot_s: float) -> int:
    """time_boot_ms is 32 bits wide and wraps after 49.7 days."""
    return int(boot_s * 1e3) % 2**32


def _heartbeat(s: TelemetryStreams, boot_s: float) -> Any:
    c = s.controller
    base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
    base |= mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
    base |= mavlink.MAV_MODE_FLAG_GUIDED_ENABLED if c.mode in ("GUIDED", "RTL", "LAND", "LOITER") else 0
    base |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED if c.armed else 0
    f = c.firmware
    state, mode = f.system_status(c.vehicle.on_ground), f.custom_mode(c.mode, MODES[c.mode])
    return mavlink.MAVLink_heartbeat_message(f.vehicle_type, f.autopilot, base, mode, state, 3)


def _current_mode(s: TelemetryStreams, boot_s: float) -> Any | None:
    c = s.controller
    mode = c.firmware.custom_mode(c.mode, MODES[c.mode])
    return CurrentModeMessage(0, mode, mode) if c.firmware.px4 else None


def _manual_control(s: TelemetryStreams, boot_s: float) -> Any | None:
    """PX4 passes on a joystick's sticks; where there is a receiver they come in RC_CHANNELS."""
    if not s.controller.firmware.px4 or s.controller.firmware.radio != "none":
        return None
    roll, pitch, throttle, yaw = ((pulse - 1500) * 2 for pulse in s.controller.pulse_us[:4])
    return mavlink.MAVLink_manual_control_message(1, pitch, roll, (throttle + 1000) // 2, yaw, 0)


def _sys_status(s: TelemetryStreams, boot_s: float) -> Any:
    there, healthy = s.controller.firmware.radio_bits()
    p, h = SENSORS_PRESENT | there, SENSORS_PRESENT | healthy
    return mavlink.MAVLink_sys_status_message(p, p, h, 250, 12400, 800, 90, 0, 0, 0, 0, 0, 0)


def _attitude(s: TelemetryStreams, boot_s: float) -> Any:
    return mavlink.MAVLink_attitude_message(_ms(boot_s), *to_euler(s.sensors.attitude()), *s.sensors.gyro())


def _attitude_quaternion(s: TelemetryStreams, boot_s: float) -> Any:
    return mavlink.MAVLink_attitude_quaternion_message(_ms(boot_s), *s.sensors.attitude(), *s.sensors.gyro())


def _raw_imu(s: TelemetryStreams, boot_s: float) -> Any:
    milli_g = [_short(a / GRAVITY * 1e3) for a in s.controller.vehicle.specific_force]
    mrad = [_short(r * 1e3) for r in s.sensors.gyro()]
    return mavlink.MAVLink_raw_imu_message(int(boot_s * 1e6), *milli_g, *mrad, 200, 10, 430)


def _highres_imu(s: TelemetryStreams, boot_s: float) -> Any:
    force = s.controller.vehicle.specific_force
    return mavlink.MAVLink_highres_imu_message(
        int(boot_s * 1e6), *force, *s.sensors.gyro(), 0.2, 0.01, 0.43, 1013.0, 0.0, 20.0, 25.0, 0x3F
    )


def _local_position(s: TelemetryStreams, boot_s: float) -> Any:
    v = s.controller.vehicle
    if not (s.controller.firmware.origin or s.controller.firmware.px4):
        return None
    return mavlink.MAVLink_local_position_ned_message(
        _ms(boot_s), *v.position, *estimator_streams.velocity(s)
    )


def _sim_state(s: TelemetryStreams, boot_s: float) -> Any:
    v = s.controller.vehicle
    latitude, longitude = s.origin.to_global(v.position[0], v.position[1])
    altitude = s.origin.altitude_m - v.position[2]
    return mavlink.MAVLink_sim_state_message(
        *v.attitude, *v.euler, *v.specific_force, *v.rates, latitude, longitude, altitude, 0, 0, *v.velocity
    )


def _global_position(s: TelemetryStreams, boot_s: float) -> Any:
    c = s.controller
    latitude, longitude = s.origin.to_global(c.vehicle.position[0], c.vehicle.position[1])
    up = -c.vehicle.position[2]
    v = [_short(x * 100) for x in c.vehicle.velocity]
    return mavlink.MAVLink_global_position_int_message(
        _ms(boot_s),
        round(latitude * 1e7),
        round(longitude * 1e7),
        round((s.origin.altitude_m + up) * 1e3),
        round((up + c.home[2]) * 1e3),
        *v,
        int(math.degrees(c.vehicle.euler[2]) % 360.0 * 100),
    )


def _gps_raw(s: TelemetryStreams, boot_s: float) -> Any:
    v = s.controller.vehicle
    latitude, longitude = s.origin.to_global(v.position[0], v.position[1])
    speed = int(math.hypot(v.velocity[0], v.velocity[1]) * 100)
    altitude = round((s.origin.altitude_m - v.position[2]) * 1e3)
    return mavlink.MAVLink_gps_raw_int_message(
        int(boot_s * 1e6),
        mavlink.GPS_FIX_TYPE_RTK_FIXED,
        round(latitude * 1e7),
        round(longitude * 1e7),
        altitude,
        80,
        90,
        speed,
        65535,
        14,
    )


def _extended_state(s: TelemetryStreams, boot_s: float) -> Any:
    state = {
        "on_ground": mavlink.MAV_LANDED_STATE_ON_GROUND,
        "in_air": mavlink.MAV_LANDED_STATE_IN_AIR,
        "takeoff": mavlink.MAV_LANDED_STATE_TAKEOFF,
        "landing": mavlink.MAV_LANDED_STATE_LANDING,
    }[s.controller.landed_state]
    return mavlink.MAVLink_extended_sys_state_message(s.controller.firmware.vtol_state, state)


def _home(s: TelemetryStreams, boot_s: float) -> Any:
    home = s.controller.home
    latitude, longitude = s.origin.to_global(home[0], home[1])
    return mavlink.MAVLink_home_position_message(
        round(latitude * 1e7),
        round(longitude * 1e7),
        round((s.origin.altitude_m - home[2]) * 1e3),
        *home,
        [1.0, 0.0, 0.0, 0.0],
        0.0,
        0.0,
        0.0,
    )


def _rc_channels(s: TelemetryStreams, boot_s: float) -> Any | None:
    pulse_us = s.controller.firmware.channels(s.controller.pulse_us)
    if pulse_us is None:
        return None
    return mavlink.MAVLink_rc_channels_message(_ms(boot_s), 16, *pulse_us[:18], 255)


def _vfr_hud(s: TelemetryStreams, boot_s: float) -> Any:
    v = s.controller.vehicle
    speed = math.hypot(v.velocity[0], v.velocity[1])
    heading = int(math.degrees(v.euler[2]) % 360.0)
    return mavlink.MAVLink_vfr_hud_message(
        speed, speed, heading, 50, s.origin.altitude_m - v.position[2], -v.velocity[2]
    )


def _version(s: TelemetryStreams, boot_s: float) -> Any:
    capabilities = (
        mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
        | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    )
    version = 4 << 24 | 7 << 16
    return mavlink.MAVLink_autopilot_version_message(
        capabilities, version, version, version, 0, b"simulate", b"simulate", b"simulate", 0, 0, 1
    )


def _gps_origin(s: TelemetryStreams, boot_s: float) -> Any:
    o = s.origin
    return mavlink.MAVLink_gps_global_origin_message(
        int(o.latitude_deg * 1e7), int(o.longitude_deg * 1e7), int(o.altitude_m * 1e3)
    )


def _system_time(s: TelemetryStreams, boot_s: float) -> Any:
    return mavlink.MAVLink_system_time_message(0, _ms(boot_s))


def _short(value: float) -> int:
    """As a 16 bit field takes it: clipped, never wrapped."""
    return max(-32768, min(32767, round(value)))


_BUILDERS: dict[int, Callable[[TelemetryStreams, float], Any]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: _heartbeat,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: _sys_status,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: _attitude,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: _attitude_quaternion,
    mavlink.MAVLINK_MSG_ID_RAW_IMU: _raw_imu,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: _highres_imu,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: _local_position,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: estimator_streams.ekf_status_report,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: estimator_streams.estimator_status,
    mavlink.MAVLINK_MSG_ID_ODOMETRY: estimator_streams.odometry,
    mavlink.MAVLINK_MSG_ID_SIM_STATE: _sim_state,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: _global_position,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: _gps_raw,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: _extended_state,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: _home,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: _rc_channels,
    CURRENT_MODE_ID: _current_mode,
    mavlink.MAVLINK_MSG_ID_MANUAL_CONTROL: _manual_control,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: _vfr_hud,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: _version,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: _gps_origin,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: _system_time,
}
