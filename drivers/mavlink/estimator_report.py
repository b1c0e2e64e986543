"""The autopilot's estimator about itself: EKF_STATUS_REPORT of ArduPilot, ESTIMATOR_STATUS and ODOMETRY of PX4."""

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.samples import EstimatorReport

REJECTED = 0.8
"""ArduPilot's FS_EKF_THRESH: an innovation at this share of the gate, from where the position counts as lost.

What EKF_STATUS_REPORT calls variances are such shares, as ESTIMATOR_STATUS's ratios are.
"""
_VELOCITY = mavlink.EKF_VELOCITY_HORIZ | mavlink.EKF_VELOCITY_VERT
_UPPER = (0, 6, 11)
"""Places of the first three variances of an upper triangle of 6 x 6, row by row."""
_ANGLES = (15, 18)
"""Those of roll and pitch."""


def ekf_status_report(m: Any, arrival_us: int) -> EstimatorReport:
    """ArduPilot's flags; held at a constant position (no GPS) it invents its velocity."""
    held = bool(m.flags & (mavlink.EKF_CONST_POS_MODE | mavlink.EKF_UNINITIALIZED))
    return _by_flags("EKF_STATUS_REPORT", m, held, (m.velocity_variance,), arrival_us)


def estimator_status(m: Any, arrival_us: int) -> EstimatorReport:
    """PX4's flags. Its CONST_POS_MODE is set on the ground too, at rest, with a velocity that is known."""
    return _by_flags("ESTIMATOR_STATUS", m, False, (m.vel_ratio,), arrival_us)


def odometry(m: Any, arrival_us: int) -> EstimatorReport:
    """PX4's variances; NaN where the estimator does not report them."""
    return EstimatorReport(
        arrival_us,
        "ODOMETRY",
        velocity_std=_largest_std(m.velocity_covariance, _UPPER),
        tilt_std=_largest_std(m.pose_covariance, _ANGLES),
    )


def _by_flags(source: str, m: Any, held: bool, ratios: tuple[float, ...], arrival_us: int) -> EstimatorReport:
    accepted = all(ratio < REJECTED for ratio in ratios)  # not of NaN
    known = not held and accepted and (m.flags & _VELOCITY) == _VELOCITY
    return EstimatorReport(arrival_us, source, known, bool(m.flags & mavlink.EKF_ATTITUDE))


def _largest_std(covariance: Any, places: tuple[int, ...]) -> float | None:
    if len(covariance) <= max(places):
        return None
    variances = [float(covariance[k]) for k in places]
    if not all(math.isfinite(v) and v >= 0 for v in variances):
        return None
    return math.sqrt(max(variances))
