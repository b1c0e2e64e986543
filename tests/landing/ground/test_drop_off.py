"""A step along a side of the view, by tracks that are each too uncertain to tell."""

import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from landing.ground.border import SIDES
from landing.ground.drop_off import DropOff
from landing.ground.roughness import Relief
from landing.options import Options
from landing.vision.camera import CameraModel

OPTIONS = Options().estimator
CAMERA = CameraModel.from_focal(320, 240, 256.0)
SIZE = np.array((CAMERA.width, CAMERA.height))
TRACKS = 150


def tracks(seed: int, side: int, step: float, share: float, std: float = 0.02) -> tuple[Relief, np.ndarray]:
    """Tracks over level ground, with a step along a side over that share of the view, measured with an error."""
    rng = np.random.default_rng(seed)
    pixels = rng.uniform(8, SIZE - 9, (TRACKS, 2))
    axis, far = SIDES[side]
    depth = (SIZE[axis] - 1 - pixels[:, axis] if far else pixels[:, axis]) / SIZE[axis]
    height = np.where(depth < share, step, 0.0) + rng.normal(0, std, TRACKS)
    slots = np.arange(TRACKS)
    return Relief(slots, height, np.full(TRACKS, std), 0.0, 0.003, 0, 0), pixels


@pytest.mark.parametrize("side", range(4))
@pytest.mark.parametrize("step", [-0.08, 0.08])
def test_many_uncertain_tracks_are_sure_together(side: int, step: float):
    relief, pixels = tracks(1, side, step, 0.12, 0.035)
    assert (np.abs(relief.height) < OPTIONS.standing_sigmas * relief.std).all()
    found = DropOff(OPTIONS, CAMERA).step(relief, pixels, {side})
    assert found == pytest.approx(step**2 * 0.12, rel=0.5)
    assert Options().decision.max_roughness ** 2 < found


@examples(200)
@given(st.integers(0, 2**31), st.floats(0.005, 0.05))
def test_noise_alone_is_no_drop_off(seed: int, std: float):
    relief, pixels = tracks(seed, 0, 0.0, 0.0, std)
    assert DropOff(OPTIONS, CAMERA).step(relief, pixels, {0, 1, 2, 3}) == 0.0


def test_only_where_ground_comes_in():
    relief, pixels = tracks(1, 0, 0.08, 0.12)
    assert DropOff(OPTIONS, CAMERA).step(relief, pixels, set()) == 0.0
    assert DropOff(OPTIONS, CAMERA).step(relief, pixels, {1}) == 0.0


def test_few_tracks_say_nothing():
    relief, pixels = tracks(1, 0, 0.5, 0.12)
    some = np.flatnonzero(pixels[:, 1] < OPTIONS.drop_off_share * 239)[: OPTIONS.drop_off_tracks - 1]
    few = Relief(relief.slots[some], relief.height[some], relief.std[some], 0.0, 0.003, 0, 0)
    assert DropOff(OPTIONS, CAMERA).step(few, pixels[some], {0}) == 0.0
