"""The camera model: pixels to normalised coordinates and back, the mount, what is refused."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from landing.errors import LandingError
from landing.vision.camera import DOWN, CameraModel, body_from_camera

MATRIX = np.array(((256.0, 0, 161.3), (0, 254.5, 118.8), (0, 0, 1)))
LENSES = {
    "none": None,
    "plumb_bob of four": np.array((-0.11, 0.03, 0.0008, -0.0006)),
    "plumb_bob": np.array((-0.21, 0.07, 0.0004, -0.0007, -0.01)),
    "rational": np.array((0.35, 0.02, 0.0003, -0.0002, 0.004, 0.5, 0.05, 0.006)),
    "thin prism": np.array((-0.1, 0.03, 0.0004, -0.0007, -0.01, 0.02, 0.01, 0.0, 4e-4, -3e-4, 2e-4, 1e-4)),
    "tilted": np.array((-0.1, 0.03, 0.0004, -0.0007, 0, 0, 0, 0, 0, 0, 0, 0, 0.02, -0.03)),
}


@pytest.fixture(params=LENSES)
def camera(request: pytest.FixtureRequest) -> CameraModel:
    return CameraModel(320, 240, MATRIX, LENSES[request.param])


def grid(camera: CameraModel) -> np.ndarray:
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, 21), np.linspace(0, camera.height - 1, 17))
    return np.column_stack((u.ravel(), v.ravel()))


def test_every_pixel_comes_back(camera: CameraModel):
    pixels = grid(camera)
    np.testing.assert_allclose(camera.project(camera.undistort(pixels)), pixels, atol=2e-4)


def test_projection_is_that_of_opencv(camera: CameraModel):
    points = np.random.default_rng(1).uniform(-0.6, 0.6, (200, 2))
    space = np.column_stack((points, np.ones(200)))
    theirs, _ = cv2.projectPoints(space, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)
    np.testing.assert_allclose(camera.project(points), theirs.reshape(-1, 2), atol=1e-6)


@settings(max_examples=30, deadline=None)
@given(st.floats(-0.6, 0.6), st.floats(-0.45, 0.45), st.floats(-0.3, 0.2), st.floats(0, 0.1))
def test_normalised_points_come_back(x: float, y: float, k1: float, k2: float):
    camera = CameraModel(320, 240, MATRIX, np.array((k1, k2, 0.0, 0.0, 0.0)))
    np.testing.assert_allclose(camera.undistort(camera.project(np.array(((x, y),)))), ((x, y),), atol=1e-6)


def test_without_distortion_the_pinhole_is_exact():
    camera = CameraModel.from_focal(320, 240, 256.0)
    np.testing.assert_allclose(
        camera.project(np.array(((0.0, 0.0), (0.5, -0.25)))), ((159.5, 119.5), (287.5, 55.5))
    )
    assert camera.focal_px == pytest.approx(256)


def test_no_points_are_no_error(camera: CameraModel):
    assert camera.undistort(np.empty((0, 2))).shape == (0, 2)
    assert camera.project(np.empty((0, 2))).shape == (0, 2)


def test_the_top_of_the_image_is_towards_the_nose():
    np.testing.assert_array_equal(DOWN @ (0, -1, 0), (1, 0, 0))
    np.testing.assert_array_equal(DOWN @ (1, 0, 0), (0, 1, 0))
    np.testing.assert_array_equal(DOWN @ (0, 0, 1), (0, 0, 1))
    np.testing.assert_allclose(body_from_camera(0, 0, 0), DOWN)


@pytest.mark.parametrize(
    ("angles_deg", "axis_in_body", "top_in_body"),
    [
        # mounted nose-up by 20 degrees: the axis leans towards the nose
        ((0, 20, 0), (math.sin(math.radians(20)), 0, math.cos(math.radians(20))), None),
        # rolled to the right by 20 degrees: the axis leans to the left
        ((20, 0, 0), (0, -math.sin(math.radians(20)), math.cos(math.radians(20))), (1, 0, 0)),
        # yawed by 90 degrees: the image's top is to the right
        ((0, 0, 90), (0, 0, 1), (0, 1, 0)),
    ],
)
def test_mount_angles_turn_the_camera_in_the_body(angles_deg, axis_in_body, top_in_body):
    mount = body_from_camera(*np.radians(angles_deg))
    np.testing.assert_allclose(mount @ (0, 0, 1), axis_in_body, atol=1e-12)
    if top_in_body is not None:
        np.testing.assert_allclose(mount @ (0, -1, 0), top_in_body, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"width": 8}, "too small"),
        ({"matrix": np.diag((0.0, 256.0, 1.0))}, "must be positive"),
        ({"matrix": np.array(((256.0, 0, math.nan), (0, 256, 1), (0, 0, 1)))}, "must be positive"),
        ({"distortion": np.zeros(3)}, "3 distortion coefficients"),
        ({"distortion": np.full(5, math.inf)}, "distortion coefficients"),
    ],
)
def test_what_is_no_camera_is_refused(change: dict, words: str):
    given_ = {"width": 320, "height": 240, "matrix": MATRIX, "distortion": np.zeros(5)} | change
    with pytest.raises(LandingError, match=words):
        CameraModel(**given_)
