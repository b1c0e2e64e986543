"""A picture that stands still while the vehicle turns: noticed through noise, and not where the ground really moves."""

import numpy as np
import pytest

from companion.core.frozen_camera import FrozenCamera
from companion.settings.settings import HealthSettings
from landing.rotations import matrix_from_euler
from landing.vision.camera import CameraModel, body_from_camera

SIZE = (160, 120)
CAMERA = CameraModel.from_focal(*SIZE, 128.0, body_from_camera(0, 0, 0))


def ground(seed: int = 1) -> np.ndarray:
    import cv2

    noise = np.random.default_rng(seed).random((400, 600)).astype(np.float32)
    grain = cv2.GaussianBlur(noise, (0, 0), 3)
    return ((grain - grain.min()) * (200 / (grain.max() - grain.min())) + 20).astype(np.float32)


def run(shift_px, noise: float = 2.0, turn_deg_s: float = 6.0, seconds: float = 2.0) -> list[bool]:
    """``shift_px(t)`` is where the picture has moved to, the vehicle pitching at a constant rate."""
    camera, texture, random = FrozenCamera(HealthSettings(), CAMERA), ground(), np.random.default_rng(2)
    frozen = []
    for i in range(round(seconds * 30)):
        t = i / 30
        y = round(shift_px(t)) + 100
        picture = texture[y : y + SIZE[1], 100 : 100 + SIZE[0]] + random.normal(0, noise, SIZE[::-1])
        image = np.clip(picture, 0, 255).astype(np.uint8)
        frozen.append(camera.step(t, image, matrix_from_euler(0, np.radians(turn_deg_s * t), 0)))
    return frozen


@pytest.mark.parametrize("noise", [0.5, 2.0, 4.0])
def test_standing_picture_is_noticed_soon(noise) -> None:
    frozen = run(lambda t: 0.0, noise)
    assert frozen[-1]
    assert frozen.index(True) < 30


def test_picture_that_turns_along_or_moves_is_alive() -> None:
    turning = 128.0 * np.radians(6.0)
    assert not any(run(lambda t: turning * t))
    assert not any(run(lambda t: -45 * t))
    assert not any(run(lambda t: 0.4 * turning * t))


def test_without_turning_nothing_can_be_said() -> None:
    assert not any(run(lambda t: 0.0, turn_deg_s=0.0))


def test_a_new_picture_ends_it() -> None:
    frozen = run(lambda t: 0.0 if t < 1.2 else 40 + 60 * t, turn_deg_s=6.0)
    assert frozen[35]
    assert not frozen[38]
    assert not frozen[-1]
