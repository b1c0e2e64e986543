"""The camera model: pixels to normalised coordinates and back, the mount, what is refused."""

import math

import cv2
import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from companion.core.camera_model import camera_model, implausible, model_of
from companion.errors import LandslopeError
from companion.settings.settings import CameraSettings
from drivers.files.camera_info import CameraInfo, write_camera_info
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


@examples(30)
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


def pinhole(f: float, cx: float = 159.5, cy: float = 119.5, fy: float | None = None) -> np.ndarray:
    return np.array(((f, 0, cx), (0, fy or f, cy), (0, 0, 1)))


@pytest.mark.parametrize(
    ("matrix", "distortion", "words"),
    [
        (pinhole(1.0), None, "90 degrees off the axis"),
        (pinhole(3.04), None, "off the axis"),
        (pinhole(21.0), None, "84 degrees off the axis"),
        (pinhole(20_000.0), None, "0.92 degrees"),
        (pinhole(256, cx=-3), None, "principal point -3, 119.5 lies outside of a picture of 320 x 240"),
        (pinhole(256, cy=240), None, "lies outside"),
        (pinhole(256, fy=512), None, "differ by more than 1.5 times"),
        (pinhole(256), np.array((-0.9, 0, 0, 0, 0)), "has no inverse"),
    ],
)
def test_values_that_no_camera_has_are_named(matrix: np.ndarray, distortion: np.ndarray | None, words: str):
    assert words in implausible(CameraModel(320, 240, matrix, distortion))


def test_cameras_are_plausible(camera: CameraModel):
    assert implausible(camera) == ""
    assert implausible(CameraModel.from_focal(320, 240, 90)) == ""
    assert implausible(CameraModel(320, 240, MATRIX, np.zeros(4), equidistant=True)) == ""


def test_an_equidistant_lens_that_looks_beyond_the_limit_is_named():
    assert "80 at most" in implausible(CameraModel(320, 240, pinhole(120), np.zeros(4), equidistant=True))


def test_a_calibration_that_no_camera_has_is_refused_by_its_file(tmp_path):
    path = tmp_path / "camera.yaml"
    write_camera_info(path, CameraInfo(320, 240, tuple(pinhole(21.0).ravel().tolist()), (0.0,) * 5))
    with pytest.raises(LandslopeError, match=r"camera\.yaml.*check the numbers"):
        camera_model(CameraSettings(calibration=str(path)), 320, 240)
    with pytest.raises(LandslopeError, match="check the numbers"):
        camera_model(CameraSettings(), 320, 240, focal_px=1.0)


def test_an_equidistant_calibration_makes_an_equidistant_camera(tmp_path):
    path = tmp_path / "camera.yaml"
    info = CameraInfo(320, 240, tuple(pinhole(152.0).ravel().tolist()), (0.01, 0.0, 0.0, 0.0), "equidistant")
    write_camera_info(path, info)
    model, calibrated = camera_model(CameraSettings(calibration=str(path)), 320, 240)
    assert calibrated
    assert model.equidistant
    assert model_of(info, path).undistort(np.array(((300.0, 20.0),))) == pytest.approx(
        model.undistort(np.array(((300.0, 20.0),)))
    )
