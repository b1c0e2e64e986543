"""The paper's estimator: its polynomials' relations, its robust fit, its choice between the two orders."""

import math

import numpy as np
import pytest
import synthetic_flow
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from landing.motion.views import Baseline
from landing.options import EstimatorOptions
from landing.plane.quadratic import QuadraticEstimator, ransac
from landing.vision.tracking import TrackPair

FOCAL_PX = 256.0
INTERVAL_S = 1 / 30
speed = st.floats(-0.5, 0.5)
slope = st.floats(-0.8, 0.8)


def flow(
    x: np.ndarray, y: np.ndarray, omega: tuple[float, ...], a: float, b: float
) -> tuple[np.ndarray, np.ndarray]:
    """Derotated flow of a plane (the paper's Eqs. 7 and 8), from the motion of the points themselves."""
    wx, wy, wz = omega
    depth = 1 / (1 - a * x - b * y)
    # X, Y, Z of a point over h move by -omega
    return (-wx + x * wz) / depth, (-wy + y * wz) / depth


def baseline(new: np.ndarray, old: np.ndarray) -> Baseline:
    n = len(new)
    whitener = synthetic_flow.whitener(n)
    pair = TrackPair(1, np.arange(n), new, old, whitener)
    return Baseline(1, INTERVAL_S, pair, np.eye(3), True, 1e-4)


def moved(omega: tuple[float, ...], a: float, b: float, n: int = 150, noise_px: float = 0.0) -> Baseline:
    """Tracks of a small motion whose middle lies where the flow is taken."""
    rng = np.random.default_rng(1)
    place = rng.uniform(-0.45, 0.45, (n, 2))
    u, v = flow(place[:, 0], place[:, 1], omega, a, b)
    half = np.column_stack((u, v)) * INTERVAL_S / 2
    noise = rng.standard_normal((n, 2)) * noise_px / FOCAL_PX
    return baseline(place + half + noise, place - half)


def estimator(**changes: float) -> QuadraticEstimator:
    return QuadraticEstimator(EstimatorOptions(method="quadratic", **changes), FOCAL_PX, 150)


@examples(60)
@given(speed, speed, speed, slope, slope)
def test_the_flow_of_a_plane_has_the_papers_coefficients(wx: float, wy: float, wz: float, a: float, b: float):
    place = np.random.default_rng(2).uniform(-0.5, 0.5, (40, 2))
    x, y = place.T
    u, v = flow(x, y, (wx, wy, wz), a, b)
    one = np.ones_like(x)
    pu = np.linalg.lstsq(np.column_stack((one, x, y, x * x, x * y)), u, rcond=None)[0]
    pv = np.linalg.lstsq(np.column_stack((one, x, y, y * y, x * y)), v, rcond=None)[0]
    np.testing.assert_allclose(pu, (-wx, wx * a + wz, wx * b, -a * wz, -b * wz), atol=1e-9)
    np.testing.assert_allclose(pv, (-wy, wy * a, wy * b + wz, -b * wz, -a * wz), atol=1e-9)
    # divergence: the trace at the centre
    assert pu[1] + pv[2] == pytest.approx(2 * wz + a * wx + b * wy, abs=1e-9)


@examples(40)
@given(speed, speed, st.floats(-0.3, 0.3), slope, slope)
def test_sideways_the_first_order_terms_tell_the_slopes(wx: float, wy: float, wz: float, a: float, b: float):
    if math.hypot(wx, wy) < 0.06:
        return
    plane = estimator().fit(moved((wx, wy, wz), a, b))
    assert plane.status == "ok"
    assert (plane.a, plane.b) == pytest.approx((a, b), abs=1e-6)
    np.testing.assert_allclose(plane.omega, (wx, wy, wz), atol=1e-6)
    assert plane.divergence == pytest.approx(2 * wz + a * wx + b * wy, abs=1e-6)


@examples(40)
@given(st.floats(0.1, 0.6), slope, slope)
def test_along_the_axis_the_second_order_terms_do(wz: float, a: float, b: float):
    plane = estimator().fit(moved((0.0, 0.0, wz), a, b))
    assert plane.status == "ok"
    assert (plane.a, plane.b) == pytest.approx((a, b), abs=1e-6)
    assert plane.time_to_contact_s == pytest.approx(1 / wz, rel=1e-6)


def test_no_motion_tells_no_slope():
    plane = estimator().fit(moved((0.001, 0.0, 0.002), 0.3, 0.2))
    assert plane.status == "motion_too_small"
    assert math.isnan(plane.a)
    assert plane.divergence == pytest.approx(0.0043, abs=1e-6)


def test_a_receding_surface_has_no_contact():
    assert math.isnan(estimator().fit(moved((0.0, 0.0, -0.3), 0.0, 0.0)).time_to_contact_s)


def test_outliers_are_left_out():
    made = moved((0.4, 0.1, 0.1), 0.3, -0.2)
    wrong = made.tracks.new.copy()
    wrong[:45] += np.random.default_rng(3).uniform(4, 8, (45, 2)) / FOCAL_PX
    plane = estimator().fit(baseline(wrong, made.tracks.old))
    assert (plane.a, plane.b) == pytest.approx((0.3, -0.2), abs=1e-5)
    assert not plane.inlier[:45].any()
    assert plane.inlier[45:].all()
    assert plane.inlier_fraction == pytest.approx(0.7)


def test_two_runs_are_the_same_and_the_seed_decides():
    made = moved((0.4, 0.1, 0.1), 0.3, -0.2, noise_px=0.3)
    assert estimator(seed=4).fit(made).a == estimator(seed=4).fit(made).a


def test_too_few_points_or_one_place_are_no_fit():
    rng = np.random.default_rng(5)
    assert ransac(np.ones((9, 5)), np.ones(9), 0.1, 20, rng) is None
    assert ransac(np.ones((40, 5)), np.ones(40), 0.1, 20, rng) is None
    same = np.full((40, 2), 0.1)
    assert estimator().fit(baseline(same, same)).status == "no_fit"


def test_a_flight_gives_the_plane_and_too_few_tracks_none():
    rng = np.random.default_rng(6)
    flight = synthetic_flow.Flight(synthetic_flow.ground(rng, 0.2, -0.3, 2.0, 3.0), rng, 0.05)
    found = estimator()
    assert found.step(flight.step(0.0, np.zeros(3))).status == "starting"
    for k in range(1, 8):
        plane = found.step(flight.step(k / 30, np.array((0.06 * k, 0.0, 0.0))))
    assert plane.status == "ok"
    # camera x is east, y south: depth grows with a to the east, with b to the south
    assert (plane.a, plane.b) == pytest.approx((0.3, 0.2), abs=0.02)
    few = synthetic_flow.Flight(synthetic_flow.ground(rng, 0, 0, 2.0, 1.0, 15), rng)
    for k in range(4):
        plane = estimator().step(few.step(k / 30, np.array((0.06 * k, 0.0, 0.0))))
    assert plane.status in ("too_few_tracks", "starting")
