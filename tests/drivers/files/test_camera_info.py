"""camera_info files: read as ROS and the calibration write them, refused with the field's name."""

import math
from dataclasses import replace

import numpy as np
import pytest
import yaml
from flight_copy import FLIGHTS

from drivers.errors import DriverError
from drivers.files.camera_info import CameraInfo, read_camera_info, write_camera_info

GOOD = {
    "image_width": 320,
    "image_height": 240,
    "camera_name": "bottom",
    "camera_matrix": {"rows": 3, "cols": 3, "data": [256, 0, 160, 0, 256.5, 120, 0, 0, 1]},
    "distortion_model": "plumb_bob",
    "distortion_coefficients": {"rows": 1, "cols": 5, "data": [-0.1, 0.03, 0, 0, 0]},
}


def test_the_recorded_flights_calibrations_are_read():
    info = read_camera_info(FLIGHTS / "stairs_a" / "camera.yaml")
    assert (info.width, info.height, info.name) == (320, 240, "bottom")
    assert info.matrix[0] == 256.053525
    assert info.distortion == (-0.12, 0.03, 0.0006, -0.0004, 0.0)


@pytest.mark.parametrize("coefficients", [4, 5, 8, 12, 14])
def test_what_was_written_is_read_again(tmp_path, coefficients):
    model = "plumb_bob" if coefficients < 8 else "rational_polynomial"
    distortion = tuple(0.01 * k for k in range(coefficients))
    info = CameraInfo(640, 480, (500.25, 0, 320, 0, 501, 240, 0, 0, 1), distortion, model, "front")
    write_camera_info(tmp_path / "c.yaml", info)
    assert read_camera_info(tmp_path / "c.yaml") == info
    content = yaml.safe_load((tmp_path / "c.yaml").read_text())
    assert content["projection_matrix"]["data"] == [500.25, 0, 320, 0, 0, 501, 240, 0, 0, 0, 1, 0]


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("image_width", None, "image_width"),
        ("image_width", -3, "image_width"),
        ("image_height", "240", "image_height"),
        ("camera_matrix", None, "camera_matrix"),
        ("camera_matrix", {"data": [1, 2, 3]}, "camera_matrix must be 3 x 3"),
        ("camera_matrix", {"data": [0, 0, 1, 0, 1, 1, 0, 0, 1]}, "positive focal lengths"),
        ("camera_matrix", {"data": [float("nan"), 0, 1, 0, 1, 1, 0, 0, 1]}, "finite"),
        ("distortion_coefficients", {"data": ["a"]}, "distortion_coefficients"),
        ("distortion_coefficients", {"data": [0, 0, 0]}, "3 distortion coefficients"),
        ("distortion_coefficients", {"data": [0, 0, "1e5x", 0]}, "finite"),
        ("distortion_coefficients", None, "distortion_coefficients is missing"),
        ("distortion_model", "equidistant", "5 distortion coefficients; equidistant has 4"),
        ("distortion_model", "double_sphere", "double_sphere"),
        ("distortion_model", 7, "'7' is not known"),
    ],
)
def test_wrong_fields_are_named(tmp_path, field, value, words):
    path = tmp_path / "c.yaml"
    path.write_text(yaml.safe_dump({**GOOD, field: value}))
    with pytest.raises(DriverError, match=rf"c\.yaml.*{words}"):
        read_camera_info(path)


@pytest.mark.parametrize("text", ["a: [1, 2", "- 1\n- 2\n", "", "\x00\x01"])
def test_what_is_no_mapping_is_named(tmp_path, text):
    path = tmp_path / "c.yaml"
    path.write_text(text)
    with pytest.raises(DriverError, match=r"c\.yaml"):
        read_camera_info(path)


def test_missing_files_are_named(tmp_path):
    with pytest.raises(DriverError, match=r"no\.yaml.*calibrate"):
        read_camera_info(tmp_path / "no.yaml")
    with pytest.raises(DriverError, match="cannot be written"):
        write_camera_info(tmp_path / "no" / "c.yaml", CameraInfo(1, 1, (1,) * 9, (0,) * 5))


def test_the_intrinsics_covariance_is_kept_and_a_wrong_one_refused(tmp_path):
    covariance = tuple(float(x) for x in np.diag(np.arange(1.0, 10.0)).ravel())
    info = CameraInfo(
        320, 240, (256.0, 0, 160, 0, 256, 120, 0, 0, 1), (-0.1, 0.0, 0.0, 0.0, 0.0), covariance=covariance
    )
    path = tmp_path / "camera.yaml"
    write_camera_info(path, info)
    assert read_camera_info(path).covariance == covariance
    for wrong in (covariance[:-1], (-1.0, *covariance[1:]), (math.nan, *covariance[1:])):
        write_camera_info(path, replace(info, covariance=wrong))
        with pytest.raises(DriverError, match="intrinsics_covariance"):
            read_camera_info(path)
