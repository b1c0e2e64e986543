"""The ground's own velocity: known when the vehicle changes its velocity, unknown when it does not."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import synthetic_flow
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from landing.ground.ground_velocity import GroundVelocity, Passage, misfit, passage
from landing.options import EstimatorOptions
from landing.reasons import Status

FRAME_S, INTERVAL_S = 1 / 15, 0.5


def fly(velocities, distance_m=3.0, ground=(0.0, 0.0), drift=(0.0, 0.0, 0.0), lag_s=0.0, seed=0, noise=0.01):
    """Frames of a vehicle with ``velocities`` (n, 3) m/s over level ground that moves."""
    random, filtered = np.random.default_rng(seed), GroundVelocity()
    velocities = np.asarray(velocities, float)
    change = np.gradient(velocities, FRAME_S, axis=0)
    filtered.step(0.0, None)
    for velocity, acceleration in zip(velocities, change, strict=True):
        distance_m -= velocity[2] * FRAME_S
        over = velocity - (*ground, 0.0)
        flow = over / distance_m + random.normal(0, 0.003, 3)
        reported = velocity + drift + random.normal(0, noise, 3) - lag_s * acceleration
        seen = Passage(INTERVAL_S, flow, np.full(3, 0.003), reported, noise, acceleration, float(flow[2]))
        filtered.follow(FRAME_S, lambda seen=seen: seen)
    return filtered, distance_m


def started(speed=1.2, seconds=4.0, sink=0.0):
    """From a hover to a speed northwards within half a second, and on."""
    time_s = np.arange(round(seconds / FRAME_S)) * FRAME_S
    north = speed * np.clip((time_s - 0.5) / 0.5, 0, 1)
    return np.column_stack((north, np.zeros_like(north), np.full_like(north, sink)))


@pytest.mark.parametrize("ground", [(0.0, 0.0), (0.4, 0.0), (-0.8, 0.0), (0.0, 1.2), (-0.3, -0.3)])
@pytest.mark.parametrize("sink", [0.0, 0.3])
def test_a_vehicle_that_starts_tells_distance_and_ground(ground, sink):
    found, distance_m = fly(started(sink=sink), ground=ground)
    assert found.distance_m == pytest.approx(distance_m, rel=0.1)
    assert found.velocity == pytest.approx(ground, abs=0.1)
    assert found.speed_m_s == pytest.approx(math.hypot(*ground), abs=0.1)
    assert found.std_m_s < 0.2


def test_a_slow_error_of_the_velocity_is_the_grounds():
    found, _ = fly(started(), ground=(0.1, 0.0), drift=(0.2, -0.1, 0.1))
    assert found.velocity == pytest.approx((0.3, -0.1), abs=0.1)


def test_a_slow_filter_is_no_moving_ground():
    found, _ = fly(started(), lag_s=0.3)
    assert found.speed_m_s < 0.2
    assert found.speed_m_s + found.std_m_s < 0.35


def test_at_a_constant_velocity_nothing_is_known_of_the_ground_along_it():
    constant = np.tile((1.2, 0.0, 0.0), (60, 1))
    found, _ = fly(constant, ground=(0.6, 0.0))
    assert math.isnan(found.speed_m_s) or found.speed_m_s + found.std_m_s > 0.5


def test_over_ground_that_moves_a_hover_tells_nothing_small():
    found, _ = fly(np.zeros((60, 3)), ground=(0.5, 0.2))
    assert math.isnan(found.speed_m_s) or found.speed_m_s + found.std_m_s > 0.5


def test_doubt_grows_while_nothing_is_seen():
    found, _ = fly(started())
    before = found.std_m_s
    for _ in range(30):
        found.step(FRAME_S, None, 0.2)
    assert found.std_m_s > 2 * before
    assert found.distance_m == pytest.approx(3.0 - 0.4, rel=0.1)
    found.step(6.0, None)
    assert math.isnan(found.speed_m_s)


def test_the_height_is_kept_over_a_gap_and_tells_the_ground_after_it():
    found, distance_m = fly(started())
    found.step(1.5, None)
    assert found.speed_m_s + found.std_m_s > 0.3
    over = np.array((1.2 - 0.6, 0.0, 0.0)) / distance_m
    for _ in range(10):
        found.step(
            FRAME_S,
            Passage(INTERVAL_S, over, np.full(3, 0.003), np.array((1.2, 0, 0)), 0.01, np.zeros(3), 0.0),
        )
    assert found.velocity == pytest.approx((0.6, 0.0), abs=0.2)


def test_another_ground_below_is_found_anew():
    found, _ = fly(started())
    velocities = np.tile((1.2, 0.0, 0.0), (60, 1)) + np.sin(np.arange(60) / 5)[:, None] * (0.5, 0.3, 0.0)
    change = np.gradient(velocities, FRAME_S, axis=0)
    for velocity, acceleration in zip(velocities, change, strict=True):
        flow = (velocity - (0.7, 0.0, 0.0)) / 2.0
        found.step(
            FRAME_S,
            Passage(INTERVAL_S, flow, np.full(3, 0.003), velocity, 0.01, acceleration, float(flow[2])),
        )
    assert found.velocity == pytest.approx((0.7, 0.0), abs=0.15)
    assert found.distance_m == pytest.approx(2.0, rel=0.2)


def test_another_ground_below_is_learnt_within_a_second():
    found, _ = fly(started())
    for k in range(15):
        velocity = np.array((1.2 + 0.5 * math.sin(k / 3), 0.3 * math.sin(k / 3), 0.0))
        acceleration = np.array((0.5 / 3 * math.cos(k / 3), 0.1 * math.cos(k / 3), 0.0)) / FRAME_S
        flow = (velocity - (0.7, 0.0, 0.0)) / 2.0
        found.step(FRAME_S, Passage(INTERVAL_S, flow, np.full(3, 0.003), velocity, 0.01, acceleration, 0.0))
    assert found.velocity == pytest.approx((0.7, 0.0), abs=0.06)


def test_the_distance_is_doubtful_or_unknown_together_with_its_doubt():
    assert math.isnan(GroundVelocity().distance_m)
    assert math.isnan(GroundVelocity().distance_std_m)
    found, distance_m = fly(started())
    assert 0 < found.distance_std_m < 0.3 * distance_m


TILTED = np.array((0.05, -0.02, 1.0))


def seen_plane(normal=TILTED, status=Status.OK, noise=1.0, weights=np.ones):
    return SimpleNamespace(normal=normal, status=status, noise=noise, fit_error=0.0, weights=weights)


def over_level(up=False, told=lambda k: True, known=lambda k: True, frames=12):
    """Views of a vehicle that flies north at 0.9 m/s, 2 m over level ground; ``up``: the camera looks up at it."""
    rng = np.random.default_rng(4)
    points = synthetic_flow.ground(rng, 0.0, 0.0, 2.0, 8.0, 300)
    flight = synthetic_flow.Flight(points * (1, 1, -1) if up else points, rng, 0.1)
    over = np.diag((1.0, -1.0, -1.0)) if up else np.eye(3)
    velocity = np.array((0.9, 0.0, 0.0))
    for k in range(frames):
        t = k * FRAME_S
        views = flight.step(t, velocity * t, over, known=known(k), velocity_ned=velocity if told(k) else None)
    return views


def test_the_flow_times_the_distance_is_the_velocity():
    found = passage(over_level(), seen_plane(np.array((0.0, 0.0, 1.0))), EstimatorOptions())
    assert found.flow * 2.0 == pytest.approx((0.9, 0.0, 0.0), abs=0.02)
    assert found.velocity == pytest.approx((0.9, 0.0, 0.0), abs=1e-6)
    assert found.acceleration == pytest.approx((0.0, 0.0, 0.0))
    doubtful = passage(
        over_level(), seen_plane(np.array((0.0, 0.0, 1.0)), noise=math.nan), EstimatorOptions()
    )
    assert doubtful.flow * 2.0 == pytest.approx((0.9, 0.0, 0.0), abs=0.05)


@pytest.mark.parametrize(
    ("views", "plane"),
    [
        ({"frames": 1}, {}),
        ({"known": lambda k: k < 11}, {}),
        ({"told": lambda k: k < 11}, {}),
        ({"told": lambda k: k > 10}, {}),
        ({"told": lambda k: False}, {}),
        ({}, {"normal": np.full(3, math.nan)}),
        ({}, {"weights": np.zeros}),
        ({"up": True}, {"normal": np.full(3, math.nan), "status": Status.MOTION_TOO_SMALL}),
    ],
    ids=[
        "one_frame",
        "no_attitude",
        "no_velocity_now",
        "none_before",
        "none",
        "no_plane",
        "no_tracks",
        "looking_up",
    ],
)
def test_without_tracks_attitude_velocity_or_plane_nothing_is_seen(views, plane):
    assert passage(over_level(**views), seen_plane(**plane), EstimatorOptions()) is None


def test_of_a_motion_too_small_for_a_plane_a_level_one_is_taken():
    unknown = seen_plane(np.full(3, math.nan), Status.MOTION_TOO_SMALL, math.nan)
    found = passage(over_level(), unknown, EstimatorOptions())
    assert found.flow * 2.0 == pytest.approx((0.9, 0.0, 0.0), abs=0.02)
    assert found.flow_std.max() > passage(over_level(), seen_plane(), EstimatorOptions()).flow_std.max()


@examples(25)
@given(
    st.floats(0, 1.5), st.floats(0, 2 * math.pi), st.floats(0.8, 15), st.floats(0.3, 3), st.integers(0, 1000)
)
def test_the_truth_lies_within_the_doubt(speed, bearing, distance_m, own, seed):
    ground = speed * math.cos(bearing), speed * math.sin(bearing)
    found, _ = fly(started(own), distance_m, ground, seed=seed)
    if math.isfinite(found.speed_m_s):
        assert np.linalg.norm(found.velocity - ground) < 3 * found.std_m_s + 0.05


def test_a_passage_without_time_changes_nothing():
    found = GroundVelocity()
    found.step(0.0, None)
    assert math.isnan(found.speed_m_s)
    assert math.isnan(found.std_m_s)
    still = Passage(INTERVAL_S, np.zeros(3), np.full(3, 0.01), np.zeros(3), 0.0, np.zeros(3), 0.0)
    found.step(FRAME_S, replace(still, flow=np.full(3, 0.01)))
    assert math.isnan(found.speed_m_s)


def test_it_looks_ten_times_a_second_and_carries_the_distance_on_between():
    found, _ = fly(started(seconds=3.0, sink=0.3))
    before_m, looks = found.distance_m, 0
    sinking = Passage(INTERVAL_S, np.full(3, 0.1), np.full(3, 1e3), np.zeros(3), 1e3, np.zeros(3), 0.1)

    def look():
        nonlocal looks
        looks += 1
        return sinking

    for _ in range(30):
        found.follow(1 / 30, look)
    assert looks in (10, 11)
    assert found.distance_m == pytest.approx(before_m * math.exp(-0.1), rel=0.02)
    # while nothing is seen every frame is asked
    for _ in range(10):
        found.follow(1 / 30, lambda: None)
    for _ in range(2):
        found.follow(1 / 30, look)
    assert looks in (11, 12)


def over_a_ridge(share):
    """The fastest that the ground seems, over ground whose plane is wrong by 30 % to either side every 1.5 s."""
    filtered, seen_m_s = GroundVelocity(), 0.0
    filtered.step(0.0, None)
    for k in range(240):
        time_s = k * FRAME_S
        north = 0.9 * math.sin(1.1 * time_s)
        wrong = 1.3 if int(time_s / 1.5) % 2 else 0.7
        flow = np.array((north * wrong / 4.0, 0.0, 0.1 * (wrong - 1)))
        std = np.full(3, math.hypot(0.003, share * float(np.linalg.norm(flow))))
        reported = np.array((north, 0.0, 0.0))
        change = np.array((0.99 * math.cos(1.1 * time_s), 0.0, 0.0))
        filtered.step(FRAME_S, Passage(INTERVAL_S, flow, std, reported, 0.03, change, 0.0))
        if time_s > 3 and math.isfinite(filtered.speed_m_s):
            seen_m_s = max(seen_m_s, filtered.speed_m_s - 2 * filtered.std_m_s)
    return seen_m_s


def test_ground_that_is_no_plane_does_not_seem_to_move():
    fit_error, shift = 0.3 * 0.1, 0.1
    assert over_a_ridge(math.hypot(0.02, misfit(fit_error, shift))) < 0.1
    assert over_a_ridge(0.02) > 0.1


def test_what_a_plane_leaves_unexplained_is_a_share_of_the_motion():
    assert misfit(0.01, 0.1) == pytest.approx(0.1)
    assert misfit(math.nan, 0.1) == 0.0
    assert misfit(0.01, 0.0) == 1.0
    assert misfit(1.0, 0.1) == 1.0
