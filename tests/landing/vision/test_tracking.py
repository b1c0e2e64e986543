"""Corners and their tracks: sub-pixel motion, brightness, replenishing, refusal."""

import cv2
import numpy as np
import pytest

from drivers.simulated.world.textures import texture
from landing.options import EstimatorOptions, TrackingOptions
from landing.vision import tracking
from landing.vision.camera import CameraModel
from landing.vision.corners import Corners
from landing.vision.texture import structure_tensor
from landing.vision.tracking import FeatureTracker

SIZE = 200
CAMERA = CameraModel.from_focal(SIZE, SIZE, 200.0)
MIDDLE = (SIZE - 1) / 2


@pytest.fixture(scope="module")
def ground() -> np.ndarray:
    return cv2.GaussianBlur(texture("noise", 1, 512), (0, 0), 1.0).astype(np.float32)


def picture(ground: np.ndarray, dx: float, dy: float, growth: float = 1.0) -> np.ndarray:
    """The ground moved by pixels and grown about the middle, as the image moves."""
    m = np.array(((growth, 0, dx - growth * 256 + MIDDLE), (0, growth, dy - growth * 256 + MIDDLE)))
    flat = cv2.warpAffine(ground, m, (SIZE, SIZE), flags=cv2.INTER_CUBIC)
    return np.clip(np.rint(flat), 0, 255).astype(np.uint8)


def tracker(**changes: float) -> FeatureTracker:
    return FeatureTracker(CAMERA, TrackingOptions(**changes))


def errors_px(found: FeatureTracker, gap: int, dx: float, dy: float) -> np.ndarray:
    pair = found.pair(gap)
    return (pair.new - pair.old) * CAMERA.focal_px - (dx, dy)


@pytest.mark.parametrize("step", [(0.3, 0.0), (2.5, -1.25), (-3.0, 3.5), (0.0, 7.0)])
def test_tracks_follow_to_a_fraction_of_a_pixel(ground: np.ndarray, step: tuple[float, float]):
    found = tracker()
    for k in range(5):
        found.step(picture(ground, step[0] * k, step[1] * k))
    error = errors_px(found, 4, 4 * step[0], 4 * step[1])
    assert len(error) >= 60
    assert np.median(np.abs(error)) < 0.05
    assert np.abs(np.median(error, axis=0)).max() < 0.03, "no common drift"
    assert np.percentile(np.hypot(*error.T), 95) < 0.3


def test_growing_pictures_are_followed_with_a_prediction(ground: np.ndarray):
    found, growth = tracker(), 1.05
    for k in range(6):
        predicted = np.diag((growth, growth, 1.0)) if k else None
        found.step(picture(ground, 0, 0, growth**k), predicted)
    pair = found.pair(3)
    assert len(pair.slots) >= 60
    error = (pair.new - pair.old * growth**3) * CAMERA.focal_px
    assert np.median(np.hypot(*error.T)) < 0.35


def test_brightness_may_step_by_thirty_per_cent(ground: np.ndarray):
    found = tracker()
    for k in range(6):
        image = picture(ground, 1.5 * k, 0)
        found.step(image if k % 2 else (image * 0.7).astype(np.uint8))
    error = errors_px(found, 5, 7.5, 0)
    assert len(error) >= 60
    assert np.median(np.hypot(*error.T)) < 0.1


@pytest.mark.parametrize(("width", "height"), [(16, 16), (18, 40), (33, 25)])
def test_a_picture_with_little_room_for_windows_has_few_tracks(width: int, height: int):
    rng = np.random.default_rng(1)
    found = FeatureTracker(CameraModel.from_focal(width, height, width), TrackingOptions())
    for _ in range(3):
        found.step(rng.integers(0, 255, (height, width), np.uint8))
    assert found.alive.sum() <= 2


