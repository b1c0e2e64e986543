"""The rotation of the pictures against the vehicle's: an attitude that wanders is none of what a wrong mount is."""

import math
from dataclasses import replace

import numpy as np
import pytest
import synthetic_flow

from landing.motion.contradictions import Contradictions
from landing.plane.turn_comparison import TurnComparison
from landing.reasons import Status
from landing.rotations import exp_so3, log_so3, matrix_from_euler

RATE_HZ, SECONDS = 15.0, 4.0
NO_GROUND = (math.nan, math.nan)
HALF_TURN, MIRROR = np.diag((-1.0, -1.0, 1.0)), np.diag((1.0, -1.0, 1.0))


def gusts(t: float):
    """The attitude (3, 3) of a vehicle that rocks by two degrees."""
    roll = 0.03 * math.sin(4.4 * t) + 0.02 * math.sin(7.1 * t + 1)
    return matrix_from_euler(
        roll, 0.03 * math.cos(3.3 * t) + 0.02 * math.sin(9.7 * t), 0.03 * math.sin(2 * t)
    )


def compared(
    reported, seed: int = 3, speed_m_s: float = 0.6, noise_px: float = 0.3, step_m: float = 0.0, wander=None
):
    """All comparisons of a flight 2 m over ground whose attitude at t is given as ``reported(t)``.

    The ground is level but for a step across the way, in view from the start.
    """
    rng = np.random.default_rng(seed)
    points = synthetic_flow.ground(rng, 0.0, 0.0, 2.0, 8.0, 600)
    points[:, 2] += step_m * (points[:, 0] > 0.3 + 0.4 * points[:, 1])
    flight = synthetic_flow.Flight(points, rng, noise_px)
    comparison, out = TurnComparison(7e-4), []
    for k in range(round(RATE_HZ * SECONDS)):
        t = k / RATE_HZ
        views = flight.step(t, np.array((speed_m_s * t, 0.0, 0.0)), gusts(t), reported(t))
        views._views[-1] = replace(views.newest, wander=wander)
        out.append((t, comparison.step(views, 1e-3)))
    return out


def failing(comparisons) -> tuple[Status, ...]:
    contradictions = Contradictions()
    ever: set[Status] = set()
    for t, rotation in comparisons:
        contradictions.step(t, rotation, math.nan, NO_GROUND, 0.0, 1e-3)
        ever |= set(contradictions.failing)
    return tuple(ever)


def wandering(seed: int):
    """An estimator's level and heading that wander by 0.4 and 0.8 degrees with a time constant of 8 s."""
    rng = np.random.default_rng(seed)
    std, kept = np.radians((0.4, 0.4, 0.8)), math.exp(-1 / (8.0 * RATE_HZ))
    errors = [rng.normal(0, std)]
    for _ in range(round(RATE_HZ * SECONDS)):
        errors.append(kept * errors[-1] + rng.normal(0, std * math.sqrt(1 - kept**2)))
    return lambda t: matrix_from_euler(*errors[round(t * RATE_HZ)]) @ gusts(t)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("speed_m_s", [0.0, 0.6])
def test_an_attitude_that_wanders_as_an_autopilots_does_is_no_contradiction(seed, speed_m_s):
    found = compared(wandering(seed), seed, speed_m_s)
    assert failing(found) == ()
    assert sum(freedom for _, (_, freedom) in found) > 80


@pytest.mark.parametrize("step_m", [2.0, -0.8])
def test_a_roof_beside_the_ground_below_it_is_no_contradiction(step_m):
    assert failing(compared(wandering(1), step_m=step_m, speed_m_s=1.2)) == ()


def converging(t: float):
    """A heading that turns by ten degrees a second while the vehicle's does not, as after a PX4's takeoff."""
    return matrix_from_euler(0, 0, math.radians(10) * t) @ gusts(t)


@pytest.mark.parametrize("noticed", [True, False])
def test_a_heading_that_converges_contradicts_only_where_the_rates_of_turn_do_not_show_it(noticed):
    wander = np.array((0.0, 0.0, 0.15)) if noticed else None
    found = compared(converging, wander=wander)
    assert failing(found) == (() if noticed else (Status.ROTATION_CONTRADICTS,))
    assert sum(freedom for _, (_, freedom) in found) > 80


def test_matches_that_any_rotation_explains_are_not_compared():
    # close to the ground at takeoff, where a pixel of texture fills the picture
    found = compared(gusts, noise_px=25.0)
    assert failing(found) == ()
    assert sum(freedom for _, (_, freedom) in found) < 20


def test_its_chi_square_has_its_degrees_of_freedom():
    total = np.sum([chi for seed in range(8) for _, chi in compared(wandering(seed), seed)], axis=0)
    assert 0.25 < total[0] / total[1] < 1.0


@pytest.mark.parametrize(
    "reported",
    [
        lambda t: HALF_TURN @ gusts(t) @ HALF_TURN,
        lambda t: MIRROR @ gusts(t) @ MIRROR,
        lambda t: exp_so3(log_so3(gusts(t)) / 0.6),
        lambda t: gusts(t + 0.5),
        lambda t: gusts(2.0 - abs(2.0 - t % 4.0) + 7),
        lambda t: np.eye(3),
    ],
    ids=["mount_180", "mirrored", "focal", "old", "to_and_fro", "frozen_attitude"],
)
@pytest.mark.parametrize("speed_m_s", [0.0, 0.6])
def test_pictures_that_turn_otherwise_than_the_vehicle_contradict(reported, speed_m_s):
    assert failing(compared(reported, speed_m_s=speed_m_s)) == (Status.ROTATION_CONTRADICTS,)


def test_without_attitudes_or_with_few_tracks_nothing_is_compared():
    rng = np.random.default_rng(1)
    for points, known in ((300, False), (15, True)):
        flight = synthetic_flow.Flight(synthetic_flow.ground(rng, 0.0, 0.0, 2.0, 3.0, points), rng)
        comparison = TurnComparison(7e-4)
        for k in range(10):
            views = flight.step(k / RATE_HZ, np.zeros(3), gusts(k / RATE_HZ), known=known)
            assert comparison.step(views, 1e-3) == (0.0, 0)


def test_ten_comparisons_a_second_and_all_of_them_after_a_gap_or_a_step_back():
    rng = np.random.default_rng(1)
    flight = synthetic_flow.Flight(synthetic_flow.ground(rng, 0.0, 0.0, 2.0, 6.0, 300), rng)
    comparison = TurnComparison(7e-4)
    found = [comparison.step(flight.step(k / 60, np.zeros(3), gusts(k / 60)), 1e-3)[1] for k in range(60)]
    assert 8 <= np.count_nonzero(found) <= 11
