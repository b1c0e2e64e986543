"""LANDING_TARGET: where an autopilot that lands by itself is to come down.

ArduCopter (AC_PrecLand with PLND_TYPE 1) takes a place in body axes and turns it by the attitude that it had
PLND_LAG seconds before; PX4 (mode PRECLAND) takes a place in the axes of its LOCAL_POSITION_NED. Each refuses the
other's frame.
"""

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from drivers.samples import Attitude, Heartbeat, Sample, Vector3, Velocity

INTERVAL_US = 30_000
"""Shortest time between two: at most 33 a second. ArduCopter begins anew when none comes for 0.5 s, and both lose
the place after 2 s (ArduCopter) or PLD_BTOUT (PX4)."""
STALE_US = 500_000
"""An attitude or a position that is older says nothing of now."""


class LandingTarget:
    """Keeps the newest attitude and position, and makes of a place from the vehicle the message for its autopilot."""

    def __init__(self) -> None:
        self._autopilot = ""
        self._attitude: Attitude | None = None
        self._position: Velocity | None = None
        self._sent_us = 0

    def feed(self, sample: Sample) -> None:
        """Take what the vehicle says."""
        if isinstance(sample, Attitude):
            self._attitude = sample
        elif isinstance(sample, Velocity):
            self._position = sample
        elif isinstance(sample, Heartbeat):
            self._autopilot = sample.autopilot

    def message(self, target_ned: Vector3, true_at_us: int, now_us: int) -> Any | None:
        """The message for a place ``target_ned`` (m from the vehicle as it was at ``true_at_us``); None: send none.

        None too soon after the last one, for a place that is not finite or not below, and without a fresh attitude
        (ArduCopter) or position (PX4). The vehicle's motion since ``true_at_us`` is taken off by its velocity.
        """
        if (
            now_us - self._sent_us < INTERVAL_US
            or not all(map(math.isfinite, target_ned))
            or target_ned[2] <= 0
        ):
            return None
        position = self._position
        if position is not None and not 0 <= now_us - position.arrival_us <= STALE_US:
            position = None
        body = self._autopilot != "px4"
        place = (
            self._in_body(target_ned, position, true_at_us, now_us)
            if body
            else _local(target_ned, position, true_at_us)
        )
        if place is None:
            return None
        self._sent_us = now_us
        x, y, z = place
        frame = dialect.MAV_FRAME_BODY_FRD if body else dialect.MAV_FRAME_LOCAL_NED
        distance = math.hypot(*target_ned) if not body else math.hypot(x, y, z)
        angle_x, angle_y = (math.atan2(y, z), -math.atan2(x, z)) if body else (0.0, 0.0)
        return dialect.MAVLink_landing_target_message(
            now_us, 0, frame, angle_x, angle_y, distance, 0.0, 0.0, x, y, z, (1.0, 0.0, 0.0, 0.0),
            dialect.LANDING_TARGET_TYPE_VISION_OTHER, 1,
        )  # fmt: skip

    def _in_body(
        self, target: Vector3, position: Velocity | None, true_at_us: int, now_us: int
    ) -> Vector3 | None:
        attitude = self._attitude
        if attitude is None or not 0 <= now_us - attitude.arrival_us <= STALE_US:
            return None
        since_s = (attitude.arrival_us - true_at_us) * 1e-6
        velocity = (0.0, 0.0, 0.0) if position is None else position.velocity_ned
        n, e, d = (t - v * since_s for t, v in zip(target, velocity, strict=True))
        return _body_from_ned(attitude, (n, e, d))


def _local(target: Vector3, position: Velocity | None, true_at_us: int) -> Vector3 | None:
    if position is None:
        return None
    back_s = (position.arrival_us - true_at_us) * 1e-6
    parts = zip(position.position_ned, position.velocity_ned, target, strict=True)
    n, e, d = (p - v * back_s + t for p, v, t in parts)
    return (n, e, d)


def _body_from_ned(attitude: Attitude, v: Vector3) -> Vector3:
    """A vector in body axes (FRD), by the aerospace roll, pitch and yaw."""
    (cr, sr), (cp, sp), (cy, sy) = (
        (math.cos(a), math.sin(a)) for a in (attitude.roll, attitude.pitch, attitude.yaw)
    )
    n, e, d = v
    ahead, right = cy * n + sy * e, -sy * n + cy * e
    x, down = cp * ahead - sp * d, sp * ahead + cp * d
    return (x, cr * right + sr * down, -sr * right + cr * down)
