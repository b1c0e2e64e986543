"""Videos that browsers play: by the ffmpeg program, and by OpenCV without it."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import DriverError
from drivers.files import video_writer
from drivers.files.video_writer import check_video_name, open_video

PICTURES = [np.full((48, 64, 3), (level, 128, 255 - level), np.uint8) for level in range(0, 200, 10)]


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="needs ffmpeg")
@pytest.mark.parametrize("name", ["a.webm", "a.mp4"])
def test_ffmpeg_writes_vp9(tmp_path: Path, name: str):
    writer = open_video(tmp_path / name, 30.0, 64, 48)
    for picture in PICTURES:
        writer.write(picture)
    writer.close()
    data = (tmp_path / name).read_bytes()
    assert (b"V_VP9" if name.endswith("webm") else b"vp09") in data


def test_without_ffmpeg_opencv_writes_vp8(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(video_writer.shutil, "which", lambda name: None)
    writer = open_video(tmp_path / "a.webm", 30.0, 64, 48)
    for picture in PICTURES:
        writer.write(picture)
    writer.close()
    assert b"V_VP8" in (tmp_path / "a.webm").read_bytes()
    with pytest.raises(DriverError, match=r"apt install ffmpeg, or give a name that ends in \.webm"):
        check_video_name(tmp_path / "a.mp4")


def test_a_name_that_no_browser_would_play_is_refused(tmp_path: Path):
    with pytest.raises(DriverError, match=r"must end in \.webm or \.mp4, not '\.avi'"):
        check_video_name(tmp_path / "a.avi")


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="needs ffmpeg")
def test_a_file_that_cannot_be_written_is_an_error_with_its_reason(tmp_path: Path):
    writer = open_video(tmp_path / "absent" / "a.webm", 30.0, 64, 48)

    def all_of_it() -> None:
        for picture in PICTURES * 20:
            writer.write(picture)
        writer.close()

    with pytest.raises(DriverError, match="No such file"):
        all_of_it()
