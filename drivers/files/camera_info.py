"""A camera's calibration in the YAML layout of ROS camera_info, as its calibration tools write it."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from drivers.errors import DriverError

COEFFICIENTS = {"plumb_bob": (4, 5), "rational_polynomial": (8, 12, 14)}
"""Distortion models and how many coefficients each may have, in OpenCV's order."""


@dataclass(frozen=True, slots=True)
class CameraInfo:
    """Image size in pixels, the camera matrix row by row (9 numbers), distortion in OpenCV's order."""

    width: int
    height: int
    matrix: tuple[float, ...]
    distortion: tuple[float, ...]
    distortion_model: str = "plumb_bob"
    name: str = "camera"


def read_camera_info(path: Path) -> CameraInfo:
    """The calibration in a file; DriverError naming the file and the field that is wrong."""
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DriverError(
            f"{path}: the camera's calibration cannot be read ({error.strerror}); "
            "calibrate with 'landslope calibrate', or set camera.calibration to the right file"
        ) from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        where = str(error).split("\n")[0]
        raise DriverError(f"{path}: not a YAML file ({where}); write the calibration anew") from None
    if not isinstance(content, dict):
        raise DriverError(f"{path}: no camera_info in it: a mapping with image_width, camera_matrix, ...")
    model = str(content.get("distortion_model", "plumb_bob"))
    if model not in COEFFICIENTS:
        raise DriverError(f"{path}: distortion_model '{model}' is not known: {' or '.join(COEFFICIENTS)}")
    matrix = _numbers(path, content, "camera_matrix")
    distortion = _numbers(path, content, "distortion_coefficients")
    if len(matrix) != 9 or matrix[0] <= 0 or matrix[4] <= 0 or matrix[8] != 1:
        raise DriverError(f"{path}: camera_matrix must be 3 x 3 with positive focal lengths, last number 1")
    if len(distortion) not in COEFFICIENTS[model]:
        allowed = " or ".join(map(str, COEFFICIENTS[model]))
        raise DriverError(f"{path}: {len(distortion)} distortion coefficients; {model} has {allowed}")
    return CameraInfo(
        _size(path, content, "image_width"),
        _size(path, content, "image_height"),
        matrix,
        distortion,
        model,
        str(content.get("camera_name", "camera")),
    )


def write_camera_info(path: Path, info: CameraInfo) -> None:
    """Write a calibration; DriverError if the file cannot be written."""
    m = info.matrix
    content = {
        "image_width": info.width,
        "image_height": info.height,
        "camera_name": info.name,
        "camera_matrix": {"rows": 3, "cols": 3, "data": list(m)},
        "distortion_model": info.distortion_model,
        "distortion_coefficients": {"rows": 1, "cols": len(info.distortion), "data": list(info.distortion)},
        "rectification_matrix": {"rows": 3, "cols": 3, "data": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]},
        "projection_matrix": {"rows": 3, "cols": 4, "data": [*m[0:3], 0.0, *m[3:6], 0.0, *m[6:9], 0.0]},
    }
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=1000)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise DriverError(f"{path}: cannot be written ({error.strerror}); choose another path") from None


def _numbers(path: Path, content: dict[str, Any], name: str) -> tuple[float, ...]:
    """The finite numbers of a matrix given as rows, cols, data."""
    block = content.get(name)
    data = block.get("data") if isinstance(block, dict) else None
    if not isinstance(data, list) or not all(_is_number(value) for value in data):
        raise DriverError(f"{path}: {name} must have 'data', a list of finite numbers")
    return tuple(map(float, data))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _size(path: Path, content: dict[str, Any], name: str) -> int:
    value = content.get(name)
    if not isinstance(value, int) or isinstance(value, bool) or value <= 0:
        raise DriverError(f"{path}: {name} must be a positive number of pixels, not {value!r}")
    return value
