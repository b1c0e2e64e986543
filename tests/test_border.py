"""Relief that has just come into view: seen at the border before any track has a history there."""

import cv2
import numpy as np
import pytest

from drivers.simulated.textures import texture
from landing.border import Border, Standing
from landing.camera import CameraModel
from landing.observation import Observation
from landing.options import Options
from landing.pipeline import SurfacePipeline
from landing.plane import Plane
from landing.roughness import Relief
from landing.views import Views

RATE_HZ, WIDTH, HEIGHT, STEP_PX = 30.0, 240, 180, 4
CAMERA = CameraModel.from_focal(WIDTH, HEIGHT, 200.0)
FRAMES, RELIEF = 40, 0.25
TURNS = {"right": 0, "bottom": 1, "left": 2, "top": 3}
"""Quarters of a turn that bring the ground in at each side."""


def pictures(comes: int | None, turns: int) -> list[np.ndarray]:
    """Level ground that passes by; from frame ``comes`` on, something a quarter higher follows at the side."""
    rng = np.random.default_rng(1)
    height, width = (WIDTH, HEIGHT) if turns % 2 else (HEIGHT, WIDTH)
    ground, top = (
        cv2.GaussianBlur(texture("noise", k, 1024), (0, 0), 1.5).astype(np.float32) for k in (1, 2)
    )
    out = []
    for k in range(FRAMES):
        image = ground[100 : 100 + height, k * STEP_PX : k * STEP_PX + width].copy()
        if comes is not None and k > comes:
            # nearer by a quarter, so faster by a quarter
            way = (k - comes) * STEP_PX * (1 + RELIEF)
            moved = cv2.warpAffine(top, np.array(((1.0, 0, width - way), (0, 1.0, -300))), (width, height))
            edge = max(0, round(width - way))
            image[height // 4 : -height // 4, edge:] = moved[height // 4 : -height // 4, edge:]
        noisy = np.rot90(image, -turns) + rng.normal(0, 1.5, (HEIGHT, WIDTH))
        out.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    return out


def watched(comes: int | None, turns: int = 0) -> list[Standing | None]:
    """What a border of its own finds at each frame of a flight."""
    pipeline, border, found = SurfacePipeline(CAMERA, Options()), Border(Options().estimator, CAMERA), []
    judge = pipeline.relief.step

    def step(views: Views, plane: Plane) -> Relief | None:
        found.append(border.step(views, plane) if plane.status == "ok" else None)
        return judge(views, plane)

    pipeline.relief.step = step  # type: ignore[method-assign]
    for k, image in enumerate(pictures(comes, turns)):
        pipeline.step(Observation(k, k / RATE_HZ, image, np.eye(3), 1e-5))
    return found


@pytest.mark.parametrize("side", TURNS)
def test_what_comes_in_is_seen_at_once(side: str):
    comes = 25
    found = watched(comes, TURNS[side])
    first = next(k for k, standing in enumerate(found) if standing)
    # as soon as it fills the strip behind what the older frame did not see
    assert comes + 2 <= first <= comes + 4
    standing = found[first]
    assert standing is not None
    assert standing.height == pytest.approx(RELIEF, abs=0.12)
    assert standing.mean_square > Options().decision.max_roughness ** 2
    axis, place = {"right": (0, WIDTH), "left": (0, 0), "bottom": (1, HEIGHT), "top": (1, 0)}[side]
    assert np.abs(standing.pixels[:, axis] - place).max() < 20


def test_level_ground_has_nothing_at_its_border():
    assert not any(watched(None))


def test_what_was_seen_at_the_border_makes_the_view_rough_until_tracks_have_judged_it(
    monkeypatch: pytest.MonkeyPatch,
):
    seen = 20
    standing = Standing(np.array(((WIDTH - 2.0, 60.0), (WIDTH - 2.0, 80.0))), 0.2, 0.02**2)
    monkeypatch.setattr(
        Border, "step", lambda _, views, plane: standing if views.tracker.frame == seen else None
    )
    pipeline, rough = SurfacePipeline(CAMERA, Options()), []
    for k, image in enumerate(pictures(None, 0)):
        rough.append(pipeline.step(Observation(k, k / RATE_HZ, image, np.eye(3), 1e-5)).roughness)
    assert max(rough[12:seen]) < 0.01
    assert min(rough[seen : seen + 2]) > 0.015
    # the ground there is even after all
    assert max(rough[seen + 15 :]) < 0.01


@pytest.mark.parametrize(("width", "height"), [(240, 60), (60, 180), (240, 18)])
def test_a_view_without_room_for_strips_is_left_alone(width: int, height: int):
    camera = CameraModel.from_focal(width, height, 200.0)
    pipeline, border = SurfacePipeline(camera, Options()), Border(Options().estimator, camera)
    for k, image in enumerate(pictures(None, 0)[:12]):
        pipeline.step(Observation(k, k / RATE_HZ, image[:height, :width].copy(), np.eye(3), 1e-5))
    moving = Plane("ok", 0.0, 0.0, np.eye(2) * 1e-6, np.array((0.6, 0.0, 0.0)))
    assert border.step(pipeline.views, moving) is None


def test_without_motion_or_attitude_nothing_is_looked_at():
    image = pictures(None, 0)[0]
    pipeline = SurfacePipeline(CAMERA, Options())
    for k in range(4):
        estimate = pipeline.step(Observation(k, k / RATE_HZ, image, np.eye(3) if k % 2 else None))
        assert not estimate.flat
