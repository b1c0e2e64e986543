"""Calibrations as ROS, OpenCV and Kalibr write them are read; what is none of them is refused in one line."""

from pathlib import Path

import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import DriverError
from drivers.files.camera_info import read_camera_info

K = (256.0, 0.0, 159.5, 0.0, 256.0, 119.5, 0.0, 0.0, 1.0)
ROS = """image_width: 320
image_height: 240
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [256.0, 0.0, 159.5, 0.0, 256.0, 119.5, 0.0, 0.0, 1.0]
distortion_model: MODEL
distortion_coefficients:
  rows: 1
  cols: 5
  data: [DATA]
"""
ECHO = """header:
  stamp:
    sec: 1734051505
    nanosec: 363371767
  frame_id: cam
height: 240
width: 320
distortion_model: plumb_bob
d:
- 0.1
- -0.2
- 0.0
- 1.0e-05
- 0.0
k:
- 256.0
- 0.0
- 159.5
- 0.0
- 256.0
- 119.5
- 0.0
- 0.0
- 1.0
r: [1.0,0.0,0.0,0.0,1.0,0.0,0.0,0.0,1.0]
binning_x: 0
binning_y: 0
---
"""
OPENCV = """%YAML:1.0
---
calibration_time: "Thu 26 Nov 2026 10:00:00"
image_width: 320
image_height: 240
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 256., 0., 159.5, 0., 256., 119.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ 1.0000000000000001e-01, -2.0000000000000001e-01, 0., 1e-05, 0. ]
"""
KALIBR = """cam0:
  cam_overlaps: []
  camera_model: pinhole
  distortion_coeffs: [-0.01, 0.02, -0.001, 0.0005]
  distortion_model: MODEL
  intrinsics: [256.0, 256.0, 159.5, 119.5]
  resolution: [320, 240]
  rostopic: /cam0/image_raw
"""


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def ros(model: str, data: str) -> str:
    return ROS.replace("MODEL", model).replace("DATA", data)


@pytest.mark.parametrize(
    ("text", "model", "distortion"),
    [
        (ros("plumb_bob", "0.1, -0.2, 1e-05, -1e-05, 0.0"), "plumb_bob", (0.1, -0.2, 1e-5, -1e-5, 0.0)),
        (ros("plumb_bob", "0.1 -0.2 0.001 -0.001"), "plumb_bob", (0.1, -0.2, 0.001, -0.001)),
        (ros("plumb_bob", ""), "plumb_bob", (0.0,) * 5),
        (ros("equidistant", ""), "equidistant", (0.0,) * 4),
        (ros("rational_polynomial", "0.1, -0.2, 0, 0, 0.1"), "rational_polynomial", (0.1, -0.2, 0, 0, 0.1)),
        (ros("equidistant", "-0.0017, 0.024, -0.036, 0.02"), "equidistant", (-0.0017, 0.024, -0.036, 0.02)),
        (ros("fisheye", "0.1, 0, 0, 0"), "equidistant", (0.1, 0, 0, 0)),
        (ECHO, "plumb_bob", (0.1, -0.2, 0.0, 1e-5, 0.0)),
        (ECHO.replace("d:", "D:").replace("k:", "K:"), "plumb_bob", (0.1, -0.2, 0.0, 1e-5, 0.0)),
        (OPENCV, "plumb_bob", (0.1, -0.2, 0.0, 1e-5, 0.0)),
        (
            OPENCV.replace("1e-05, 0.", "0., 0., 0.1, 0.1, 0.1"),
            "rational_polynomial",
            (0.1, -0.2, 0.0, 0.0, 0.0, 0.1, 0.1, 0.1),
        ),
        (
            "\n".join(OPENCV.splitlines()[:-1]) + "\n   data: [ 0.1, 0., 0., 0. ]\nfisheye_model: 1\n",
            "equidistant",
            (0.1, 0, 0, 0),
        ),
        (KALIBR.replace("MODEL", "radtan"), "plumb_bob", (-0.01, 0.02, -0.001, 0.0005)),
        (KALIBR.replace("MODEL", "equidistant"), "equidistant", (-0.01, 0.02, -0.001, 0.0005)),
    ],
)
def test_files_of_other_tools_are_read(tmp_path: Path, text: str, model: str, distortion: tuple):
    info = read_camera_info(written(tmp_path / "c.yaml", text))
    assert (info.width, info.height, info.matrix) == (320, 240, K)
    assert info.distortion_model == model
    assert info.distortion == pytest.approx(distortion)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            KALIBR.replace("pinhole", "ds").replace("MODEL", "none"),
            "Kalibr file with camera_model 'ds'.*pinhole-equi",
        ),
        (KALIBR + KALIBR.replace("cam0", "cam1"), "Kalibr file of 2 cameras"),
        (KALIBR.replace("[320, 240]", "320"), "Kalibr.*resolution"),
        (KALIBR.replace("256.0, 256.0, ", ""), "Kalibr.*intrinsics"),
        (ECHO.replace("binning_x: 0", "binning_x: 2"), "binning 2 x 0"),
        ("colour: red\n", "it has colour, and neither camera_matrix nor k"),
        (
            OPENCV.replace("1e-05, 0. ]", "1e-05 ]"),
            "four distortion coefficients of a lens that is not named",
        ),
        ("a: &a [1, 1]\nb: *a\n", "aliases"),
        ("a: " + "[" * 5000 + "]" * 5000, "nested deeper"),
        ("x" * 1_000_001, "larger than 1 MB"),
        (ros("plumb_bob", "9" * 5000), "c.yaml"),
        ("image_width: !!python/object:os.system {}\n", "c.yaml"),
        ("at: 2026-99-99\n", "neither camera_matrix"),
    ],
)
def test_what_cannot_be_read_is_refused_with_what_to_do(tmp_path: Path, text: str, words: str):
    with pytest.raises(DriverError, match=words) as refused:
        read_camera_info(written(tmp_path / "c.yaml", text))
    assert "\n" not in str(refused.value)


@examples(150)
@given(st.data())
def test_damage_is_one_line_or_a_calibration(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject):
    text = bytearray(
        data.draw(st.sampled_from((ros("plumb_bob", "0.1 0 0 0"), ECHO, OPENCV, KALIBR))).encode()
    )
    for place in data.draw(st.lists(st.integers(0, len(text) - 1), max_size=6)):
        text[place] = data.draw(st.integers(0, 255))
    path = tmp_path_factory.mktemp("fuzz") / "c.yaml"
    path.write_bytes(bytes(text))
    try:
        text_of = str(read_camera_info(path))
    except DriverError as refused:
        text_of = str(refused)
    assert "\n" not in text_of
