"""Evidence over time: the same plane gets surer, another plane is noticed at once."""

import math

import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from landing.plane.evidence import Evidence, EvidenceOptions, from_world, slope_std, to_world
from landing.rotations import matrix_from_euler
from landing.vision.camera import DOWN

OPTIONS = EvidenceOptions(
    memory_s=1.0, drift_std=0.003, agreement=9.0, agreement_alone=25.0, overlap=0.5, floor_std=0.0
)
STD = 0.02
COVARIANCE = np.eye(2) * STD**2
RATE_HZ = 30.0
GAP = 2
"""With an overlap of a half every estimate over two frames counts as new."""

angle = st.floats(-0.4, 0.4)


def seen(slope_ned: tuple[float, float], ned_from_camera: np.ndarray) -> tuple[float, float]:
    """(a, b) in the camera of ground that falls by tangents to north and east."""
    n = ned_from_camera.T @ np.array((-slope_ned[0], -slope_ned[1], 1.0))
    return -n[0] / n[2], -n[1] / n[2]


def attitude(k: int) -> np.ndarray:
    return matrix_from_euler(0.1 * math.sin(k / 5), -0.15 * math.cos(k / 7), 0.05 * k) @ DOWN


def feed(
    evidence: Evidence,
    rng: np.random.Generator,
    slope_ned: tuple[float, float],
    frames: range,
    noise: float = STD,
) -> list[np.ndarray]:
    """Errors (a, b) of the fused slope after each frame."""
    errors = []
    for k in frames:
        a, b = seen(slope_ned, attitude(k))
        noisy = np.array((a, b)) + rng.standard_normal(2) * noise
        evidence.add(k, k / RATE_HZ, attitude(k), noisy[0], noisy[1], COVARIANCE, GAP)
        fused = evidence.fuse(k / RATE_HZ, attitude(k))
        assert fused is not None
        errors.append(np.array(fused[:2]) - (a, b))
    return errors


