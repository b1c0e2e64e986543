"""What the simulated autopilot's estimator says of itself: ArduCopter's EKF_STATUS_REPORT, PX4's two messages.

Numbers in flight with GPS as observed on PX4 1.17's SIH; without GPS the flags are those of the two sources
(AP_NavEKF3_Control.cpp, EKF/ekf_helper.cpp), and the velocity is wrong by what was observed.
"""

import math
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.simulated.vehicle.quaternion import Vector

if TYPE_CHECKING:
    from drivers.simulated.vehicle.telemetry_streams import TelemetryStreams

WELL = 0x37F
"""Attitude, velocity and position, all but the constant position, and what they are predicted to be."""
_HORIZONTAL = (
    mavlink.ESTIMATOR_VELOCITY_HORIZ
    | mavlink.ESTIMATOR_POS_HORIZ_REL
    | mavlink.ESTIMATOR_POS_HORIZ_ABS
    | mavlink.ESTIMATOR_PRED_POS_HORIZ_REL
    | mavlink.ESTIMATOR_PRED_POS_HORIZ_ABS
)
WITHOUT_GPS = WELL & ~_HORIZONTAL | mavlink.ESTIMATOR_CONST_POS_MODE
WRONG_M_S: Vector = (0.5, 0.0, 0.0)
"""Error of a velocity without GPS."""
VELOCITY_STD, VERTICAL_STD = 0.095, 0.035
TILT_STD = math.radians(0.6)
UNKNOWN_STD = 5.0


def velocity(s: "TelemetryStreams") -> Vector:
    """The estimator's velocity, NED."""
    n, e, d = s.sensors.velocity()
    wrong = (0.0, 0.0, 0.0) if s.controller.firmware.gps else WRONG_M_S
    return n + wrong[0], e + wrong[1], d + wrong[2]


def ekf_status_report(s: "TelemetryStreams", boot_s: float) -> Any | None:
    """ArduCopter's alone."""
    f = s.controller.firmware
    flags = WELL if f.gps else WITHOUT_GPS
    return None if f.px4 else mavlink.MAVLink_ekf_status_report_message(flags, 0.15, 0.1, 0.1, 0.05, 0)


def estimator_status(s: "TelemetryStreams", boot_s: float) -> Any | None:
    """PX4's alone; at rest on the ground it has the constant position set as well."""
    f = s.controller.firmware
    flags = WELL if f.gps else WITHOUT_GPS
    if s.controller.vehicle.on_ground:
        flags |= mavlink.ESTIMATOR_CONST_POS_MODE
    if not f.px4:
        return None
    return mavlink.MAVLink_estimator_status_message(
        round(boot_s * 1e6), flags, 0.15, 0.1, 0.1, 0.05, 0, 0, 0.3, 0.3
    )


def odometry(s: "TelemetryStreams", boot_s: float) -> Any | None:
    """PX4's alone: variances on the diagonals, NaN elsewhere."""
    if not s.controller.firmware.px4:
        return None
    v = s.controller.vehicle
    horizontal = (VELOCITY_STD if s.controller.firmware.gps else UNKNOWN_STD) ** 2
    pose, speed = [math.nan] * 21, [math.nan] * 21
    pose[15] = pose[18] = TILT_STD**2
    speed[0] = speed[6] = horizontal
    speed[11] = VERTICAL_STD**2
    frames = mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_NED
    return mavlink.MAVLink_odometry_message(
        round(boot_s * 1e6),
        *frames,
        *v.position,
        s.sensors.attitude(),
        *velocity(s),
        *s.sensors.gyro(),
        pose,
        speed,
    )
