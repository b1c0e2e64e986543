"""Masked pixels: no corner, no track, no block of the relief, in either of two frames, and no shade beside them."""

import numpy as np
import pytest

from landing.errors import LandingError
from landing.ground.block_match import BLOCK, PART
from landing.ground.relief import DenseRelief
from landing.options import GroundOptions, TrackingOptions
from landing.vision.camera import CameraModel
from landing.vision.tracking import FeatureTracker

WIDTH, HEIGHT, FOCAL = 160, 120, 120.0
MASK = np.zeros((HEIGHT, WIDTH), bool)
MASK[:, 60:70] = True


def ground(shift_px: int, seed: int = 1) -> np.ndarray:
    """Noise that has moved to the left, with a dark bar that stands still where the mask is."""
    rng = np.random.default_rng(seed)
    whole = np.repeat(np.repeat(rng.integers(60, 200, (HEIGHT // 4, 100)), 4, 0), 4, 1).astype(np.uint8)
    picture = whole[:, shift_px : shift_px + WIDTH].copy()
    picture[MASK] = 20
    return picture


def camera(mask: np.ndarray | None = MASK) -> CameraModel:
    return CameraModel.from_focal(WIDTH, HEIGHT, FOCAL, mask=mask)


def test_tracks_keep_away_and_are_given_up_at_it() -> None:
    options = TrackingOptions()
    tracker, half = FeatureTracker(camera(), options), options.window_px // 2
    for shift in range(0, 80, 4):
        tracker.step(ground(shift))
        x = tracker.pixels[tracker.alive][:, 0]
        assert len(x) > 20
        assert ((np.rint(x) < 60 - half) | (np.rint(x) > 69 + half)).all()


def test_without_a_mask_tracks_stick_to_the_bar() -> None:
    tracker = FeatureTracker(camera(None), TrackingOptions())
    for shift in range(0, 40, 4):
        tracker.step(ground(shift))
    x = tracker.pixels[tracker.alive][:, 0]
    assert ((x > 52) & (x < 77)).any()


def test_the_bar_does_not_shade_the_ground_beside_it() -> None:
    """What is matched is the same whatever colour the masked part has."""
    tracker = FeatureTracker(camera(), TrackingOptions())
    dark, light = ground(0), ground(0)
    light[MASK] = 250
    tracker.step(dark)
    first = tracker.images[0].copy()
    tracker.step(light)
    np.testing.assert_array_equal(first, tracker.images[0])


def test_blocks_are_unknown_under_the_mask_of_either_frame() -> None:
    moved_px = 12
    relief = DenseRelief(GroundOptions(), camera())
    # the ground moves to the left, the camera to the right: the older camera was further left
    t = np.array((-moved_px / FOCAL, 0.0, 0.0))
    look = relief.look(ground(moved_px), ground(0), np.array((0.0, 0.0, 1.0)), t, np.eye(3))
    column = np.arange(WIDTH // PART) * PART + (PART - 1) / 2
    known = look.known.reshape(HEIGHT // PART, WIDTH // PART)
    now = (column > 60 - BLOCK) & (column < 70 + BLOCK)
    then = (column + moved_px > 60 - BLOCK) & (column + moved_px < 70 + BLOCK)
    assert not known[:, now].any()
    assert not known[:, then].any()
    assert known[2:-2, ~now & ~then][:, 2:-4].mean() > 0.8
    assert np.nanmax(np.abs(look.depth - 1)) < 0.05


def test_a_mask_of_another_size_is_refused() -> None:
    with pytest.raises(LandingError, match="mask is 10 x 20, the camera gives 160 x 120"):
        camera(np.zeros((20, 10), bool))