@examples(60)
@given(angle, angle, st.floats(-3, 3), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_to_the_world_and_back_is_the_same(roll: float, pitch: float, yaw: float, a: float, b: float):
    turn = matrix_from_euler(roll, pitch, yaw) @ DOWN
    covariance = np.array(((3e-4, 1e-4), (1e-4, 2e-4)))
    world = to_world(turn, a, b, covariance)
    if world is None:
        return
    back = from_world(turn, world[0], world[1])
    assert back is not None
    np.testing.assert_allclose(back[:2], (a, b), atol=1e-9)
    np.testing.assert_allclose(back[2], covariance, atol=1e-10)


def test_covariances_turn_with_the_slopes():
    rng = np.random.default_rng(1)
    turn = matrix_from_euler(0.2, -0.3, 1.0) @ DOWN
    covariance = np.array(((3e-5, 1e-5), (1e-5, 2e-5)))
    world = to_world(turn, 0.3, -0.2, covariance)
    assert world is not None
    drawn = rng.multivariate_normal((0.3, -0.2), covariance, 2000)
    slopes = np.array([to_world(turn, a, b, covariance)[0] for a, b in drawn])
    np.testing.assert_allclose(np.cov(slopes.T), world[1], rtol=0.15, atol=2e-6)


def test_the_same_plane_gets_surer_while_the_vehicle_turns():
    evidence = Evidence(OPTIONS)
    errors = feed(evidence, np.random.default_rng(2), (0.2, -0.1), range(30))
    fused = evidence.fuse(29 / RATE_HZ, attitude(29))
    assert fused is not None
    assert slope_std(fused[2]) < STD / 4
    assert evidence.used == 30
    late = np.array(errors[15:])
    assert np.sqrt((late**2).mean()) < STD / 3


def test_the_stated_deviation_is_honest():
    normalised = []
    for seed in range(60):
        evidence = Evidence(OPTIONS)
        error = feed(evidence, np.random.default_rng(seed), (0.1, 0.1), range(12))[-1]
        fused = evidence.fuse(11 / RATE_HZ, attitude(11))
        assert fused is not None
        normalised.append(error / np.sqrt(np.diag(fused[2])))
    assert 0.75 < np.std(normalised) < 1.25


def test_overlapping_baselines_do_not_count_as_new():
    long, short = Evidence(OPTIONS), Evidence(OPTIONS)
    for k in range(12):
        long.add(k, k / RATE_HZ, DOWN, 0.1, 0.1, COVARIANCE, 24)
        short.add(k, k / RATE_HZ, DOWN, 0.1, 0.1, COVARIANCE, GAP)
    at = 11 / RATE_HZ
    one, other = long.fuse(at, DOWN), short.fuse(at, DOWN)
    assert one is not None
    assert other is not None
    assert slope_std(one[2]) == pytest.approx(STD, rel=0.05), "twelve of twenty-four frames are not yet two"
    assert slope_std(other[2]) < STD / 3


def test_another_plane_is_noticed_at_once_and_does_not_lag():
    evidence, rng = Evidence(OPTIONS), np.random.default_rng(3)
    feed(evidence, rng, (0.0, 0.0), range(30))
    errors = feed(evidence, rng, (0.5, 0.0), range(30, 45))
    assert np.abs(errors[0]).max() < 4 * STD, "the first estimate of the new plane stands for itself"
    assert evidence.used <= 15
    assert np.abs(errors[-1]).max() < 3 * STD


def test_a_plane_that_bends_slowly_is_followed():
    evidence, rng = Evidence(OPTIONS), np.random.default_rng(4)
    errors = []
    for k in range(90):
        errors += feed(evidence, rng, (0.01 * k, 0.0), range(k, k + 1))
    assert np.abs(np.array(errors[30:])).max() < 5 * STD


def test_memory_ends():
    evidence = Evidence(OPTIONS)
    evidence.add(0, 0.0, DOWN, 0.1, 0.1, COVARIANCE, 1)
    assert evidence.newest_frame == 0
    assert evidence.fuse(0.9, DOWN) is not None
    assert evidence.fuse(1.2, DOWN) is None
    assert evidence.newest_frame is None


def test_age_makes_a_slope_less_sure():
    evidence = Evidence(OPTIONS)
    evidence.add(0, 0.0, DOWN, 0.1, 0.1, np.eye(2) * 1e-8, 1)
    young, old = evidence.fuse(0.01, DOWN), evidence.fuse(0.9, DOWN)
    assert young is not None
    assert old is not None
    assert slope_std(old[2]) > 3 * slope_std(young[2])


def test_clear_forgets():
    evidence = Evidence(OPTIONS)
    evidence.add(0, 0.0, DOWN, 0.1, 0.1, COVARIANCE, 1)
    evidence.clear()
    assert evidence.fuse(0.0, DOWN) is None


def test_a_systematic_error_is_not_fused_away():
    evidence = Evidence(EvidenceOptions(1.0, 0.0, 9.0, 25.0, 0.5, 0.005))
    feed(evidence, np.random.default_rng(5), (0.0, 0.0), range(30))
    fused = evidence.fuse(29 / RATE_HZ, DOWN)
    assert fused is not None
    assert slope_std(fused[2]) >= 0.005


def test_a_wall_is_not_remembered():
    evidence = Evidence(OPTIONS)
    evidence.add(0, 0.0, matrix_from_euler(0, 1.5, 0) @ DOWN, 0.0, 0.0, COVARIANCE, 1)
    assert evidence.fuse(0.0, DOWN) is None


@pytest.mark.parametrize(("sigmas", "used"), [(0.0, 11), (4.0, 11), (8.0, 1)])
def test_a_single_stray_is_taken_in_and_another_surface_is_not(sigmas: float, used: int):
    """An estimate four sigma off is one in some thousand, eight sigma off it is another plane."""
    evidence, up = Evidence(OPTIONS), DOWN
    for k in range(10):
        evidence.add(k, k / RATE_HZ, up, 0.0, 0.0, COVARIANCE, GAP)
    evidence.add(10, 10 / RATE_HZ, up, sigmas * STD, 0.0, COVARIANCE, GAP)
    fused = evidence.fuse(10 / RATE_HZ, up)
    assert fused is not None
    assert evidence.used == used
    assert abs(fused[0]) < STD or used == 1
    # the second one in a row is no stray
    evidence.add(11, 11 / RATE_HZ, up, sigmas * STD, 0.0, COVARIANCE, GAP)
    fused = evidence.fuse(11 / RATE_HZ, up)
    assert fused is not None
    if sigmas:
        assert fused[0] == pytest.approx(sigmas * STD, abs=1e-9)


def test_an_error_of_the_lens_is_in_the_result_however_many_estimates_say_the_same() -> None:
    """Fusing takes the noise out, not the error that all share."""
    lens = np.array(((0.01, 0.0), (0.0, 0.02)))
    evidence, plain = Evidence(OPTIONS), Evidence(OPTIONS)
    for k in range(30):
        evidence.add(k, k / RATE_HZ, DOWN, 0.1, 0.1, COVARIANCE, 1, None, lens)
        plain.add(k, k / RATE_HZ, DOWN, 0.1, 0.1, COVARIANCE, 1)
    with_lens, without = evidence.fuse(29 / RATE_HZ, DOWN), plain.fuse(29 / RATE_HZ, DOWN)
    assert with_lens is not None
    assert without is not None
    assert with_lens[:2] == pytest.approx(without[:2])
    assert with_lens[2] - without[2] == pytest.approx(np.diag((1e-4, 4e-4)), rel=0.05, abs=1e-6)
