"""A camera's calibration: the YAML layout of ROS camera_info, written; that and what other tools write, read."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from drivers.errors import DriverError
from drivers.files.calibration_yaml import parse
from drivers.files.foreign_calibration import fields_of, matrix_of, numbers_of, size_of

EQUIDISTANT = "equidistant"
COEFFICIENTS = {
    "plumb_bob": (4, 5),
    "rational_polynomial": (4, 5, 8, 12, 14),
    EQUIDISTANT: (4,),
}
"""Distortion models and how many coefficients each may have, in OpenCV's order."""

MODELS = {
    "": "plumb_bob",
    "none": "plumb_bob",
    "radtan": "plumb_bob",
    "radial-tangential": "plumb_bob",
    "fisheye": EQUIDISTANT,
    "kannala_brandt": EQUIDISTANT,
    "equi": EQUIDISTANT,
} | {name: name for name in COEFFICIENTS}
"""Names of distortion models, of ROS and of other tools."""

_COVARIANCE = "intrinsics_covariance"
"""Of fx, fy, cx, cy and the distortion: landslope's own field, which other readers of the layout pass over."""

_UNDISTORTED = {"plumb_bob": (0.0,) * 5, "rational_polynomial": (0.0,) * 8, EQUIDISTANT: (0.0,) * 4}


@dataclass(frozen=True, slots=True)
class CameraInfo:
    """Image size in pixels, the camera matrix row by row (9 numbers), distortion in OpenCV's order.

    ``covariance`` row by row, of the errors of fx, fy, cx, cy and the distortion; empty: not known.
    """

    width: int
    height: int
    matrix: tuple[float, ...]
    distortion: tuple[float, ...]
    distortion_model: str = "plumb_bob"
    name: str = "camera"
    covariance: tuple[float, ...] = ()


def read_camera_info(path: Path) -> CameraInfo:
    """The calibration in a file; DriverError naming the file and the field that is wrong.

    Files of ROS (camera_calibration, topic echo), OpenCV's FileStorage and Kalibr are read.
    """
    content = fields_of(path, parse(path))
    given = str(content.get("distortion_model") or "").strip().lower()
    if given not in MODELS:
        raise DriverError(
            f"{path}: distortion_model '{given}' is not known, but {', '.join(COEFFICIENTS)}; calibrate with one "
            "of these, or with 'landslope calibrate'"
        )
    model = MODELS[given]
    matrix = matrix_of(path, content)
    if content.get("distortion_coefficients") is None:
        raise DriverError(f"{path}: distortion_coefficients is missing; 'data: []' says that there is none")
    distortion = numbers_of(path, content, "distortion_coefficients") or _UNDISTORTED[model]
    if len(matrix) != 9 or matrix[0] <= 0 or matrix[4] <= 0 or matrix[8] != 1:
        raise DriverError(f"{path}: camera_matrix must be 3 x 3 with positive focal lengths, last number 1")
    if not given and len(distortion) == 4:
        raise DriverError(
            f"{path}: four distortion coefficients of a lens that is not named: add 'distortion_model: plumb_bob', or "
            "'distortion_model: equidistant' for a calibration by cv2.fisheye"
        )
    if not given and len(distortion) not in COEFFICIENTS[model]:
        model = "rational_polynomial"  # OpenCV's files do not name it
    if len(distortion) not in COEFFICIENTS[model]:
        allowed = " or ".join(map(str, COEFFICIENTS[model]))
        raise DriverError(f"{path}: {len(distortion)} distortion coefficients; {model} has {allowed}")
    return CameraInfo(
        size_of(path, content, "image_width"),
        size_of(path, content, "image_height"),
        matrix,
        distortion,
        model,
        str(content.get("camera_name", "camera")),
        _covariance_of(path, content, 4 + len(distortion)),
    )


def _covariance_of(path: Path, content: dict[str, Any], size: int) -> tuple[float, ...]:
    """The intrinsics' covariance, empty where the file has none."""
    if content.get(_COVARIANCE) is None:
        return ()
    found = numbers_of(path, content, _COVARIANCE)
    if len(found) != size * size:
        raise DriverError(
            f"{path}: {_COVARIANCE} has {len(found)} numbers, {size} x {size} are needed; "
            "without it a usual one is taken"
        )
    if not all(math.isfinite(x) for x in found) or min(found[:: size + 1]) < 0:
        raise DriverError(f"{path}: {_COVARIANCE} must be finite, its diagonal not negative")
    return found


def write_camera_info(path: Path, info: CameraInfo) -> None:
    """Write a calibration; DriverError if the file cannot be written."""
    m = info.matrix
    content: dict[str, Any] = {
        "image_width": info.width,
        "image_height": info.height,
        "camera_name": info.name,
        "camera_matrix": {"rows": 3, "cols": 3, "data": list(m)},
        "distortion_model": info.distortion_model,
        "distortion_coefficients": {"rows": 1, "cols": len(info.distortion), "data": list(info.distortion)},
        "rectification_matrix": {"rows": 3, "cols": 3, "data": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]},
        "projection_matrix": {"rows": 3, "cols": 4, "data": [*m[0:3], 0.0, *m[3:6], 0.0, *m[6:9], 0.0]},
    }
    if info.covariance:
        size = 4 + len(info.distortion)
        content[_COVARIANCE] = {"rows": size, "cols": size, "data": list(info.covariance)}
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=1000)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise DriverError(f"{path}: cannot be written ({error.strerror}); choose another path") from None
