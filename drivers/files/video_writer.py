"""A video that browsers play: VP9 by the ffmpeg program, or VP8 by OpenCV where that program is not installed."""

import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import IO, Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.errors import DriverError

Image = NDArray[np.uint8]
FFMPEG = "ffmpeg"
ENDINGS = (".webm", ".mp4")
QUALITY = 36
"""Constant quality of libvpx-vp9 (0 to 63, lower is better): small text stays legible."""
KEY_EVERY_FRAMES = 60
"""A browser seeks to key frames: one every two seconds at 30 Hz."""
SPEED = 8
"""cpu-used of libvpx: the fastest."""


class VideoWriter(Protocol):
    """Takes pictures (height, width, 3) BGR uint8 of one size, in order."""

    def write(self, picture: Image) -> None:
        """Add one picture. Raises DriverError when the file cannot be written."""

    def close(self) -> None:
        """Finish the file; raises DriverError as ``write`` does."""


def check_video_name(path: Path) -> None:
    """Raise DriverError unless a browser would play a video of that name, written on this machine."""
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise DriverError(f"{path}: a video's name must end in {' or '.join(ENDINGS)}, not '{path.suffix}'")
    if ending == ".mp4" and shutil.which(FFMPEG) is None:
        raise DriverError(
            f"{path}: an .mp4 needs the program ffmpeg, which is not installed: "
            "apt install ffmpeg, or give a name that ends in .webm"
        )


def open_video(path: Path, fps: float, width: int, height: int) -> VideoWriter:
    """A writer for ``path`` (.webm or .mp4) at ``fps`` pictures a second. Raises DriverError."""
    check_video_name(path)
    if shutil.which(FFMPEG) is None:
        return _OpenCvWriter(path, fps, width, height)
    return _FfmpegWriter(path, fps, width, height)


class _FfmpegWriter:
    """Raw pictures through a pipe into ffmpeg."""

    def __init__(self, path: Path, fps: float, width: int, height: int) -> None:
        self._path = path
        self._errors: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the process
        command = [FFMPEG, "-loglevel", "error", "-nostdin", "-y"]
        command += [
            "-f",
            "rawvideo",
            "-pix_fmt",
            "bgr24",
            "-s",
            f"{width}x{height}",
            "-r",
            f"{fps:.6g}",
            "-i",
            "-",
        ]
        command += ["-an", "-c:v", "libvpx-vp9", "-deadline", "realtime", "-cpu-used", str(SPEED)]
        command += ["-crf", str(QUALITY), "-b:v", "0", "-g", str(KEY_EVERY_FRAMES), "-pix_fmt", "yuv420p"]
        command += ["-movflags", "+faststart"] if path.suffix.lower() == ".mp4" else []
        self._process: subprocess.Popen[bytes] = subprocess.Popen(
            [*command, f"file:{path}"], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=self._errors
        )

    def write(self, picture: Image) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(np.ascontiguousarray(picture).data)
        except OSError:
            self._process.wait()
            raise self._error() from None

    def close(self) -> None:
        try:
            self._process.communicate()
            if self._process.returncode != 0:
                raise self._error()
        finally:
            self._errors.close()

    def _error(self) -> DriverError:
        self._errors.seek(0)
        said = self._errors.read().decode("utf-8", "replace").strip().splitlines()
        return DriverError(
            f"{self._path}: ffmpeg could not write the video: {said[-1] if said else 'no reason given'}"
        )


class _OpenCvWriter:
    """OpenCV's own encoder: slower, and the file larger."""

    def __init__(self, path: Path, fps: float, width: int, height: int) -> None:
        fourcc: Any = cv2.VideoWriter.fourcc(*"VP80")
        self._writer = cv2.VideoWriter(str(path), fourcc, fps, (width, height))
        if not self._writer.isOpened():
            raise DriverError(f"{path}: a video of {width} x {height} cannot be written there")

    def write(self, picture: Image) -> None:
        self._writer.write(picture)

    def close(self) -> None:
        self._writer.release()
