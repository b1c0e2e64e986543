"""Dense relief on scenes of known heights: boxes and pits are found, and what is not seen is unknown, never even."""

import math
from dataclasses import replace

import numpy as np
import pytest
from ground_scene import CAMERA, Patch, Scene, flown

from landing.ground.block_match import BLOCK, PART
from landing.ground.map import GroundMap
from landing.ground.relief import DenseRelief, ViewRelief
from landing.options import GroundOptions, Options
from landing.pipeline import SurfacePipeline
from landing.vision.camera import DOWN, CameraModel

HEIGHT = 2.0
WAY = 0.15
LEVEL = np.array((0.0, 0.0, 1.0))


def looked(scene: Scene, old_scene: Scene | None = None, way: float = WAY) -> ViewRelief:
    """A look from 2 m up, after a way to the north."""
    new = scene.picture(np.array((0.0, 0.0, HEIGHT)), frame=1)
    old = (old_scene or scene).picture(np.array((-way, 0.0, HEIGHT)), frame=2)
    # the camera's y is south: the older frame lies there
    t = np.array((0.0, way / HEIGHT, 0.0))
    return DenseRelief(GroundOptions(), CAMERA).look(new, old, LEVEL, t, np.eye(3))


def places(relief: ViewRelief) -> tuple[np.ndarray, np.ndarray]:
    """North and east (n,) where the parts lie on level ground."""
    return -relief.points[:, 1] * HEIGHT, relief.points[:, 0] * HEIGHT


def heights(relief: ViewRelief) -> np.ndarray:
    """Metres over the level ground (n,)."""
    return (1 - relief.depth) * HEIGHT


def test_level_ground_is_level_and_its_errors_are_what_they_are_said_to_be() -> None:
    relief = looked(Scene())
    known = relief.known
    assert known.mean() > 0.6
    found = heights(relief)[known]
    assert abs(np.median(found)) < 0.015  # matches lock to whole pixels by up to 0.05 px
    normalised = found / (relief.std[known] * HEIGHT)
    assert 0.3 < np.sqrt(np.mean(normalised**2)) < 1.5
    assert not relief.moving.any()


@pytest.mark.parametrize("top", [0.12, 0.3, -0.2, -0.4])
def test_a_box_and_a_pit_are_found_with_their_height(top: float) -> None:
    relief = looked(Scene((Patch(0.1, 0.0, 0.5, 0.5, top),)))
    north, east = places(relief)
    # where its top is seen from above, well inside
    shrink = 1 - top / HEIGHT
    middle = (np.abs(north * shrink - 0.1) < 0.12) & (np.abs(east * shrink) < 0.12)
    found = heights(relief)[middle & relief.known]
    assert len(found) >= 4
    assert np.median(found) == pytest.approx(top, abs=0.02 + 0.14 * abs(top))


def test_ground_without_texture_is_unknown_though_its_surroundings_are_even() -> None:
    relief = looked(Scene((Patch(0.1, 0.0, 0.7, 0.7, 0.2, smooth=True),)))
    north, east = places(relief)
    inside = (np.abs(north - 0.1) < 0.22) & (np.abs(east) < 0.22)
    assert inside.sum() >= 9
    assert not relief.known[inside].any()
    assert relief.known.mean() > 0.4


@pytest.mark.parametrize("grey", [30.0, 120.0, 220.0])
def test_beside_the_edge_of_smooth_ground_only_the_edge_is_seen(grey: float) -> None:
    """The window of a match holds texture from beyond the edge; a part of a block shows none of its own."""
    relief = looked(Scene((Patch(0.1, 0.0, 0.7, 0.7, 0.0, smooth=True, grey=grey),)))
    north, east = places(relief)
    edge_m = 0.75 * PART / CAMERA.focal_px * HEIGHT
    inside = (np.abs(north - 0.1) < 0.35 - edge_m) & (np.abs(east) < 0.35 - edge_m)
    assert inside.sum() >= 50
    assert relief.known[inside].mean() < 0.02


@pytest.mark.parametrize("grey", [30.0, 200.0])
def test_a_smooth_pit_is_not_known_from_what_surrounds_it(grey: float) -> None:
    """In flight: neither windows nor what prepares the pictures for the tracks carry texture into it."""
    pit = Patch(1.0, 0.0, 1.2, 1.2, -0.4, smooth=True, grey=grey)
    pipeline = SurfacePipeline(CAMERA, Options())
    for observation in flown(Scene((pit,)), 2.0):
        pipeline.step(observation)
    ground = pipeline.ground.map
    inside, beside = (
        [ground.cell_of(1.0 + 0.1 * n, 0.1 * e + aside) for n in range(-3, 4) for e in range(-3, 4)]
        for aside in (0.0, -1.1)
    )
    assert not any(ground.known[cell] for cell in inside)
    assert sum(ground.known[cell] for cell in beside) > 10


def test_a_change_of_exposure_is_no_height() -> None:
    new = Scene().picture(np.array((0.0, 0.0, HEIGHT)), frame=1)
    old = Scene().picture(np.array((-WAY, 0.0, HEIGHT)), frame=2)
    brighter = np.clip(old.astype(float) * 1.05 + 12, 0, 255).astype(np.uint8)
    t = np.array((0.0, WAY / HEIGHT, 0.0))
    one, other = (
        DenseRelief(GroundOptions(), CAMERA).look(new, o, LEVEL, t, np.eye(3)) for o in (old, brighter)
    )
    assert other.known.mean() > 0.9 * one.known.mean()
    assert np.nanstd(heights(other)) < 1.3 * np.nanstd(heights(one))


