"""Displacement over a known plane: exact for finite motion, with an honest covariance."""

import numpy as np
import synthetic_flow
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from landing.motion.motion import OverPlane
from landing.motion.views import derotate
from landing.rotations import exp_so3

step = st.floats(-0.3, 0.3)
slope = st.floats(-1.0, 1.0)


@examples(60)
@given(step, step, step, slope, slope)
def test_displacement_is_exact_for_finite_motion(tx: float, ty: float, tz: float, a: float, b: float):
    rng = np.random.default_rng(1)
    turn = exp_so3(np.array((0.05, -0.1, 0.2)))
    made = synthetic_flow.tracks(
        rng,
        np.array((tx, ty, tz)),
        a / 2,
        b / 2,
        measured=turn,
        rotation_std=np.zeros(3),
        points=40,
        noise_px=0,
    )
    normal = np.array((-a / 2, -b / 2, 1.0))
    over = OverPlane(made.new, derotate(made.old, turn)[None], normal, made.whitener)
    found = over.displacement(np.ones(40))
    assert found is not None
    np.testing.assert_allclose(found[0][0], (tx, ty, tz), atol=1e-9)


def test_tracks_without_weight_do_not_count():
    rng = np.random.default_rng(2)
    t = np.array((0.02, -0.05, -0.1))
    made = synthetic_flow.tracks(rng, t, 0.2, 0.1, 0.3, rotation_std=np.zeros(3), noise_px=0.0)
    over = OverPlane(made.new, made.old[None], np.array((-0.2, -0.1, 1)), made.whitener)
    found = over.displacement((~made.outlier).astype(float))
    assert found is not None
    np.testing.assert_allclose(found[0][0], t, atol=1e-9)


def test_the_covariance_is_that_of_the_errors():
    rng = np.random.default_rng(3)
    # the equations are of the first order in the noise times the motion along the axis: small here
    t, normal = np.array((0.02, -0.05, -0.02)), np.array((-0.3, 0.2, 1.0))
    normalised = []
    for _ in range(200):
        made = synthetic_flow.tracks(rng, t, 0.3, -0.2, rotation_std=np.zeros(3))
        over = OverPlane(made.new, made.old[None], normal, made.whitener)
        found = over.displacement(np.ones(len(made.new)))
        assert found is not None
        normalised.append((found[0][0] - t) / np.sqrt(np.diag(found[1][0])))
    np.testing.assert_allclose(np.std(normalised, axis=0), 1, atol=0.2)


def test_too_few_tracks_or_a_singular_pattern_tell_nothing():
    rng = np.random.default_rng(4)
    made = synthetic_flow.tracks(rng, np.array((0.1, 0, 0)), 0, 0, points=20)
    few = np.zeros(20)
    few[:5] = 1
    level = np.array((0, 0, 1.0))
    assert OverPlane(made.new, made.old[None], level, made.whitener).displacement(few) is None
    same = np.zeros((20, 2))
    assert OverPlane(same, same[None], level, made.whitener).displacement(np.ones(20)) is None


def test_tracks_that_the_older_frame_did_not_see_do_not_count():
    rng = np.random.default_rng(5)
    t, normal = np.array((0.02, -0.05, -0.1)), np.array((-0.2, -0.1, 1))
    made = synthetic_flow.tracks(rng, t, 0.2, 0.1, rotation_std=np.zeros(3), noise_px=0.0)
    seen = rng.random(len(made.new)) < 0.7
    made.old[~seen] = np.nan
    found = OverPlane(made.new, made.old[None], normal, made.whitener).displacement(
        np.ones(len(made.new)), chosen=seen
    )
    assert found is not None
    np.testing.assert_allclose(found[0][0], t, atol=1e-9)


def test_an_error_of_the_rotation_is_found_beside_the_displacement():
    """Two gaps at once, each with its own displacement; what is left of the tracks is nothing."""
    rng = np.random.default_rng(6)
    t, normal = np.array((0.02, -0.05, -0.1)), np.array((-0.2, -0.1, 1))
    turn = np.array((2e-4, -3e-4, 5e-4))
    made = synthetic_flow.tracks(rng, t, 0.2, 0.1, rotation_std=np.zeros(3), noise_px=0.0)
    both = np.stack((made.old, derotate(made.old, exp_so3(turn))))
    over = OverPlane(made.new, both, normal, made.whitener, turns=True)
    found = over.displacement(np.ones(len(made.new)), np.full(3, 1e3))
    assert found is not None
    np.testing.assert_allclose(found[0][0], (*t, 0, 0, 0), atol=1e-9)
    # of the first order: off by the turn times the flow, a tenth of the height here
    np.testing.assert_allclose(found[0][1][:3], t, atol=1e-4)
    np.testing.assert_allclose(np.abs(found[0][1][3:]), np.abs(turn), rtol=0.15)
    along, left = over.against(found[0], np.arange(len(made.new)) % 2)
    assert np.abs(left).max() < 0.02 * np.abs(along).max()
    assert np.abs(left[:, ::2]).max() < 1e-6
