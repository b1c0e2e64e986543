"""Grey frames out of a video file or a folder of images, decoded one at a time."""

import os
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from cv2.utils import logging as cv2_logging
from numpy.typing import NDArray

from drivers.errors import DriverError
from drivers.refusals import RefusalCode
from drivers.samples import Frame, Refusal

# FFmpeg and OpenCV write a line to stderr for every damaged packet; damage is counted and reported here instead.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
cv2_logging.setLogLevel(cv2_logging.LOG_LEVEL_ERROR)

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".webp"})

PLANAR_LUMA = frozenset(
    {"I420", "YV12", "IYUV", "NV12", "NV21", "Y42B", "422P", "444P", "J420", "GREY", "Y800"}
)
"""Pixel formats whose first plane is the luma: it is the grey picture, without a detour over colours."""

DEFAULT_FPS = 30.0

Image = NDArray[np.uint8]


class VideoFile:
    """A video file; opening reads its header alone.

    ``width``, ``height`` in pixels, ``fps`` as the container says (0: it does not), ``frame_count`` as the
    container estimates it. Raises DriverError if there is no video in the file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        if not is_text(path):
            raise DriverError(f"{str(path)!a}: its name is not UTF-8, which OpenCV cannot open; rename it")
        if not path.is_file():
            raise DriverError(f"{path}: there is no such video file; check the path")
        if path.stat().st_size == 0:
            raise DriverError(f"{path}: the video file is empty; record it again or copy it anew")
        capture = self._open()
        self.width = int(capture.get(cv2.CAP_PROP_FRAME_WIDTH))
        self.height = int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        self.fps = float(capture.get(cv2.CAP_PROP_FPS))
        self.frame_count = max(0, int(capture.get(cv2.CAP_PROP_FRAME_COUNT)))
        capture.release()

    def images(self) -> Iterator[tuple[int, Image]]:
        """Count and grey image (height, width) of every frame that can be decoded."""
        for index, (_, image) in enumerate(self.timed_images()):
            yield index, image

    def timed_images(self) -> Iterator[tuple[float, Image]]:
        """Presentation time in s since the first frame, and grey image, of every frame that can be decoded.

        Frames that damage took out leave a gap in the times. Where the file has no times, the frame rate gives them.
        """
        capture = self._open()
        fourcc = int(capture.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)) & 0xFFFFFFFF
        if fourcc.to_bytes(4, "little").decode("latin-1") in PLANAR_LUMA:
            capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        period_s = 1 / (self.fps or DEFAULT_FPS)
        first_s, last_s = None, -period_s
        while capture.grab():
            decoded, image = capture.retrieve()
            if not decoded:
                break
            if image.ndim == 3:
                image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
            at_s = capture.get(cv2.CAP_PROP_POS_MSEC) * 1e-3
            first_s = at_s if first_s is None else first_s
            time_s = at_s - first_s
            last_s = time_s if time_s > last_s else last_s + period_s
            yield last_s, np.asarray(image, np.uint8)
        capture.release()

    def count(self) -> int:
        """How many frames can be decoded; reads the whole file."""
        capture, count = self._open(), 0
        while capture.grab():
            count += 1
        capture.release()
        return count

    def frames(self, fps: float | None = None, start_us: int = 0) -> Iterator[Frame | Refusal]:
        """Frames stamped by their presentation times from ``start_us`` on; ``fps`` plays the file at another rate."""
        speed = self.fps / fps if fps and self.fps else 1.0
        number, stamp_us = -1, start_us
        for number, (time_s, image) in enumerate(self.timed_images()):
            if fps and not self.fps:
                time_s = number / fps
            stamp_us = start_us + round(time_s * speed * 1e6)
            yield Frame(number, stamp_us, stamp_us, image)
        if number < 0:
            raise DriverError(f"{self.path}: not a single frame can be decoded; record or copy it anew")
        missing = self.frame_count - number - 1
        if missing > 0:
            # The container's count is an estimate, so that a short file is one remark, not a row of losses.
            detail = f"{missing} of {self.frame_count} frames of {self.path.name} could not be read"
            yield Refusal(stamp_us, "camera", RefusalCode.UNDECODABLE_FRAME, detail)

    def _open(self) -> cv2.VideoCapture:
        capture = cv2.VideoCapture(str(self.path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
        if not capture.isOpened():
            raise DriverError(f"{self.path}: no video can be read from it; record it again or copy it anew")
        return capture


class ImageFolder:
    """A folder of images in the order of their names (numbers in them by value)."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.files = sorted(
            (f for f in path.iterdir() if f.suffix.lower() in IMAGE_SUFFIXES), key=lambda f: _natural(f.name)
        )
        if not self.files:
            raise DriverError(f"{path}: no images in it ({', '.join(sorted(IMAGE_SUFFIXES))})")
        first = next((i for i in map(_read_grey, self.files) if i is not None), None)
        if first is None:
            raise DriverError(f"{path}: none of its {len(self.files)} images can be decoded")
        self.height, self.width = first.shape
        self.fps = 0.0
        self.frame_count = len(self.files)

    def frames(self, fps: float | None = None, start_us: int = 0) -> Iterator[Frame | Refusal]:
        """Frames stamped by ``fps`` (default 30 a second); an image that cannot be read is refused."""
        period_us = 1e6 / (fps or DEFAULT_FPS)
        for index, file in enumerate(self.files):
            stamp_us = start_us + round(index * period_us)
            image = _read_grey(file)
            if image is None:
                yield Refusal(stamp_us, "camera", RefusalCode.UNDECODABLE_FRAME, ascii(str(file))[1:-1])
            elif image.shape != (self.height, self.width):
                detail = f"{file}: {image.shape[1]} x {image.shape[0]}, not {self.width} x {self.height}"
                yield Refusal(stamp_us, "camera", RefusalCode.IMAGE_SIZE, detail)
            else:
                yield Frame(index, stamp_us, stamp_us, image)


def named_images(path: Path) -> Iterator[tuple[str, Image | None]]:
    """Name and grey image, of any size, of each picture of a video, a recorded flight or a folder of images."""
    if path.is_dir() and not (path / "camera.mkv").is_file():
        for file in ImageFolder(path).files:
            yield ascii(file.name)[1:-1], _read_grey(file)
        return
    source = VideoFile(path / "camera.mkv" if path.is_dir() else path)
    for number, image in source.images():
        yield f"frame {number}", image


def open_pictures(path: Path) -> VideoFile | ImageFolder:
    """A video file or a folder of images, whichever the path is."""
    if not path.exists():
        raise DriverError(f"{path}: there is no such file or folder; check the path")
    return ImageFolder(path) if path.is_dir() else VideoFile(path)


def is_text(path: Path) -> bool:
    """Whether a path is valid UTF-8; OpenCV ends the process on one that is not."""
    return not any("\ud800" <= letter <= "\udfff" for letter in str(path))


def _read_grey(file: Path) -> Image | None:
    if not is_text(file):
        return None
    # as the sensor gave it: turned by a camera's orientation tag it would be the picture of another camera
    image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
    return None if image is None else np.asarray(image, np.uint8)


def _natural(name: str) -> tuple[tuple[int, int, str], ...]:
    """A sorting key by which image2 comes before image10."""
    parts: list[tuple[int, int, str]] = []
    digits = ""
    for letter in name + "\0":
        if letter.isdecimal():
            digits += letter
            continue
        if digits:
            parts.append((0, int(digits), ""))
            digits = ""
        parts.append((1, 0, letter))
    return tuple(parts)
