"""Without a measured rotation a homography has two planes: the other one is found, and how likely it is."""

import numpy as np
import pytest
import synthetic_flow as flow
from examples import examples
from hypothesis import assume, given
from hypothesis import strategies as st

from landing.options import EstimatorOptions
from landing.plane.map_estimator import MapEstimator
from landing.plane.planefit import FitPrior, fit_plane
from landing.plane.second_plane import _decomposed, second_plane
from landing.rotations import exp_so3
from landing.vision.homography import towards

LOOSE = FitPrior(np.full(3, 0.1))
NO_TURN = np.zeros(3)
part = st.floats(-0.2, 0.2)


def made_by(t, a, b):
    return flow.tracks(
        np.random.default_rng(3), np.array(t), a, b, rotation_std=NO_TURN, points=120, noise_px=0.02
    )


@examples(60)
@given(part, part, part, st.floats(-0.7, 0.7), st.floats(-0.7, 0.7), st.lists(part, min_size=3, max_size=3))
def test_the_other_plane_makes_the_same_homography(tx, ty, tz, a, b, turn):
    """H = R + T n^T, up to its scale: what is across the normal is only turned."""
    t, normal = np.array((tx, ty, tz)), np.array((-a, -b, 1.0))
    assume(np.linalg.norm(np.cross(t, normal)) > 0.02 and float(t @ normal) < 0.9)
    homography = exp_so3(turn) @ towards(t, normal)
    other = _decomposed(homography, normal)
    if other is None:
        return
    rotation, slopes = other
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(rotation) == pytest.approx(1)
    second = np.array((-slopes[0], -slopes[1], 1.0))
    assert np.linalg.norm(np.cross(second, normal)) > 1e-3
    scaled = homography / np.linalg.svd(homography, compute_uv=False)[1]
    across = np.linalg.svd(second[None])[2][1:]
    np.testing.assert_allclose((scaled - rotation) @ across.T, 0, atol=1e-6)


def test_a_descent_over_a_slope_has_two_planes_and_one_is_level():
    """Moving along the axis over a slope looks like level ground under a camera that turns."""
    made = made_by((0.0, 0.0, -0.2), 0.5, 0.0)
    fit = fit_plane(made.new, made.old, np.eye(3), made.whitener, LOOSE, (np.array((0, 0, -0.2)), 0.5, 0.0))
    assert fit is not None
    other = second_plane(fit, np.eye(3), made.new)
    assert other is not None
    slopes, share = other
    planes = np.array((slopes, (fit.a, fit.b)))
    assert np.abs(planes - (0.5, 0.0)).sum(axis=1).min() < 0.15
    assert np.abs(planes).sum(axis=1).min() < 0.15
    assert 0.02 < share < 0.98


def test_a_flight_along_level_ground_has_one():
    """The other plane would stand along the axis: its points lie behind the camera."""
    made = made_by((0.2, 0.0, 0.0), 0.0, 0.1)
    fit = fit_plane(made.new, made.old, np.eye(3), made.whitener, LOOSE)
    assert fit is not None
    assert second_plane(fit, np.eye(3), made.new) is None


@pytest.mark.parametrize("known", [True, False])
def test_a_slope_that_may_be_level_is_uncertain_without_an_attitude(known):
    rng = np.random.default_rng(5)
    flight = flow.Flight(flow.ground(rng, 0.47, 0.0, 3.0, 5.0, 400), rng)
    estimator = MapEstimator(EstimatorOptions(), flight.camera.focal_px, 400)
    for k in range(24):
        views = flight.step(k / 30, np.array((0.0, 0.0, 1.2 * k / 30)), known=known)
        plane = estimator.step(views)
    assert plane.status == ("ok" if known else "slope_uncertain")
