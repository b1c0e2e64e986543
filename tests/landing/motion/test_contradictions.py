"""Pictures against gyro and velocity: what agrees within its noise holds, what does not ends the estimates."""

import math

import numpy as np
import pytest

from landing.motion.contradictions import Contradictions, velocity_chi2
from landing.reasons import Status

NONE = (0.0, 0)


STILL = (math.nan, math.nan)


def run(
    comparisons,
    seconds,
    rotation=NONE,
    velocity=math.nan,
    late_s=0.0,
    late_std_s=0.002,
    start_s=0.0,
    ground=STILL,
):
    """Frames of 30 a second; a comparison may be a function without arguments."""
    for k in range(round(30 * seconds)):
        reported = [c() if callable(c) else c for c in (rotation, velocity)]
        comparisons.step(start_s + k / 30, reported[0], reported[1], ground, late_s, late_std_s)
    return comparisons.failing


@pytest.mark.parametrize("height", [0.5, 3.0, 40.0])
def test_the_velocity_suits_for_its_true_height_with_drift_and_noise(height):
    random = np.random.default_rng(2)
    drift = np.array((0.3, -0.3, 0.1))
    for _ in range(200):
        velocity = random.normal(0, 1.5, 3)
        omega = (velocity + drift + random.normal(0, 0.1, 3)) / height
        assert velocity_chi2(velocity, 0.2, omega, np.full(3, 0.005)) < 8


@pytest.mark.parametrize(
    "turned",
    [np.diag((-1.0, -1.0, 1.0)), np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]), np.diag((-1.0, 1.0, 1.0))],
    ids=["mount_180", "mount_90", "mirrored"],
)
def test_a_velocity_in_another_direction_suits_no_height(turned):
    velocity = np.array((2.0, 0.5, -0.4))
    assert velocity_chi2(velocity, 0.2, turned @ velocity / 5, np.full(3, 0.005)) > 8


def test_hovering_and_unknown_motion_tell_nothing():
    assert velocity_chi2(np.array((0.1, 0, 0)), 0.2, np.array((0.02, -0.03, 0)), np.full(3, 0.005)) < 2
    assert math.isnan(velocity_chi2(np.ones(3), 0.2, np.full(3, np.nan), np.ones(3)))


def test_each_comparison_fails_alone_and_holds_again():
    for options, status in (
        ({"rotation": (60.0, 3)}, Status.ROTATION_CONTRADICTS),
        ({"velocity": 20.0}, Status.VELOCITY_CONTRADICTS),
    ):
        comparisons = Contradictions()
        assert run(comparisons, 3, (3.0, 3), 1.0) == ()
        assert run(comparisons, 3, **({"rotation": (3.0, 3), "velocity": 1.0} | options), start_s=3) == (
            status,
        )
        assert run(comparisons, 6, (3.0, 3), 1.0, start_s=6) == ()


def test_ground_that_moves_for_sure_contradicts_until_it_rests():
    comparisons = Contradictions()
    for ground, fails in (
        ((0.5, 0.1), False),
        ((0.7, 0.1), False),
        ((0.9, 0.1), True),
        ((0.5, 0.1), True),
        (STILL, True),
        ((0.3, 0.1), False),
        ((2.0, 1.0), False),
    ):
        assert run(comparisons, 0.1, ground=ground) == ((Status.VELOCITY_CONTRADICTS,) if fails else ())


def test_one_wild_frame_is_no_contradiction():
    comparisons = Contradictions()
    run(comparisons, 2, (3.0, 3), 1.0)
    comparisons.step(2.0, (100.0, 3), 50.0, STILL, 0.0, 0.002)
    assert comparisons.failing == ()


def test_few_comparisons_do_not_fail():
    assert run(Contradictions(), 0.1, (60.0, 3)) == ()


def test_a_contradiction_stays_while_nothing_can_be_compared():
    comparisons = Contradictions()
    run(comparisons, 2, (60.0, 3))
    assert run(comparisons, 20, start_s=2) == (Status.ROTATION_CONTRADICTS,)


@pytest.mark.parametrize(("late_s", "fails"), [(0.0, False), (0.02, False), (0.06, True), (-0.06, True)])
def test_a_lateness_that_changes_contradicts(late_s, fails):
    comparisons = Contradictions()
    assert run(comparisons, 3) == ()
    assert run(comparisons, 3, late_s=late_s, start_s=3) == ((Status.LATENESS_CONTRADICTS,) if fails else ())


def test_a_lateness_at_the_bound_of_the_search_is_only_a_least():
    comparisons = Contradictions()
    comparisons.step(0.0, NONE, math.nan, STILL, 0.0999, 0.01, late_at_bound=True)
    assert comparisons.failing == (Status.LATENESS_CONTRADICTS,)


def test_a_lateness_found_elsewhere_at_first_is_no_change_and_the_comparisons_begin_anew():
    comparisons = Contradictions()
    assert run(comparisons, 3, rotation=(60.0, 3)) == (Status.ROTATION_CONTRADICTS,)
    comparisons.began_elsewhere()
    assert comparisons.failing == ()
    assert run(comparisons, 3, late_s=0.3, start_s=3) == ()


def test_a_lateness_found_at_first_is_no_change():
    comparisons = Contradictions()
    assert run(comparisons, 1, late_s=0.0, late_std_s=0.01) == ()
    assert run(comparisons, 5, late_s=0.07, late_std_s=0.002, start_s=1) == ()


def test_heights_that_disagree_fail_and_hold_again():
    comparisons = Contradictions()

    def fly(chi2, start_s, seconds):
        for k in range(round(30 * seconds)):
            comparisons.step(start_s + k / 30, NONE, math.nan, STILL, 0.0, 0.002, height_chi2=chi2)
        return comparisons.failing

    assert fly(2.0, 0.0, 3.0) == ()
    assert fly(40.0, 3.0, 1.0) == (Status.HEIGHT_CONTRADICTS,)
    assert fly(math.nan, 4.0, 0.5) == (Status.HEIGHT_CONTRADICTS,)
    assert fly(0.5, 4.5, 8.0) == ()


def test_a_single_echo_off_a_branch_is_no_contradiction():
    comparisons = Contradictions()
    for k in range(60):
        comparisons.step(k / 30, NONE, math.nan, STILL, 0.0, 0.002, height_chi2=40.0 if k == 40 else 0.5)
        assert comparisons.failing == ()
