"""The velocity over height: of the newest frame, and helped by what the autopilot knows of its own."""

import numpy as np
import pytest
import synthetic_flow
from hypothesis import example, given
from hypothesis import strategies as st

from landing.motion.velocity import VehicleVelocity, newest, newest_guided, velocity
from landing.options import EstimatorOptions
from landing.rotations import exp_so3

RATE_HZ = 30.0
LEVEL = np.array((0.0, 0.0, 1.0))
OPTIONS = EstimatorOptions()


def over(views, normal=LEVEL, options=OPTIONS):
    return velocity(views, normal, np.ones(len(views.tracker.alive)), 1.0, 1e-5, options)


def braking(seed: int, reported=None, age_s: float = 0.0, harder: float = 1.0, off_rad=(0.0, 0.0)):
    """Views of a camera 1 m above level ground that brakes northwards, at 0.5 m/s at the newest of 13 frames.

    It brakes by 0.5 m/s^2, and until a fifth of a second ago by ``harder`` m/s^2 more. ``reported``: the velocity north
    that the autopilot states, from the true one and the time; ``off_rad``: error of the newest attitude's pitch, and of
    all attitudes, one sigma.
    """
    rng, shaken = np.random.default_rng(seed), np.random.default_rng(1000 + seed)
    flight = synthetic_flow.Flight(synthetic_flow.ground(rng, 0.0, 0.0, 1.0, 1.6), rng)
    for k in range(13):
        t = (k - 12) / RATE_HZ
        before = min(t + 0.2, 0.0)
        north = 0.5 * t - 0.25 * t * t - 0.5 * harder * before * before
        speed = 0.5 - 0.5 * t - harder * before
        said = None if reported is None else np.array((reported(speed, t), 0.0, 0.0))
        off = off_rad[1] * shaken.normal(size=3)
        off[1] += off_rad[0] if k == 12 else 0.0
        place = np.array((north, 0, 0))
        flight.step(k / RATE_HZ, place, measured=exp_so3(off), velocity_ned=said, velocity_age_s=age_s)
    return flight.views


@pytest.mark.parametrize("tau_s", [2.0, 0.6])
def test_the_velocity_is_of_the_newest_frame(tau_s: float):
    """The motion over the last interval, without its finite length, would give a contact half a frame late."""
    rng = np.random.default_rng(5)
    rise_north, rise_east = 0.2, -0.3
    velocity_ned = np.array((0.3, 0.5, 1.0)) / tau_s
    flight = synthetic_flow.Flight(synthetic_flow.ground(rng, rise_north, rise_east, 1.0, 1.2), rng, 0.0)
    for k in range(8):
        flight.step(k / RATE_HZ, velocity_ned * (k - 7) / RATE_HZ)
    found = over(flight.views, np.array((rise_east, -rise_north, 1.0)))
    assert found is not None
    # 1 m above the ground at the newest frame; camera x is east, y south
    np.testing.assert_allclose(found[0], (velocity_ned[1], -velocity_ned[0], velocity_ned[2]), atol=2e-5)


def test_a_camera_that_brakes_is_followed():
    found = over(braking(6, harder=0.0))
    assert found is not None
    assert found[0][1] == pytest.approx(-0.5, abs=0.02)
    assert abs(found[0][1] + 0.5) < 4 * found[1][1]


def test_what_the_autopilot_knows_of_its_velocity_makes_the_result_better():
    """It is wrong by a fifth and yet tells how the velocity changed."""

    def errors(**said):
        found = [over(braking(seed, off_rad=(0.0, 5e-4), **said)) for seed in range(30)]
        assert all(f is not None for f in found)
        return np.array([f[0] - (0, -0.5, 0) for f in found]), np.array([f[1] for f in found])

    alone, _ = errors()
    guided, std = errors(reported=lambda speed, t: speed + 0.1)
    assert np.sqrt((guided**2).mean()) < 0.7 * np.sqrt((alone**2).mean())
    assert np.sqrt(((guided / std) ** 2).mean()) < 1.5


@pytest.mark.parametrize("jump", [-10.0, -0.5, 0.4, 1.0, 10.0])
@pytest.mark.parametrize("ago_s", [0.02, 0.1, 0.3])
def test_a_velocity_that_jumps_spoils_little(jump: float, ago_s: float):
    """A navigation filter that is reset changes its velocity at once, the vehicle does not."""
    found = over(braking(7, reported=lambda speed, t: speed + (jump if t > -ago_s else 0.0)))
    assert found is not None
    assert found[0][1] == pytest.approx(-0.5, rel=0.05)


@pytest.mark.parametrize("reported", [lambda speed, t: -speed, lambda speed, t: 0.0])
def test_a_velocity_against_the_motion_or_none_does_not_count(reported):
    alone, other = over(braking(8)), over(braking(8, reported=reported))
    assert alone is not None
    assert other is not None
    np.testing.assert_array_equal(other[0], alone[0])


def test_an_old_velocity_does_not_count():
    alone = over(braking(9))
    old = over(braking(9, reported=lambda speed, t: speed, age_s=2 * OPTIONS.velocity_max_age_s))
    assert alone is not None
    assert old is not None
    np.testing.assert_array_equal(old[0], alone[0])