def test_noise_alone_is_no_texture() -> None:
    relief = looked(Scene(smooth=True, noise=8.0))
    assert relief.known.mean() < 0.02


def test_what_was_not_in_the_older_picture_is_unknown() -> None:
    relief = looked(Scene())
    north, _ = places(relief)
    newest = north > north.max() - WAY
    assert newest.any()
    assert not relief.known[newest].any()


def test_what_moves_across_the_parallax_is_marked_and_not_known() -> None:
    relief = looked(Scene((Patch(0.1, 0.03, 0.6, 0.6, 0.02),)), Scene((Patch(0.1, 0.0, 0.6, 0.6, 0.02),)))
    north, east = places(relief)
    inside = (np.abs(north - 0.1) < 0.15) & (np.abs(east) < 0.15)
    assert relief.moving[inside].mean() > 0.5
    assert not relief.known[relief.moving].any()


def test_other_ground_in_the_older_picture_is_not_matched() -> None:
    relief = looked(Scene(seed=1), Scene(seed=2))
    assert relief.known.mean() < 0.1


def test_a_mask_is_never_ground() -> None:
    dense = DenseRelief(GroundOptions(), CAMERA)
    dense.mask[:40] = True
    scene = Scene()
    new, old = (scene.picture(np.array((n, 0.0, HEIGHT)), frame=k) for k, n in enumerate((0.0, -WAY)))
    relief = dense.look(new, old, LEVEL, np.array((0.0, WAY / HEIGHT, 0.0)), np.eye(3))
    assert not relief.known[: 4 * 40].any()
    assert relief.known[4 * 40 :].mean() > 0.5


def test_a_large_picture_is_reduced_as_far_as_the_ground_allows() -> None:
    """A cell of 10 cm seen from 2, 10 and 20 m up; 320 columns are looked at whatever the cell."""
    camera = CameraModel.from_focal(1280, 960, 1000.0)
    dense = DenseRelief(GroundOptions(), camera)
    assert [dense.reduced(resolution)[1] for resolution in (0.1 / 2, 0.1 / 10, 0.1 / 20)] == [4, 2, 1]
    small = dense.reduced(0.1 / 2)[0].camera
    assert (small.width, small.height) == (320, 240)
    pixel = np.array(((100.0, 700.0),))
    np.testing.assert_allclose(small.undistort((pixel + 0.5) / 4 - 0.5), camera.undistort(pixel), atol=1e-9)
    assert DenseRelief(GroundOptions(), CAMERA).reduced(1.0)[1] == 1


def test_a_reduced_picture_has_the_mask_too() -> None:
    mask = np.zeros((480, 640), bool)
    mask[:, 300] = True
    dense = DenseRelief(GroundOptions(), CameraModel.from_focal(640, 480, 520.0, mask=mask))
    half = dense.reduced(1.0)[0]
    blocks = half.mask.reshape(240 // BLOCK, 320 // BLOCK)
    assert blocks[:, 150 // BLOCK].all()
    assert blocks.mean() < 0.1
    dense.camera.mask = None
    dense.take_mask()
    assert not half.mask.any()


def test_a_look_at_a_reduced_picture_falls_into_the_cells_that_a_whole_one_does() -> None:
    """A part of the reduced picture is twice as wide on the ground."""
    ground = [GroundMap(GroundOptions(), CAMERA.focal_px * k) for k in (1, 2)]
    relief = looked(Scene())
    for one, look in zip(ground, (relief, replace(relief, reduction=2)), strict=True):
        one.move(0.0, np.zeros(3))
        one.look(look, DOWN, HEIGHT)
    np.testing.assert_array_equal(ground[0].looks, ground[1].looks)
    assert ground[0].looks.any()


def test_a_look_that_no_cell_is_fine_enough_for_is_not_asked_for() -> None:
    ground = GroundMap(GroundOptions(), 256.0)
    assert ground.resolution(2.0) == pytest.approx(0.05)
    assert math.isnan(ground.resolution(20.0))
    assert math.isnan(ground.resolution(math.nan))


def test_without_motion_there_is_no_height() -> None:
    relief = looked(Scene(), way=1e-5)
    assert not relief.known.any()
    assert all(math.isnan(depth) for depth in relief.depth)


def test_a_look_that_is_too_uncertain_asks_for_a_longer_baseline_and_a_sure_one_for_the_usual() -> None:
    relief = DenseRelief(GroundOptions(), CAMERA)
    usual_px = relief.target_px
    seen = looked(Scene())
    uncertain, sure = (replace(seen, std=np.full_like(seen.std, std)) for std in (0.012, 0.001))
    nothing = replace(seen, depth=np.full_like(seen.depth, math.nan))
    for _ in range(30):
        relief.ask_for(nothing, 0.006)
    assert relief.target_px == usual_px
    for _ in range(3):
        before_px = relief.target_px
        relief.ask_for(uncertain, 0.006)
        assert before_px < relief.target_px < 2.5 * usual_px
    for _ in range(30):
        relief.ask_for(uncertain, 0.006)
    assert relief.target_px == pytest.approx(2.5 * usual_px, rel=0.01)
    for _ in range(40):
        relief.ask_for(sure, 0.006)
    assert relief.target_px == pytest.approx(usual_px, rel=0.01)
