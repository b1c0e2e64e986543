"""The camera model that the settings describe: calibration file and mount, or a field of view."""

import math
from pathlib import Path

import numpy as np

from companion.errors import LandslopeError
from companion.settings.settings import CameraSettings
from drivers.files.camera_info import read_camera_info
from landing.vision.camera import CameraModel, body_from_camera


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
    ``camera.assumed_fov_deg`` is taken and the camera counts as uncalibrated.
    """
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
        matrix = np.array(info.matrix, np.float64).reshape(3, 3)
        return CameraModel(
            width, height, matrix, np.array(info.distortion, np.float64), mount, camera.readout_s
        ), True
    calibrated = fov_deg is not None or focal_px is not None
    if focal_px is None:
        across = camera.assumed_fov_deg if fov_deg is None else fov_deg
        focal_px = width / 2 / math.tan(math.radians(across) / 2)
    return CameraModel.from_focal(width, height, focal_px, mount, camera.readout_s), calibrated
