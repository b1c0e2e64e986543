"""Where the simulated vehicle was: its poses of the last seconds, for a camera that looks a little back in time."""

from bisect import bisect_right
from collections import deque

import numpy as np

from drivers.errors import DriverError
from drivers.simulated.vehicle.quaternion import Quaternion, Vector, normalised, to_matrix
from drivers.simulated.vehicle.vehicle import Multirotor
from drivers.simulated.world.camera import Pose

KEPT = 2000


class PoseHistory:
    """``add`` after every step of the physics; ``at`` interpolates in between, from any thread."""

    def __init__(self) -> None:
        self._poses: deque[tuple[float, Vector, Quaternion, Vector]] = deque(maxlen=KEPT)

    def add(self, vehicle: Multirotor) -> None:
        """Keep the vehicle's pose of this moment."""
        self._poses.append((vehicle.time_s, vehicle.position, vehicle.attitude, vehicle.velocity))

    @property
    def newest_s(self) -> float:
        """Time of the newest pose; -inf while there is none."""
        return self._poses[-1][0] if self._poses else -np.inf

    def at(self, time_s: float) -> Pose:
        """The pose at a simulated time; the ends hold beyond the times that are kept by at most 50 ms."""
        poses = list(self._poses)
        if not poses or not poses[0][0] - 0.05 <= time_s <= poses[-1][0] + 0.05:
            raise DriverError(f"no pose of the simulated vehicle is known at {time_s:.3f} s")
        k = min(max(bisect_right(poses, time_s, key=lambda p: p[0]), 1), len(poses) - 1)
        t0, p0, q0, v0 = poses[k - 1]
        t1, p1, q1, v1 = poses[k]
        share = 0.0 if t1 == t0 else min(max((time_s - t0) / (t1 - t0), 0.0), 1.0)
        sign = 1.0 if sum(a * b for a, b in zip(q0, q1, strict=True)) >= 0 else -1.0
        q = normalised(
            (
                q0[0] + share * (sign * q1[0] - q0[0]),
                q0[1] + share * (sign * q1[1] - q0[1]),
                q0[2] + share * (sign * q1[2] - q0[2]),
                q0[3] + share * (sign * q1[3] - q0[3]),
            )
        )
        position = np.array(p0) + share * (np.array(p1) - np.array(p0))
        velocity = np.array(v0) + share * (np.array(v1) - np.array(v0))
        return Pose(position, np.array(to_matrix(q)), velocity)
