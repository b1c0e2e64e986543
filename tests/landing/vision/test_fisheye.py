"""The equidistant lens: as cv2.fisheye has it, back and forth, bounded beyond its reach, its matches' information."""

import cv2
import numpy as np
import pytest
from examples import examples
from hypothesis import example, given
from hypothesis import strategies as st

from landing.errors import LandingError
from landing.vision.camera import CameraModel
from landing.vision.homography import Warp

MATRIX = np.array(((152.0, 0, 161.3), (0, 151.5, 118.8), (0, 0, 1)))
LENSES = [(0.0, 0.0, 0.0, 0.0), (-0.0017, 0.024, -0.036, 0.020), (0.05, -0.01, 0.002, -0.0005)]


@pytest.fixture(params=LENSES, ids=str)
def camera(request: pytest.FixtureRequest) -> CameraModel:
    return CameraModel(320, 240, MATRIX, np.array(request.param), equidistant=True)


def grid() -> np.ndarray:
    u, v = np.meshgrid(np.linspace(0, 319, 21), np.linspace(0, 239, 17))
    return np.column_stack((u.ravel(), v.ravel()))


def test_every_pixel_comes_back(camera: CameraModel):
    rays = camera.undistort(grid())
    assert np.degrees(np.arctan(np.hypot(*rays.T))).max() > 60
    np.testing.assert_allclose(camera.project(rays), grid(), atol=1e-4)


@pytest.mark.parametrize("count", [1, 5, 400])
def test_projection_is_that_of_opencv(camera: CameraModel, count: int):
    points = np.random.default_rng(1).uniform(-3, 3, (count, 2))
    space = np.column_stack((points, np.ones(count)))[:, None]
    theirs, _ = cv2.fisheye.projectPoints(space, np.zeros(3), np.zeros(3), MATRIX, camera.distortion)
    np.testing.assert_allclose(camera.project(points), theirs.reshape(-1, 2), atol=1e-9)


@example(3.0, 4.0, 3 / 64, 1 / 64)  # the distorted angle exceeds 90 degrees
@examples(40)
@given(st.floats(-4, 4), st.floats(-4, 4), st.floats(-0.05, 0.05), st.floats(-0.02, 0.02))
def test_normalised_points_come_back(x: float, y: float, k1: float, k2: float):
    camera = CameraModel(320, 240, MATRIX, np.array((k1, k2, 0.0, 0.0)), equidistant=True)
    np.testing.assert_allclose(camera.undistort(camera.project(np.array(((x, y),)))), ((x, y),), atol=1e-5)


def test_the_axis_and_no_points_are_no_special_case(camera: CameraModel):
    centre = MATRIX[:2, 2]
    np.testing.assert_allclose(camera.project(np.zeros((1, 2))), (centre,))
    np.testing.assert_allclose(camera.undistort(centre[None]), ((0.0, 0.0),), atol=1e-12)
    assert camera.undistort(np.empty((0, 2))).shape == (0, 2)
    assert camera.project(np.empty((0, 2))).shape == (0, 2)


def test_pixels_beyond_the_lens_stay_finite_and_in_their_direction(camera: CameraModel):
    far = MATRIX[:2, 2] + 400 * np.array(((1.0, 0), (0, -1), (-0.6, 0.8)))
    rays = camera.undistort(far)
    away = (far - MATRIX[:2, 2]) / np.diag(MATRIX)[:2]
    away /= np.hypot(*away.T)[:, None]
    np.testing.assert_allclose(rays / np.hypot(*rays.T)[:, None], away, atol=1e-9)
    assert np.degrees(np.arctan(np.hypot(*rays.T))).max() <= 85.0001


def test_distortion_that_turns_back_ends_the_reach():
    camera = CameraModel(320, 240, MATRIX, np.array((-1.0, 0, 0, 0)), equidistant=True)
    assert camera.fisheye is not None
    assert camera.fisheye.largest_angle == pytest.approx(np.sqrt(1 / 3), abs=1e-2)
    assert np.isfinite(camera.undistort(grid())).all()


def test_the_information_of_matches_is_that_of_the_jacobian(camera: CameraModel):
    pixels = np.array(((160.0, 120), (20, 15), (300, 120), (161.3, 118.8)))
    whitener_px = np.array(((2.0, 1, 4, 3), (0.5, 0, -1, 0.2), (1.0, 3, 2, 3)))
    c = camera.whitener(whitener_px, pixels)
    rays, step = camera.undistort(pixels), 1e-6
    for k, ray in enumerate(rays):
        moved = ray + step * np.array(((1, 0), (-1, 0), (0, 1), (0, -1)))
        at = camera.project(moved)
        jacobian = np.column_stack(((at[0] - at[1]), (at[2] - at[3]))) / (2 * step)
        c_px = np.array(((whitener_px[0, k], whitener_px[1, k]), (0, whitener_px[2, k])))
        c_ray = np.array(((c[0, k], c[1, k]), (0, c[2, k])))
        expected = jacobian.T @ c_px.T @ c_px @ jacobian
        np.testing.assert_allclose(c_ray.T @ c_ray, expected, rtol=2e-2)


def test_a_warp_by_a_turn_shows_what_the_turned_camera_sees(camera: CameraModel):
    """A smooth picture of directions, seen by the camera before and after a turn of 5 degrees."""
    turn = cv2.Rodrigues(np.radians((3.0, -4.0, 2.0)))[0]
    u, v = np.meshgrid(np.arange(320.0), np.arange(240.0))
    rays = camera.undistort(np.column_stack((u.ravel(), v.ravel())))
    space = np.column_stack((rays, np.ones(len(rays))))
    space /= np.linalg.norm(space, axis=1)[:, None]

    def seen(directions: np.ndarray) -> np.ndarray:
        grey = 128 + 60 * np.sin(7 * directions[:, 0]) + 60 * np.cos(6 * directions[:, 1])
        return np.rint(grey).astype(np.uint8).reshape(240, 320)

    old, new = seen(space), seen(space @ turn)
    warped = Warp(camera)(old, turn)
    middle = (slice(50, -50), slice(50, -50))
    assert np.abs(warped[middle].astype(int) - new[middle]).max() <= 3


@pytest.mark.parametrize(
    ("matrix", "distortion"),
    [(MATRIX, np.zeros(5)), (MATRIX + np.array(((0, 1.0, 0), (0, 0, 0), (0, 0, 0))), np.zeros(4))],
)
def test_what_is_no_equidistant_lens_is_refused(matrix: np.ndarray, distortion: np.ndarray):
    with pytest.raises(LandingError, match="equidistant"):
        CameraModel(320, 240, matrix, distortion, equidistant=True)
