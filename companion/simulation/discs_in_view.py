"""Which discs of the ground the camera sees whole."""

import math

import numpy as np
from numpy.typing import NDArray

from landing.vision.camera import CameraModel

Array = NDArray[np.float64]

_RIM = np.arange(8) * (math.pi / 4)


def discs_in_view(
    camera: CameraModel,
    ned_from_camera: Array,
    normal: Array,
    distance_m: float,
    places: Array,
    radius_m: float,
    margin_px: float,
) -> NDArray[np.bool_]:
    """Whether each disc (n,) lies whole in the picture, ``margin_px`` from its border or more.

    ``places`` (n, 2) are the discs' middles, north and east of the camera in m. The surface is the plane
    normal . X = distance_m in the camera frame, ``normal`` (-a, -b, 1).
    """
    rim = places[:, None, :] + radius_m * np.stack((np.cos(_RIM), np.sin(_RIM)), axis=1)
    towards = ned_from_camera @ normal
    if not towards[2] > 0:
        return np.zeros(len(places), bool)
    down = (distance_m - rim @ towards[:2]) / towards[2]
    rays = np.concatenate((rim, down[..., None]), axis=-1) @ ned_from_camera
    ahead = rays[..., 2] > 0
    there = rays[..., :2] / np.where(ahead, rays[..., 2], 1.0)[..., None]
    pixels = camera.project(there.reshape(-1, 2))
    far = np.array((camera.width, camera.height)) - 1 - margin_px
    inside = ((pixels >= margin_px) & (pixels <= far)).all(axis=1).reshape(ahead.shape)
    return np.asarray((inside & ahead).all(axis=1))
