"""The fields of a calibration under the names of camera_info, whichever tool named them."""

import math
import re
from pathlib import Path
from typing import Any

from drivers.errors import DriverError

NAMES = {
    "image_width": ("image_Width", "imageWidth", "width"),
    "image_height": ("image_Height", "imageHeight", "height"),
    "camera_matrix": ("Camera_Matrix", "cameraMatrix", "camera_Matrix", "k", "K"),
    "distortion_coefficients": ("Distortion_Coefficients", "distCoeffs", "dist_coeffs", "d", "D"),
    "camera_name": (),
    "distortion_model": (),
    "intrinsics_covariance": (),
}
"""camera_info's names, and those of OpenCV's programs and of ROS messages (1: K and D, 2: k and d)."""

_CAMERA = re.compile(r"cam\d+")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


def fields_of(path: Path, content: dict[str, Any]) -> dict[str, Any]:
    """The fields by camera_info's names; DriverError, with the way to convert, for a layout that has none of them."""
    cameras = [name for name in content if _CAMERA.fullmatch(str(name))]
    if cameras:
        return _kalibr(path, content, cameras)
    found = {}
    for name, others in NAMES.items():
        held = next((other for other in (name, *others) if other in content), None)
        if held is not None:
            found[name] = content[held]
    if str(content.get("fisheye_model", "0")) not in ("0", "False"):
        found["distortion_model"] = "equidistant"
    if "camera_matrix" not in found:
        raise DriverError(
            f"{path}: no camera_info of ROS, OpenCV or Kalibr: it has {_some(content)}, and neither camera_matrix nor "
            "k; write image_width, image_height, camera_matrix, distortion_model and distortion_coefficients into it"
        )
    _check_whole(path, content)
    return found


def matrix_of(path: Path, content: dict[str, Any]) -> tuple[float, ...]:
    """The numbers of the camera matrix."""
    if content.get("camera_matrix") is None:
        raise DriverError(f"{path}: camera_matrix must have 'data', a list of finite numbers")
    return numbers_of(path, content, "camera_matrix")


def numbers_of(path: Path, content: dict[str, Any], name: str) -> tuple[float, ...]:
    """The finite numbers of a matrix given as rows, cols, data or as a list; none where there is no such field."""
    block = content.get(name)
    if block is None:
        return ()
    data = block.get("data") if isinstance(block, dict) else block
    if isinstance(data, list) and data and all(isinstance(row, list) for row in data):
        data = [value for row in data for value in row]
    # a list without commas is one text
    words = [word for value in data for word in _words(value)] if isinstance(data, list) else None
    if words is None or not all(_is_number(word) for word in words):
        raise DriverError(f"{path}: {name} must have 'data', a list of finite numbers")
    return tuple(map(float, words))


def size_of(path: Path, content: dict[str, Any], name: str) -> int:
    """A side of the image in pixels."""
    value = content.get(name)
    if not isinstance(value, int) or isinstance(value, bool) or value <= 0:
        raise DriverError(f"{path}: {name} must be a positive number of pixels, not {value!r}")
    return value


def _kalibr(path: Path, content: dict[str, Any], cameras: list[str]) -> dict[str, Any]:
    """Kalibr's camchain: one camera, pinhole, its parameters as lists."""
    if len(cameras) > 1:
        raise DriverError(
            f"{path}: a Kalibr file of {len(cameras)} cameras ({', '.join(cameras)}): leave the one that looks down "
            "in it"
        )
    camera = content[cameras[0]]
    if not isinstance(camera, dict) or camera.get("camera_model") != "pinhole":
        model = camera.get("camera_model") if isinstance(camera, dict) else None
        raise DriverError(
            f"{path}: a Kalibr file with camera_model '{model}': calibrate anew with Kalibr's pinhole-radtan, or "
            "pinhole-equi for a wide lens"
        )
    intrinsics, size = camera.get("intrinsics"), camera.get("resolution")
    if not isinstance(intrinsics, list) or len(intrinsics) != 4:
        raise DriverError(f"{path}: a Kalibr file whose intrinsics are not the four fx, fy, cx, cy")
    if not isinstance(size, list) or len(size) != 2:
        raise DriverError(f"{path}: a Kalibr file whose resolution is not a width and a height")
    fx, fy, cx, cy = intrinsics
    return {
        "image_width": size[0],
        "image_height": size[1],
        "camera_name": cameras[0],
        "camera_matrix": {"data": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]},
        "distortion_model": camera.get("distortion_model", "none"),
        "distortion_coefficients": {"data": camera.get("distortion_coeffs", [])},
    }


def _check_whole(path: Path, content: dict[str, Any]) -> None:
    """A ROS message of a camera that gives a part of its picture, or every second pixel, has another matrix."""
    binning = [content.get(name, 0) for name in ("binning_x", "binning_y")]
    if any(value not in (0, 1) for value in binning):
        raise DriverError(
            f"{path}: a ROS camera_info with binning {binning[0]} x {binning[1]}: its matrix is that of the full "
            "picture; calibrate at the size that is flown"
        )


def _words(value: Any) -> list[Any]:
    return list(value.replace(",", " ").split()) if isinstance(value, str) else [value]


def _is_number(value: Any) -> bool:
    if isinstance(value, str):  # 1e-05 is text by YAML 1.1
        return _NUMBER.fullmatch(value) is not None and math.isfinite(float(value))
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def _some(content: dict[str, Any]) -> str:
    names = [str(name)[:30] for name in list(content)[:5]]
    return ", ".join(names) or "nothing"
