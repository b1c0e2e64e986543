"""A vehicle that another simulator flies, followed by its messages, so that a simulated camera can look down from it.

PX4's SIH (simulation in hardware) computes its own physics. ODOMETRY has the estimated pose with microseconds,
HIL_STATE_QUATERNION the true one, without a time and in whole centimetres. The difference of the two corrects the
estimate: of the place smoothed over seconds, which takes rounding out; of the attitude over a tenth of a second, since
SIH's gyro is rough (0.14 rad/s in roll) and the estimated attitude wanders by degrees, which a camera must not see.
"""

import math
import time
from collections import deque
from typing import Any

from drivers.simulated.vehicle.quaternion import Quaternion, Vector, multiply, normalised, rotate
from drivers.simulated.vehicle.vehicle import Multirotor, TouchDown

EARTH_M_PER_DEG = 111_319.5
SMOOTHED, SMOOTHED_TURN = 0.005, 0.15
"""Weight of one difference in the correction of place and attitude: 4 s and 0.13 s at the 50 Hz of true poses."""
FLOOR_M = 0.05
"""SIH's ground is level, at the height of the start: so near to it the vehicle has come down."""
LIFTED_M = 0.3
AHEAD_S, KEPT_S, BUCKET_S = 0.5, 1.0, 0.05
LEAST_SPEED, SPEED_SHARE = 0.02, 0.02


class FollowedVehicle:
    """Moves a ``Multirotor`` to the poses that are reported; ``origin`` (north, east) m is where the other began.

    The other's ground lies at height 0 of the scene.
    """

    def __init__(self, vehicle: Multirotor, origin: tuple[float, float]) -> None:
        self._vehicle = vehicle
        self._origin = origin
        self._home: tuple[float, float, float] | None = None
        self._true: tuple[Vector, Quaternion] | None = None
        self._moved: Vector = (0.0, 0.0, 0.0)
        self._turned: Quaternion = (1.0, 0.0, 0.0, 0.0)
        self._corrected = False
        self._fresh = False
        """Whether the true pose came since the last ODOMETRY: only then are the two of one moment."""
        self._lifted = False
        self._sinks_m_s = 0.0

    def true_pose(self, message: Any) -> None:
        """Take HIL_STATE_QUATERNION; the first one is of the start."""
        where = (message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3)
        if self._home is None:
            self._home = where
        north = (where[0] - self._home[0]) * EARTH_M_PER_DEG
        east = (where[1] - self._home[1]) * EARTH_M_PER_DEG * math.cos(math.radians(self._home[0]))
        w, x, y, z = map(float, message.attitude_quaternion)
        self._true = (north, east, self._home[2] - where[2]), (w, x, y, z)
        self._fresh = True
        self._sinks_m_s = message.vz * 0.01

    def odometry(self, message: Any) -> bool:
        """Take ODOMETRY and move the vehicle there; False where it is not newer or no true pose is known yet."""
        time_s, v = message.time_usec * 1e-6, self._vehicle
        if self._true is None or time_s <= v.time_s:
            return False
        reported: Vector = (message.x, message.y, message.z)
        w, x, y, z = map(float, message.q)
        attitude = normalised((w, x, y, z))
        if self._fresh:
            self._fresh = False
            self._correct(reported, attitude)
        v.time_s = time_s
        v.attitude = normalised(multiply(self._turned, attitude))
        v.velocity = rotate(v.attitude, (message.vx, message.vy, message.vz))
        v.rates = (message.rollspeed, message.pitchspeed, message.yawspeed)
        v.position = (
            self._origin[0] + reported[0] + self._moved[0],
            self._origin[1] + reported[1] + self._moved[1],
            reported[2] + self._moved[2] - v.airframe.leg_m,
        )
        self._touch()
        return True

    def _correct(self, reported: Vector, attitude: Quaternion) -> None:
        assert self._true is not None
        place, turned = self._true
        w, x, y, z = attitude
        error = multiply(turned, (w, -x, -y, -z))
        if error[0] < 0:
            error = (-error[0], -error[1], -error[2], -error[3])
        share, share_turn = (SMOOTHED, SMOOTHED_TURN) if self._corrected else (1.0, 1.0)
        self._corrected = True
        m, t = self._moved, self._turned
        self._moved = (
            m[0] + share * (place[0] - reported[0] - m[0]),
            m[1] + share * (place[1] - reported[1] - m[1]),
            m[2] + share * (place[2] - reported[2] - m[2]),
        )
        self._turned = normalised(
            (
                t[0] + share_turn * (error[0] - t[0]),
                t[1] + share_turn * (error[1] - t[1]),
                t[2] + share_turn * (error[2] - t[2]),
                t[3] + share_turn * (error[3] - t[3]),
            )
        )

    def _touch(self) -> None:
        v = self._vehicle
        assert self._true is not None
        up = -self._true[0][2]
        v.on_ground = up < FLOOR_M and abs(self._sinks_m_s) < FLOOR_M
        if up > LIFTED_M:
            self._lifted = True
        elif self._lifted and up < FLOOR_M:
            self._lifted = False
            v.touch_downs.append(TouchDown(v.time_s, v.position, v.velocity, 0.0))


class FollowedClock:
    """The other simulator's time at this moment, from the times of its poses and when they were taken.

    No message is ever older than its own stamp, so that the clock must not fall behind: a pose that a busy machine
    takes late does not put it back. The earliest of the poses of a second counts, and time runs on from it at the
    simulator's speed, at most ``AHEAD_S`` beyond the newest pose.
    """

    def __init__(self) -> None:
        self._poses: deque[tuple[float, float]] = deque()
        """(taken at, time) in seconds, of the last second, the earliest of every ``BUCKET_S``."""
        self._newest_s: float | None = None
        self._speed = 1.0
        self._fresh = True

    def feed(self, time_s: float, taken_s: float | None = None) -> None:
        """A pose of ``time_s`` was taken now, or at ``taken_s`` of the monotonic clock."""
        at = time.monotonic() if taken_s is None else taken_s
        if self._newest_s is not None and time_s < self._newest_s:
            self._poses.clear()  # it began anew
            self._fresh = True
        self._newest_s = time_s
        poses = list(self._poses)
        if poses and at - poses[0][0] > BUCKET_S:
            speed = (time_s - poses[0][1]) / (at - poses[0][0])
            speed = min(max(speed, LEAST_SPEED), 1.0 / LEAST_SPEED)
            self._speed = speed if self._fresh else self._speed + SPEED_SHARE * (speed - self._speed)
            self._fresh = False
        if poses and at - poses[-1][0] < BUCKET_S:
            last_at, last_s = poses[-1]
            if time_s - last_s <= self._speed * (at - last_at):
                return
            poses.pop()
        poses.append((at, time_s))
        self._poses = deque(p for p in poses if at - p[0] <= KEPT_S)

    def now_s(self, at_s: float | None = None) -> float | None:
        """The time now, or at ``at_s`` of the monotonic clock; None before the first pose."""
        poses, newest = self._poses, self._newest_s
        if newest is None or not poses:
            return None
        at = time.monotonic() if at_s is None else at_s
        return min(max(time_s + self._speed * (at - taken) for taken, time_s in poses), newest + AHEAD_S)
