"""Displacement over a known plane: exact for finite motion, with an honest covariance."""

import numpy as np
import synthetic_flow
from hypothesis import given, settings
from hypothesis import strategies as st

from landing.motion import displacement
from landing.rotations import exp_so3
from landing.views import derotate

step = st.floats(-0.3, 0.3)
slope = st.floats(-1.0, 1.0)


@settings(max_examples=60, deadline=None)
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
    found = displacement(made.new, derotate(made.old, turn)[None], normal, made.whitener, np.ones(40))
    assert found is not None
    np.testing.assert_allclose(found[0][0], (tx, ty, tz), atol=1e-9)


def test_tracks_without_weight_do_not_count():
    rng = np.random.default_rng(2)
    t = np.array((0.02, -0.05, -0.1))
    made = synthetic_flow.tracks(rng, t, 0.2, 0.1, 0.3, rotation_std=np.zeros(3), noise_px=0.0)
    found = displacement(
        made.new, made.old[None], np.array((-0.2, -0.1, 1)), made.whitener, (~made.outlier).astype(float)
    )
    assert found is not None
    np.testing.assert_allclose(found[0][0], t, atol=1e-9)


def test_the_covariance_is_that_of_the_errors():
    rng = np.random.default_rng(3)
    # the equations are of the first order in the noise times the motion along the axis: small here
    t, normal = np.array((0.02, -0.05, -0.02)), np.array((-0.3, 0.2, 1.0))
    normalised = []
    for _ in range(200):
        made = synthetic_flow.tracks(rng, t, 0.3, -0.2, rotation_std=np.zeros(3))
        found = displacement(made.new, made.old[None], normal, made.whitener, np.ones(len(made.new)))
        assert found is not None
        normalised.append((found[0][0] - t) / np.sqrt(np.diag(found[1][0])))
    np.testing.assert_allclose(np.std(normalised, axis=0), 1, atol=0.2)


def test_too_few_tracks_or_a_singular_pattern_tell_nothing():
    rng = np.random.default_rng(4)
    made = synthetic_flow.tracks(rng, np.array((0.1, 0, 0)), 0, 0, points=20)
    few = np.zeros(20)
    few[:5] = 1
    assert displacement(made.new, made.old[None], np.array((0, 0, 1.0)), made.whitener, few) is None
    same = np.zeros((20, 2))
    assert displacement(same, same[None], np.array((0, 0, 1.0)), made.whitener, np.ones(20)) is None
