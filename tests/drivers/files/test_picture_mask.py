"""``camera.mask``: a picture of the camera's size, or an error that says what to do."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from companion.core.camera_model import camera_model
from companion.settings.settings import CameraSettings
from drivers.errors import DriverError
from drivers.files.picture_mask import read_mask


def written(path: Path, picture: np.ndarray) -> Path:
    assert cv2.imwrite(str(path), picture)
    return path


def test_black_is_masked_in_grey_and_in_colour(tmp_path: Path) -> None:
    picture = np.full((48, 64), 255, np.uint8)
    picture[10:20, 5:9] = 0
    for content in (picture, cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)):
        mask = read_mask(written(tmp_path / "mask.png", content), 64, 48)
        np.testing.assert_array_equal(mask, picture == 0)


def test_the_camera_model_has_it(tmp_path: Path) -> None:
    picture = np.full((48, 64), 255, np.uint8)
    picture[:, :6] = 0
    path = written(tmp_path / "mask.png", picture)
    model, _ = camera_model(CameraSettings(mask=str(path)), 64, 48)
    assert model.mask is not None
    np.testing.assert_array_equal(model.mask, picture == 0)
    barred = model.barred(3)
    assert barred is not None
    assert barred[:, :9].all()
    assert not barred[:, 9:].any()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is no picture"),
        (b"\x89PNG\r\n\x1a\n and then nothing", "is no picture"),
        (np.zeros((48, 64), np.uint8), "black everywhere"),
        (np.full((64, 48), 255, np.uint8), "is 48 x 64, the camera gives 64 x 48"),
    ],
)
def test_what_is_no_mask_is_named(tmp_path: Path, content: bytes | np.ndarray, words: str) -> None:
    path = tmp_path / "mask.png"
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        written(path, content)
    with pytest.raises(DriverError, match=words) as reported:
        read_mask(path, 64, 48)
    assert str(path) in str(reported.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(DriverError, match=r"none\.png: cannot be read"):
        read_mask(tmp_path / "none.png", 64, 48)
