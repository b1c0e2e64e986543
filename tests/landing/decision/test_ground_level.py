"""The height over the ground from altitude, view and velocity: known answers, and what each error does."""

import math
import random

import numpy as np
import pytest

from landing.decision.ground_level import ANEW_S, KNOWN_STD, GroundLevel
from landing.decision.lean import DRIFT_S2, HELD_S, Lean
from landing.rotations import matrix_from_euler

DT = 1 / 15


def flown(heights, measured, *, std=0.7, share=None, approach=None, level=0.0):
    """``measured``: of (time, true height) what a frame measures."""
    ground = GroundLevel()
    for k, height in enumerate(heights):
        before = heights[max(k - 1, 0)]
        sinks = (before - height) / DT / height if approach is None else approach
        found = measured(k * DT, height)
        ground.step(k * DT, (0.0, 0.0, level - height), sinks, found, std if share is None else share * found)
    return ground


def test_a_hovering_vehicle_averages_the_noise_out():
    r = random.Random(1)
    ground = flown([4.0] * 150, lambda t, h: h + r.gauss(0, 0.7))
    assert ground.height_m == pytest.approx(4.0, abs=0.3)
    assert 0.1 < ground.std_m < 0.5


def test_a_descent_tells_the_height_where_every_measurement_is_wrong():
    """As a slow velocity that is too large makes it: 40 % too high for the whole descent."""
    sinking = [4.0 * math.exp(-0.25 * k * DT) for k in range(int(5 / DT))]
    wrong = flown(sinking, lambda t, h: 1.4 * h, share=0.3)
    assert wrong.height_m == pytest.approx(sinking[-1], rel=0.15)
    level = flown([4.0] * 75, lambda t, h: 1.4 * h, share=0.3)
    assert level.height_m == pytest.approx(5.6, abs=0.1), "a hover does not show it"
    climbing = [2.0 + 0.5 * k * DT for k in range(int(5 / DT))]
    assert flown(climbing, lambda t, h: 1.4 * h, share=0.3).height_m == pytest.approx(climbing[-1], rel=0.15)


def test_a_step_of_the_ground_is_another_level_after_a_while_and_one_wrong_height_is_none():
    single = flown([4.0] * 75, lambda t, h: 1.0 if 2.0 < t < 2.2 else h, std=0.2)
    assert single.height_m == pytest.approx(4.0, abs=0.05)
    roof_s = 3.0
    roof = flown([4.0] * 75, lambda t, h: h - 2.0 if t > roof_s else h, std=0.2)
    assert roof.height_m == pytest.approx(2.0, abs=0.1)
    assert ANEW_S < 1.0


@pytest.mark.parametrize("nothing", [math.nan, 0.0, -1.0, math.inf])
def test_without_a_measurement_or_a_position_there_is_no_height(nothing):
    assert math.isnan(flown([4.0] * 30, lambda t, h: nothing).height_m)
    assert math.isnan(flown([4.0] * 30, lambda t, h: h, std=math.nan).height_m)
    ground = flown([4.0] * 60, lambda t, h: h, std=0.3)
    assert ground.height_m == pytest.approx(4.0)
    ground.step(60 * DT, None, 0.0, 4.0, 0.3)
    assert math.isnan(ground.height_m)


def test_a_height_of_too_large_a_deviation_is_unknown():
    std = 1.2 * KNOWN_STD * 4.0
    assert math.isnan(flown([4.0], lambda t, h: h, std=std).height_m)
    assert flown([4.0], lambda t, h: h, std=std / 2).height_m == pytest.approx(4.0)


def test_an_altitude_that_jumps_is_another_level_and_the_height_stays():
    ground = GroundLevel()
    for k in range(90):
        down = -4.0 if k < 45 else -14.0
        ground.step(k * DT, (0.0, 0.0, down), 0.0, 4.0, 0.2)
    assert ground.height_m == pytest.approx(4.0, abs=0.1)


def leaning(bearing, drag, seconds=30.0, speed=lambda t: 0.0):
    """A vehicle that holds its place against a drag in m/s^2 towards a bearing, flying north at ``speed``."""
    lean = Lean()
    for k in range(int(seconds / DT)):
        time_s = k * DT
        accelerates = (speed(time_s + DT / 2) - speed(time_s - DT / 2)) / DT
        north = accelerates - drag * math.cos(bearing)
        east = -drag * math.sin(bearing)
        down = np.array((-north, -east, 9.81))
        down /= np.linalg.norm(down)
        attitude = matrix_from_euler(-math.asin(down[1]), math.atan2(down[0], down[2]), 0.0)
        lean.step(time_s, attitude, np.array((speed(time_s), 0.0, 0.0)))
    return lean.drift_m


@pytest.mark.parametrize("bearing", [0.0, 1.0, 2.5, -2.0])
def test_the_lean_of_a_vehicle_that_holds_its_place_is_the_wind(bearing):
    north, east = leaning(bearing, 2.8)
    assert north == pytest.approx(DRIFT_S2 * 2.8 * math.cos(bearing), abs=0.01)
    assert east == pytest.approx(DRIFT_S2 * 2.8 * math.sin(bearing), abs=0.01)


def test_accelerating_is_no_wind_and_what_is_unknown_is_none():
    north, east = leaning(0.0, 0.0, speed=lambda t: 1.5 * math.sin(t))
    assert math.hypot(north, east) < 0.02
    assert leaning(0.0, 2.8, seconds=DT) == pytest.approx((DRIFT_S2 * 2.8, 0.0))
    lean = Lean()
    assert lean.drift_m == (0.0, 0.0)
    upright = np.eye(3)
    lean.step(0.0, upright, np.array((math.nan, 0.0, 0.0)))
    assert lean.drift_m == (0.0, 0.0)
    lean.step(0.1, None, np.zeros(3))
    assert lean.drift_m == (0.0, 0.0)
    assert HELD_S > 1.0
