"""Homographies: least squares with known answers, what they do to small patterns, warping through a lens."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.simulated.world.textures import texture
from landing.vision.camera import CameraModel
from landing.vision.homography import Warp, apply, least_squares, robust, stretch

SIZE = (200, 160)
PLAIN = CameraModel.from_focal(*SIZE, 180.0)
LENS = CameraModel(*SIZE, PLAIN.matrix, np.array((-0.2, 0.05, 0.001, -0.002, 0.0)))
small = st.floats(-0.05, 0.05)


def points(seed: int, n: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-0.5, 0.5, (n, 2))


@given(st.lists(small, min_size=8, max_size=8))
def test_least_squares_finds_the_homography_that_made_the_points(change: list[float]):
    h = np.eye(3) + np.append(change, 0.0).reshape(3, 3)
    p = points(1, 30)
    found = least_squares(p, apply(h, p))
    assert found is not None
    np.testing.assert_allclose(found, h, atol=1e-6)


def test_a_third_of_the_points_may_be_wrong():
    h = np.array(((1.1, 0.02, 0.05), (-0.03, 0.95, -0.02), (0.01, 0.02, 1.0)))
    p = points(2, 60)
    q = apply(h, p)
    q[::3] += np.random.default_rng(3).uniform(-0.2, 0.2, (20, 2))
    found = robust(p, q)
    assert found is not None
    np.testing.assert_allclose(found / found[2, 2], h, atol=1e-6)


def test_a_shift_stretches_nothing_and_a_growth_by_its_own_size():
    shift = np.eye(3)
    shift[:2, 2] = 0.3, -0.1
    assert stretch(shift) == pytest.approx(0.0)
    assert stretch(np.diag((1.2, 1.2, 1.0))) == pytest.approx(0.2)


@pytest.mark.parametrize(
    "h", [np.diag((1.1, 1.1, 1.0)), np.array(((1, 0.05, 0.02), (0, 1, 0), (0.05, 0, 1.0)))]
)
def test_a_warp_without_distortion_is_opencvs(h: np.ndarray):
    image = cv2.GaussianBlur(texture("noise", 1, 256), (0, 0), 2)[: SIZE[1], : SIZE[0]].astype(np.uint8)
    pixels = PLAIN.matrix @ h @ np.linalg.inv(PLAIN.matrix)
    expected = cv2.warpPerspective(
        image, pixels, SIZE, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101
    )
    np.testing.assert_allclose(Warp(PLAIN)(image, h).astype(float), expected, atol=2)


def test_a_warp_moves_what_a_lens_shows_to_where_the_points_go():
    """A spot in the old image appears where its point is projected by the homography."""
    h = np.array(((1.15, 0.02, 0.05), (-0.02, 1.12, -0.03), (0.02, 0.01, 1.0)))
    spot = np.array((130.0, 50.0))
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    image = (250 * np.exp(-((x - spot[0]) ** 2 + (y - spot[1]) ** 2) / 18)).astype(np.uint8)
    warped = Warp(LENS)(image, h).astype(float)
    found = (warped * x).sum() / warped.sum(), (warped * y).sum() / warped.sum()
    there = LENS.project(apply(h, LENS.undistort(spot[None])))[0]
    np.testing.assert_allclose(found, there, atol=0.1)