def test_one_frame_has_no_velocity():
    rng = np.random.default_rng(7)
    flight = synthetic_flow.Flight(synthetic_flow.ground(rng, 0, 0, 1.0, 1.2), rng)
    assert over(flight.step(0.0, np.zeros(3))) is None


@pytest.mark.parametrize("gaps", [1, 2, 3])
def test_the_newest_velocity_is_the_least_squares_solution(gaps: int):
    rng = np.random.default_rng(gaps)
    tau = np.arange(1, gaps + 1) / 10
    t = rng.normal(size=(gaps, 3))
    omega, std = newest(tau, t, covariances(rng, gaps))
    for axis, covariance in enumerate(covariances(np.random.default_rng(gaps), gaps, skip=3 * gaps)):
        solution, variance = least_squares(-tau[:, None], t[:, axis], covariance)
        assert omega[axis] == pytest.approx(solution[0])
        assert std[axis] == pytest.approx(variance[0, 0] ** 0.5)


@pytest.mark.parametrize("gaps", [1, 2, 3])
def test_the_velocity_reported_is_the_least_squares_solution(gaps: int):
    """Against one system of equations for all three axes: displacements, and omega = k (velocity - error)."""
    rng = np.random.default_rng(gaps)
    tau, per_metre = np.arange(1, gaps + 1) / 10, 0.5
    reported = VehicleVelocity(rng.normal(size=3), rng.normal(0, 0.1, (gaps, 3)), std=0.06, noise=0.01)
    t = per_metre * (reported.detour - tau[:, None] * reported.velocity) + rng.normal(0, 1e-3, (gaps, 3))
    errors = covariances(rng, gaps)
    omega, std, chi_square = newest_guided(tau, t, errors, reported, per_metre)
    rows = np.zeros((3 * gaps + 3, 4))
    observed = np.zeros(3 * gaps + 3)
    covariance = np.eye(3 * gaps + 3) * (per_metre * reported.std) ** 2
    for axis in range(3):
        part = slice(axis * gaps, (axis + 1) * gaps)
        rows[part, axis], rows[part, 3] = -tau, reported.detour[:, axis]
        observed[part] = t[:, axis]
        covariance[part, part] = errors[axis]
    rows[-3:, :3], rows[-3:, 3] = np.eye(3), -reported.velocity
    solution, variance = least_squares(rows, observed, covariance)
    left = observed - rows @ solution
    np.testing.assert_allclose(omega, solution[:3])
    spread = variance.diagonal()[:3] + (solution[3] * reported.noise) ** 2
    np.testing.assert_allclose(std, np.sqrt(spread))
    assert chi_square == pytest.approx(left @ np.linalg.solve(covariance, left))


def covariances(rng, gaps: int, skip: int = 0):
    """Three of them, of errors that go together."""
    rng.normal(size=skip)
    spread = rng.normal(0, 1e-3, (3, gaps, gaps))
    return spread @ spread.transpose(0, 2, 1) + 1e-6 * np.eye(gaps)


def least_squares(rows, observed, covariance):
    weight = np.linalg.inv(covariance)
    variance = np.linalg.inv(rows.T @ weight @ rows)
    return variance @ rows.T @ weight @ observed, variance


def test_displacements_that_tell_nothing_give_no_velocity():
    omega, _ = newest(np.zeros(2), np.zeros((2, 3)), np.broadcast_to(np.eye(2), (3, 2, 2)))
    assert np.isnan(omega).all()


def test_a_velocity_against_its_own_changes_is_refused():
    """The camera went the one way and the vehicle says that it went the other."""
    tau, reported = (
        np.array((0.1, 0.2)),
        VehicleVelocity(np.array((1.0, 0.0, 0.0)), np.zeros((2, 3)), 0.01, 0.0),
    )
    t = tau[:, None] * (1.0, 0.0, 0.0)
    assert newest_guided(tau, t, np.broadcast_to(1e-6 * np.eye(2), (3, 2, 2)), reported, 1.0)[2] == np.inf


def test_an_attitude_that_is_off_counts_less_with_a_velocity():
    """A millirad in the newest frame alone, as while a vehicle begins to turn."""

    def moved(reported):
        off, straight = (over(braking(11, reported, off_rad=(rad, 0.0))) for rad in (1e-3, 0.0))
        assert off is not None
        assert straight is not None
        assert (abs(off[0] - (0, -0.5, 0)) < 2.5 * off[1]).all()
        return abs(off[0] - straight[0])[1]

    assert moved(lambda speed, t: speed) < 0.5 * moved(None)


@example([0.0, 0.296875, -1.4694595505584182e26], 1e-30)
@given(st.lists(st.floats(-1e38, 1e38), min_size=3, max_size=3), st.floats(1e-30, 10.0))
def test_whatever_velocity_is_reported_nothing_breaks(said, per_metre: float):
    """Garbage that a link lets through is a number as well."""
    tau, reported = np.array((0.1, 0.2)), VehicleVelocity(np.array(said), np.zeros((2, 3)), 0.06, 0.0)
    covariance = np.broadcast_to(1e-6 * np.eye(2), (3, 2, 2))
    _, _, chi_square = newest_guided(tau, tau[:, None] * (0.1, -0.3, 0.02), covariance, reported, per_metre)
    assert chi_square >= 0 or not np.isfinite(chi_square)
