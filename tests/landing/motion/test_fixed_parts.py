"""What stands still in the picture while the ground moves is found, kept, and given back when it moves after all."""

import numpy as np
import pytest

from landing.motion.fixed_parts import FixedParts
from landing.motion.views import View
from landing.options import Options
from landing.pipeline import SurfacePipeline
from landing.vision.camera import CameraModel
from landing.vision.rolling_shutter import Motion

WIDTH, HEIGHT, FOCAL, STEP_PX = 160, 120, 120.0, 3
NORMAL = np.array((0.0, 0.0, 1.0))
CAMERA = CameraModel.from_focal(WIDTH, HEIGHT, FOCAL)
RNG = np.random.default_rng(7)
WIDE = np.repeat(np.repeat(RNG.integers(60, 200, (HEIGHT // 2, 500)), 2, 0), 2, 1).astype(np.uint8)
SKID = np.zeros((HEIGHT, WIDTH), bool)
SKID[:, 8:16] = True
DROP = np.hypot(np.arange(WIDTH) - 100, np.arange(HEIGHT)[:, None] - 40) < 7


def motion() -> Motion:
    """The ground goes to the left, a step a frame of 0.1 s: the camera goes to the right."""
    return Motion(np.array((STEP_PX / FOCAL / 0.1, 0.0, 0.0)), NORMAL)


def picture(frame: int, ground: np.ndarray = WIDE) -> np.ndarray:
    noise = np.random.default_rng(frame).normal(0, 2, (HEIGHT, WIDTH))
    part = ground[:HEIGHT, STEP_PX * frame : STEP_PX * frame + WIDTH]
    return np.clip(part + noise, 0, 255).astype(np.uint8)


def fly(
    parts: FixedParts, frames: range, still: np.ndarray | None = None, ground: np.ndarray = WIDE
) -> FixedParts:
    for frame in frames:
        seen = picture(frame, ground)
        if still is not None:
            seen[still] = 45 + seen[still] // 16
        parts.step(View(frame, 0.1 * frame, np.eye(3), 1e-3), seen, motion())
    return parts


@pytest.mark.parametrize("still", [SKID, DROP])
def test_a_skid_and_a_drop_are_found_and_nothing_else(still: np.ndarray) -> None:
    found = fly(FixedParts(CAMERA), range(60), still).mask
    assert found[still].mean() > 0.85
    near = np.zeros_like(still)
    for shift in range(-9, 10):
        near |= np.roll(still, shift, 1) | np.roll(np.roll(still, shift, 0), 9, 1) | np.roll(still, shift, 0)
    assert found[~near].mean() < 0.01


def test_ground_alone_is_never_masked() -> None:
    assert not fly(FixedParts(CAMERA), range(100)).mask.any()


def test_ground_without_texture_is_not_taken_for_a_part_of_the_vehicle() -> None:
    assert not fly(FixedParts(CAMERA), range(80), None, np.full_like(WIDE, 120)).mask.any()


@pytest.mark.parametrize("period_px", [3, 6, 9, 12, 16])
def test_tiles_that_fall_on_themselves_are_not_masked(period_px: int) -> None:
    """Ground whose pattern repeats after just the way that the view goes looks still as well as moving."""
    tiles = np.where(np.arange(1000) % period_px < period_px // 2, 80, 180).astype(np.uint8)
    assert not fly(FixedParts(CAMERA), range(80), None, np.tile(tiles, (HEIGHT, 1))).mask.any()


def test_a_drop_that_is_wiped_off_is_given_back() -> None:
    parts = fly(FixedParts(CAMERA), range(60), DROP)
    assert parts.mask.any()
    assert not fly(parts, range(60, 150)).mask.any()


def test_what_an_earlier_flight_found_holds_from_the_start_and_can_be_taken_back() -> None:
    before = fly(FixedParts(CAMERA), range(60), SKID).mask
    parts = FixedParts(CAMERA, before)
    np.testing.assert_array_equal(parts.mask, before)
    assert fly(parts, range(60), SKID).mask[SKID].mean() > 0.97
    assert not fly(FixedParts(CAMERA, before), range(90)).mask.any()


def test_nothing_is_found_while_the_ground_does_not_move_in_the_picture() -> None:
    """Neither when hovering, nor when nobody knows the motion, nor without an attitude."""
    parts = FixedParts(CAMERA)
    seen = picture(0)
    for frame in range(60):
        still = Motion(np.zeros(3), NORMAL) if frame % 2 else None
        attitude = np.eye(3) if frame % 3 else None
        assert not parts.step(View(frame, 0.1 * frame, attitude, 1e-3), seen, still)
    assert not parts.mask.any()


def test_a_large_picture_is_compared_at_a_part_of_its_size() -> None:
    camera = CameraModel.from_focal(4 * WIDTH + 4, 4 * HEIGHT + 8, 4 * FOCAL)
    parts = FixedParts(camera)
    for frame in range(50):
        seen = picture(frame)
        seen[SKID] = 45
        large = np.pad(np.repeat(np.repeat(seen, 4, 0), 4, 1), ((0, 8), (0, 4)), mode="edge")
        parts.step(View(frame, 0.1 * frame, np.eye(3), 1e-3), large, motion())
    assert parts.mask.shape == (camera.height, camera.width)
    assert parts.mask[:, 32:64].mean() > 0.97
    assert not parts.mask[:, 120:].any()


def test_what_one_pipeline_finds_is_not_another_ones():
    camera = CameraModel.from_focal(320, 240, 256.0)
    pipeline = SurfacePipeline(camera, Options())
    known = np.zeros((240, 320), bool)
    known[:40] = True
    pipeline.find_fixed(known)
    assert pipeline.camera.mask is not None
    assert camera.mask is None
    assert SurfacePipeline(camera, Options()).camera.mask is None
