"""What the texture tells of a match: its information, and what a deformation does to it."""

import cv2
import numpy as np
import pytest

from landing.options import TrackingOptions
from landing.vision.camera import CameraModel
from landing.vision.texture import Texture, structure_tensor

SIZE = 64
CAMERA = CameraModel.from_focal(SIZE, SIZE, 80.0)
OPTIONS = TrackingOptions()
MIDDLE = np.array((32.5, 32.5))
"""Of a block next to the image's."""


def one_sided(seed: int = 1) -> np.ndarray:
    """A patch with faint texture all over and strong texture in its right and lower part only."""
    rng = np.random.default_rng(seed)
    picture = 128 + 4 * cv2.GaussianBlur(rng.normal(size=(SIZE, SIZE)), (0, 0), 1.5)
    strong = 60 * cv2.GaussianBlur(rng.normal(size=(SIZE, SIZE)), (0, 0), 1.5)
    picture[33:, 34:] += strong[33:, 34:]
    return np.clip(picture, 0, 255)


def deformed(picture: np.ndarray, a: np.ndarray) -> np.ndarray:
    """The picture after x -> x + a x about the middle."""
    turn = np.eye(2) + a
    m = np.column_stack((turn, MIDDLE - turn @ MIDDLE))
    return cv2.warpAffine(picture, m, (SIZE, SIZE), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)


def shift(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """What Lucas-Kanade, which looks for a shift alone, finds at the middle."""
    at = MIDDLE[None].astype(np.float32)
    window = (OPTIONS.window_px, OPTIONS.window_px)
    images = (np.clip(np.rint(p), 0, 255).astype(np.uint8) for p in (before, after))
    found, _, _ = cv2.calcOpticalFlowPyrLK(*images, at, at.copy(), winSize=window, maxLevel=0, flags=4)
    return found[0] - MIDDLE


def about(picture: np.ndarray, options: TrackingOptions = OPTIONS):
    image = np.clip(np.rint(picture), 0, 255).astype(np.uint8)
    return Texture(CAMERA, options).about(structure_tensor(image), MIDDLE[None].astype(np.float32))


@pytest.mark.parametrize(
    "a",
    [
        ((0.03, 0), (0, 0)),
        ((0, 0.03), (0, 0)),
        ((0, 0), (0.03, 0)),
        ((0, 0), (0, 0.03)),
        ((0.02, -0.02), (0.02, 0.02)),
    ],
)
def test_what_a_deformation_puts_off_is_known(a):
    """The middle stays where it is; Lucas-Kanade says that it moved, by what the strong side moves."""
    a, said, left = np.array(a, float), [], []
    for seed in range(8):
        picture = one_sided(seed)
        found = shift(picture, deformed(picture, a))
        said.append(np.hypot(*found))
        left.append(np.hypot(*(found - about(picture)[1][..., 0] @ a.ravel())))
    assert min(said) > 0.05
    assert np.mean(left) < 0.3 * np.mean(said)
    assert (np.array(left) < 0.5 * np.array(said)).all()


def test_texture_spread_evenly_is_not_put_off():
    y, x = np.mgrid[:SIZE, :SIZE] - MIDDLE[0]
    even = 128 + 50 * np.cos(0.6 * x) * np.cos(0.6 * y)
    bias = about(even)[1][..., 0]
    assert np.abs(bias).max() < 0.3
    assert np.abs(about(one_sided())[1]).max() > 2.0


def test_along_an_edge_nothing_is_invented():
    """A straight edge tells nothing of the way along it: no deformation moves it there."""
    edge = np.where(np.arange(SIZE) > 37, 200.0, 60.0)[None, :] * np.ones((SIZE, 1))
    bias = about(edge)[1][..., 0]
    assert np.abs(bias[1]).max() < 0.1
    # the edge lies 5 px to the right: a stretch along x moves it by that
    assert bias[0, 0] == pytest.approx(5.0, abs=0.6)


def test_the_more_texture_the_surer_and_never_beyond_the_floor():
    faint, strong = (about(128 + scale * (one_sided(2) - 128))[0][:, 0] for scale in (0.3, 1.0))
    assert faint[0] < strong[0]
    assert faint[2] < strong[2]
    floor = OPTIONS.match_std_px / CAMERA.focal_px
    assert max(strong[0], strong[2]) <= 1.001 / floor


@pytest.mark.parametrize("window_px", [5, 8, 15, 16, 21, 41])
def test_any_window_sums_what_it_covers(window_px: int):
    """Where the tensor is the same everywhere, its sum is the window's area and nothing leans."""
    texture = Texture(CAMERA, TrackingOptions(window_px=window_px))
    same = np.ones((SIZE // 2, SIZE // 2), np.float32)
    whitener, bias = texture.about((same, 0 * same, same), MIDDLE[None].astype(np.float32))
    expected = 1 / (OPTIONS.match_std_px**2 + (OPTIONS.grey_noise / window_px) ** 2)
    assert whitener[0, 0] == pytest.approx(expected**0.5 * CAMERA.focal_px)
    np.testing.assert_allclose(bias, 0, atol=1e-6)