def test_corners_are_spread_over_the_image_and_replenished(ground: np.ndarray):
    found = tracker()
    counts = []
    for k in range(25):
        found.step(picture(ground, 4.0 * k, 0))
        counts.append(int(found.alive.sum()))
        assert found.coverage() > 0.5
    assert min(counts) > 0.6 * counts[0]
    alive = found.pixels[found.alive]
    assert len(np.unique((alive // (SIZE / 4)).astype(int), axis=0)) == 16, "some in each sixteenth"


def test_a_slot_that_is_used_again_has_no_past(ground: np.ndarray):
    found = tracker()
    for k in range(25):
        found.step(picture(ground, 6.0 * k, 0))
    young = found.alive & (found.born > found.frame - 5)
    assert young.any()
    old = set(np.flatnonzero(found.alive & (found.born <= found.frame - 5)))
    assert set(found.pair(5).slots) == old
    assert np.isfinite(found.pair(5).old).all()
    assert np.isfinite(found.pair(5).new).all()


def test_a_moving_thing_of_its_own_is_followed_or_refused_but_not_mixed(ground: np.ndarray):
    """Of the two motions every track has one."""
    found = tracker()
    for k in range(5):
        image = picture(ground, 2.0 * k, 0)
        image[60:140, 60:140] = picture(ground, -1.0 * k + 31, 57)[60:140, 60:140]
        found.step(image)
    moved = (found.pair(4).new - found.pair(4).old) * CAMERA.focal_px
    near = np.minimum(np.hypot(moved[:, 0] - 8, moved[:, 1]), np.hypot(moved[:, 0] + 4, moved[:, 1]))
    assert (near < 1.0).mean() > 0.8


def test_another_picture_loses_the_tracks(ground: np.ndarray):
    found = tracker()
    found.step(picture(ground, 0, 0))
    found.step(picture(np.ascontiguousarray(ground.T[::-1]), 90, 40))
    assert len(found.pair(1).slots) < 20
    assert found.refused > 30
    assert found.coverage() > 0.5, "and finds new corners"


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_a_plain_picture_has_no_corner(grey: int):
    found = tracker()
    for _ in range(3):
        found.step(np.full((SIZE, SIZE), grey, np.uint8))
    assert not found.alive.any()
    assert found.coverage() == 0
    assert len(found.pair(1).slots) == 0


def test_noise_alone_is_no_texture_to_speak_of():
    found, rng = tracker(), np.random.default_rng(1)
    for _ in range(4):
        found.step(np.clip(128 + rng.normal(0, 2, (SIZE, SIZE)), 0, 255).astype(np.uint8))
    assert len(found.pair(3).slots) < EstimatorOptions().min_tracks


def test_matches_are_weighted_by_the_texture_of_their_patch():
    """Along vertical stripes with faint specks a match tells of x, hardly of y."""
    rng = np.random.default_rng(2)
    u = np.arange(SIZE)
    image = np.tile(128 + 80 * np.sin(u / 3.0), (SIZE, 1)) + cv2.GaussianBlur(
        rng.normal(0, 25, (SIZE, SIZE)), (0, 0), 1
    )
    found = tracker()
    found.step(np.clip(image, 0, 255).astype(np.uint8))
    c11, _, c22 = found.whitener[:, found.alive]
    assert np.median(c11 / c22) > 1.5


def test_reset_starts_anew(ground: np.ndarray):
    found = tracker()
    found.step(picture(ground, 0, 0))
    found.reset()
    assert not found.alive.any()
    found.step(picture(ground, 0, 0))
    assert found.frame == 0
    assert found.longest() == 0


def test_the_same_pictures_give_the_same_tracks(ground: np.ndarray):
    first, second = tracker(), tracker()
    for k in range(8):
        image = picture(ground, 2.2 * k, 1.1 * k)
        first.step(image)
        second.step(image.copy())
    np.testing.assert_array_equal(first.history, second.history)


def test_faint_things_on_strong_texture_hold_tracks(ground: np.ndarray):
    """A place with little contrast, as a box's top: strong corners about it must not take all there are."""
    low, high = 226, 276
    faint = ground.copy()
    faint[low:high, low:high] = 128 + 0.2 * (faint[low:high, low:high] - 128)
    found, held = tracker(), []
    for k in range(25):
        dx = 3.0 * (k - 12)
        found.step(picture(faint, dx, 0))
        place = found.pixels[found.alive] - MIDDLE - (dx, 0) + 256
        held.append(((place > low) & (place < high)).all(axis=1).mean())
    assert min(held) > 0.5 * ((high - low) / SIZE) ** 2


def test_of_tracks_that_run_into_one_another_the_oldest_is_kept(
    ground: np.ndarray, monkeypatch: pytest.MonkeyPatch
):
    """Twins are looked for as the reference is renewed: then one old track is left of those within 50 pixels."""
    monkeypatch.setattr(tracking, "_TWIN_PX", 50.0)
    found = tracker()
    for k in range(8):
        found.step(picture(ground, 8.0 * k, 0))
    old = found.alive & (found.born < found._reference.frame)
    assert 0 < old.sum() <= 16
    assert found.alive.sum() > 50


def test_corners_come_from_the_loneliest_cells_first(ground: np.ndarray):
    corners = Corners(CAMERA, TrackingOptions())
    left = np.stack(np.meshgrid(np.arange(14.0, 100.0, 17.0), np.arange(14.0, 190.0, 17.0)), axis=-1)
    found = corners.find(structure_tensor(picture(ground, 0, 0)), left.reshape(-1, 2).astype(np.float32))
    assert len(found) > 60
    assert found[:30, 0].min() > 100


@pytest.mark.parametrize("wanted", [20, 60, 150, 600])
@pytest.mark.parametrize(("width", "height"), [(160, 120), (320, 240), (641, 479), (1280, 720)])
def test_there_are_no_more_cells_than_tracks(width: int, height: int, wanted: int):
    camera = CameraModel.from_focal(width, height, 0.8 * width)
    corners = Corners(camera, TrackingOptions(max_features=wanted))
    assert corners.cells <= wanted
    assert corners.cells > 0.7 * wanted or corners.cell_px == 8
