"""Pictures of level ground that passes by, with or without something higher behind its edge."""

from functools import lru_cache

import cv2
import numpy as np

from drivers.simulated.world.textures import texture
from landing.options import Options
from landing.vision.camera import CameraModel

RATE_HZ, WIDTH, HEIGHT, STEP_PX = 30.0, 240, 180, 4
CAMERA = CameraModel.from_focal(WIDTH, HEIGHT, 200.0)
KEPT_PX = Options().ground.baseline * CAMERA.width
"""Motion over which a doubt at the border lasts."""
FRAMES, RELIEF = 40, 0.25
TURNS = {"right": 0, "bottom": 1, "left": 2, "top": 3}
"""Quarters of a turn that bring the ground in at each side."""


@lru_cache(maxsize=1)
def _textures() -> tuple[np.ndarray, ...]:
    """Of the ground and of what stands on it."""
    return tuple(cv2.GaussianBlur(texture("noise", k, 1024), (0, 0), 1.5).astype(np.float32) for k in (1, 2))


def pictures(comes: int | None, turns: int, step_px: int = STEP_PX) -> list[np.ndarray]:
    """Level ground that passes by; from frame ``comes`` on, something a quarter higher follows at the side."""
    rng = np.random.default_rng(1)
    height, width = (WIDTH, HEIGHT) if turns % 2 else (HEIGHT, WIDTH)
    ground, top = _textures()
    out = []
    for k in range(FRAMES):
        image = ground[100 : 100 + height, k * step_px : k * step_px + width].copy()
        if comes is not None and k > comes:
            # nearer by a quarter, so faster by a quarter
            way = (k - comes) * step_px * (1 + RELIEF)
            moved = cv2.warpAffine(top, np.array(((1.0, 0, width - way), (0, 1.0, -300))), (width, height))
            edge = max(0, round(width - way))
            image[height // 4 : -height // 4, edge:] = moved[height // 4 : -height // 4, edge:]
        noisy = np.rot90(image, -turns) + rng.normal(0, 1.5, (HEIGHT, WIDTH))
        out.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    return out
