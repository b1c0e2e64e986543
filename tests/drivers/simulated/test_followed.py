"""A vehicle that another simulator flies: where the camera is, and what time it is there."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from drivers.simulated.vehicle.followed import AHEAD_S, FollowedClock, FollowedVehicle
from drivers.simulated.vehicle.quaternion import from_euler, to_euler
from drivers.simulated.vehicle.vehicle import Multirotor


def odometry(time_s, heading):
    q = from_euler(0.0, 0.0, heading)
    return SimpleNamespace(
        time_usec=round(time_s * 1e6), q=q, x=0.0, y=0.0, z=-2.0, vx=0.0, vy=0.0, vz=0.0,
        rollspeed=0.0, pitchspeed=0.0, yawspeed=0.0,
    )  # fmt: skip


def true_pose(heading):
    q = from_euler(0.0, 0.0, heading)
    return SimpleNamespace(lat=0, lon=0, alt=2000, vz=0, attitude_quaternion=q)


def test_the_camera_does_not_see_the_estimators_heading_converge():
    vehicle = Multirotor()
    followed = FollowedVehicle(vehicle, (0.0, 0.0))
    headings = []
    for k in range(500):
        t = k * 0.008
        if k % 2 == 0:
            followed.true_pose(true_pose(0.3))
        followed.odometry(odometry(1 + t, 0.3 + math.radians(10) * min(max(t - 1, 0), 1)))
        headings.append(to_euler(vehicle.attitude)[2])
    # it follows the true heading, a tenth of a second behind while the other converges
    assert max(abs(h - 0.3) for h in headings) < math.radians(10) * 0.2
    assert headings[-1] == pytest.approx(0.3, abs=1e-4)


def test_a_clock_never_falls_behind_a_message_and_does_not_run_away():
    rng = np.random.default_rng(2)
    clock, taken = FollowedClock(), 0.0
    assert clock.now_s(0.0) is None
    for k in range(2000):
        sent = k * 0.016 / 0.4  # at 0.4 times real time
        taken = max(taken, sent + rng.exponential(0.01) + (0.25 if 900 < k < 915 else 0.0))
        clock.feed(k * 0.016, taken)
        if k > 200:
            true_s = 0.4 * taken
            assert -0.03 < clock.now_s(taken) - true_s < 0.03
    assert clock.now_s(taken + 60) == pytest.approx(1999 * 0.016 + AHEAD_S)


def test_a_simulator_that_begins_anew_is_followed():
    clock = FollowedClock()
    for k in range(100):
        clock.feed(50 + k * 0.02, k * 0.02)
    clock.feed(0.5, 3.0)
    assert clock.now_s(3.0) == pytest.approx(0.5, abs=0.01)
