"""The camera model that the settings describe: calibration file and mount, or a field of view."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from companion.errors import LandslopeError
from companion.settings.settings import CameraSettings
from drivers.files.camera_info import EQUIDISTANT, CameraInfo, read_camera_info
from drivers.files.picture_mask import read_mask
from landing.errors import LandingError
from landing.vision.camera import DOWN, CameraModel, body_from_camera

LARGEST_ANGLE_DEG = 80.0
"""Off the axis, in the picture's corners: beyond, a plane's normalised coordinates run away."""
SMALLEST_FOV_DEG = 2.0
"""Across the picture; no lens to look down with is longer."""
LARGEST_ASPECT = 1.5
"""Of the two focal lengths: pixels of cameras are square, or nearly."""
INVERSE_PX = 0.5
"""How far off a border's pixel may come back from its ray: further, and the distortion folds the picture over."""


def camera_model(
    camera: CameraSettings,
    width: int,
    height: int,
    *,
    fov_deg: float | None = None,
    focal_px: float | None = None,
) -> tuple[CameraModel, bool]:
    """The model for images of ``width`` x ``height`` pixels, and whether it is calibrated.

    ``fov_deg`` (across the image) or ``focal_px`` stand in for a calibration file; without any of the three
    ``camera.assumed_fov_deg`` is taken and the camera counts as uncalibrated. Raises LandslopeError for values that no
    camera has, DriverError for a ``camera.mask`` that is none.
    """
    mask = read_mask(Path(camera.mask), width, height) if camera.mask else None
    mount = body_from_camera(
        math.radians(camera.mount_roll_deg),
        math.radians(camera.mount_pitch_deg),
        math.radians(camera.mount_yaw_deg),
    )
    if fov_deg is None and focal_px is None and camera.calibration:
        info = read_camera_info(Path(camera.calibration))
        if (info.width, info.height) != (width, height):
            raise LandslopeError(
                f"{camera.calibration}: is for images of {info.width} x {info.height}, the camera gives "
                f"{width} x {height}: calibrate at this size, or set the camera to the other"
            )
        return model_of(info, camera.calibration, mount, readout_of(camera), mask), True
    calibrated = fov_deg is not None or focal_px is not None
    if focal_px is None:
        across = camera.assumed_fov_deg if fov_deg is None else fov_deg
        focal_px = width / 2 / math.tan(math.radians(across) / 2)
    model = CameraModel.from_focal(width, height, focal_px, mount, readout_of(camera), mask)
    _check(model, "the camera" if calibrated else "camera.assumed_fov_deg")
    return model, calibrated


def readout_of(camera: CameraSettings) -> float | None:
    """The rows' readout, seconds, as ``CameraModel`` has it: None where it is not known."""
    return None if isinstance(camera.readout_s, str) else camera.readout_s


def model_of(
    info: CameraInfo,
    path: str | Path,
    mount: NDArray[np.float64] = DOWN,
    readout_s: float | None = 0.0,
    mask: NDArray[np.bool_] | None = None,
) -> CameraModel:
    """The model of a calibration read from ``path``; LandslopeError for values that no camera has."""
    try:
        model = CameraModel(
            info.width,
            info.height,
            np.array(info.matrix, np.float64),
            np.array(info.distortion, np.float64),
            mount,
            readout_s,
            equidistant=info.distortion_model == EQUIDISTANT,
            intrinsics_covariance=(
                np.array(info.covariance).reshape(4 + len(info.distortion), -1) if info.covariance else None
            ),
            mask=mask,
        )
    except LandingError as error:
        raise LandslopeError(f"{path}: {error}") from None
    _check(model, path)
    return model


def _check(model: CameraModel, name: str | Path) -> None:
    fault = implausible(model)
    if fault:
        raise LandslopeError(f"{name}: {fault}; check the numbers, or calibrate anew")


def implausible(model: CameraModel) -> str:
    """What of a model no camera has, in words; empty where it may be one."""
    width, height, m = model.width, model.height, model.matrix
    fx, fy, cx, cy = m[0, 0], m[1, 1], m[0, 2], m[1, 2]
    if not 1 / LARGEST_ASPECT <= fx / fy <= LARGEST_ASPECT:
        return f"focal lengths of {fx:.6g} and {fy:.6g} px differ by more than {LARGEST_ASPECT:g} times"
    if not (0 <= cx <= width - 1 and 0 <= cy <= height - 1):
        return f"the principal point {cx:.6g}, {cy:.6g} lies outside of a picture of {width} x {height}"
    across_deg = 2 * math.degrees(math.atan(width / 2 / fx))
    if across_deg < SMALLEST_FOV_DEG:
        return (
            f"a focal length of {fx:.6g} px shows {across_deg:.2g} degrees of a picture of {width} px, "
            f"{SMALLEST_FOV_DEG:g} at least"
        )
    border = _border(width, height)
    rays = model.undistort(border)
    angle_deg = math.degrees(math.atan(float(np.hypot(*rays.T).max())))
    if not angle_deg <= LARGEST_ANGLE_DEG:
        return (
            f"a focal length of {fx:.6g} px puts the corners of a picture of {width} x {height} at {angle_deg:.0f} "
            f"degrees off the axis, {LARGEST_ANGLE_DEG:g} at most"
            + (": crop the picture, or fly a narrower lens" if model.equidistant else "")
        )
    off_px = float(np.abs(model.project(rays) - border).max())
    if not off_px <= INVERSE_PX:
        return f"the distortion has no inverse at the picture's border (off by {off_px:.3g} px)"
    return ""


def _border(width: int, height: int) -> NDArray[np.float64]:
    """Pixels (n, 2) along the border of a picture."""
    x, y = np.linspace(0, width - 1, 17), np.linspace(0, height - 1, 17)
    sides = [np.column_stack((x, np.full(17, at))) for at in (0.0, height - 1.0)]
    sides += [np.column_stack((np.full(17, at), y)) for at in (0.0, width - 1.0)]
    return np.concatenate(sides)
