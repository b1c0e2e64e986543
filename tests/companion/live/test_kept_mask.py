"""What stands still in the picture survives a restart, for the same camera and picture size alone."""

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from companion.live.kept_mask import KeptMask
from companion.live.live_pipeline import LivePipeline
from companion.settings.settings import CameraSettings, Settings

MASK = np.zeros((48, 64), bool)
MASK[:, :8] = True
CAMERA = CameraSettings(source="/dev/video0")


def test_it_comes_back_for_the_same_camera(tmp_path: Path) -> None:
    KeptMask(CAMERA, tmp_path / "state").save(MASK, 0)
    found = KeptMask(CAMERA, tmp_path / "state").load(64, 48)
    np.testing.assert_array_equal(found, MASK)


@pytest.mark.parametrize(
    "other",
    [
        CameraSettings(source="/dev/video1"),
        CameraSettings(source="/dev/video0", calibration="another.yaml"),
        CameraSettings(source="/dev/video0", mount_yaw_deg=90.0),
    ],
)
def test_another_camera_or_mount_does_not_get_it(tmp_path: Path, other: CameraSettings) -> None:
    KeptMask(CAMERA, tmp_path).save(MASK, 0)
    assert KeptMask(other, tmp_path).load(64, 48) is None


@pytest.mark.parametrize("content", [b"", b"no picture", None])
def test_another_size_or_a_damaged_file_is_refused_and_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, content: bytes | None
) -> None:
    kept = KeptMask(CAMERA, tmp_path)
    kept.save(MASK, 0)
    if content is not None:
        kept.path.write_bytes(content)
    with caplog.at_level(logging.WARNING):
        assert KeptMask(CAMERA, tmp_path).load(*((128, 96) if content is None else (64, 48))) is None
    assert str(kept.path) in caplog.text
    assert "found anew" in caplog.text


def test_it_is_written_now_and_then_and_at_the_end(tmp_path: Path) -> None:
    kept = KeptMask(CAMERA, tmp_path)
    kept.save(np.zeros_like(MASK), 0)
    assert not kept.path.exists()
    kept.save(MASK, 0)
    more = MASK | np.roll(MASK, 8, 1)
    kept.save(more, 9_999_999)
    np.testing.assert_array_equal(KeptMask(CAMERA, tmp_path).load(64, 48), MASK)
    kept.save(more, 10_000_000)
    np.testing.assert_array_equal(KeptMask(CAMERA, tmp_path).load(64, 48), more)
    gone = np.zeros_like(MASK)
    kept.save(gone, 10_000_001, always=True)
    np.testing.assert_array_equal(KeptMask(CAMERA, tmp_path).load(64, 48), gone)


def test_a_disk_that_refuses_does_not_end_the_flight(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    kept = KeptMask(CAMERA, blocked)
    kept.save(MASK, 0)
    kept.save(~MASK, 20_000_000)
    assert caplog.text.count("cannot be written") == 1


def test_the_pipeline_begins_with_it_and_leaves_what_it_found(tmp_path: Path) -> None:
    camera = CameraSettings(source="/dev/video0", width=64, height=48)
    settings = replace(Settings(), camera=camera)
    first = LivePipeline(settings, lambda output: None, kept_mask=KeptMask(camera, tmp_path))
    assert first._core.fixed is not None
    assert not first._core.fixed.any()
    first._core._pipeline.find_fixed(MASK)
    first.finish()
    second = LivePipeline(settings, lambda output: None, kept_mask=KeptMask(camera, tmp_path))
    np.testing.assert_array_equal(second._core.fixed, MASK)
    np.testing.assert_array_equal(second._core._pipeline.camera.mask, MASK)


def test_it_is_not_used_where_nothing_is_to_be_learnt(tmp_path: Path) -> None:
    camera = CameraSettings(source="/dev/video0", width=64, height=48, learn_mask=False)
    KeptMask(camera, tmp_path).save(MASK, 0)
    settings = replace(Settings(), camera=camera)
    flown = LivePipeline(settings, lambda output: None, kept_mask=KeptMask(camera, tmp_path))
    assert flown._core.fixed is None
    assert flown._core._pipeline.camera.mask is None
    flown.finish()
