"""Grey frames out of a video file or a folder of images, decoded one at a time."""

import os
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from cv2.utils import logging as cv2_logging
from numpy.typing import NDArray

from drivers.errors import DriverError
from drivers.samples import Frame, Refusal

# FFmpeg and OpenCV write a line to stderr for every damaged packet; damage is counted and reported here instead.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
cv2_logging.setLogLevel(cv2_logging.LOG_LEVEL_ERROR)

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".webp"})

PLANAR_LUMA = frozenset(
    {"I420", "YV12", "IYUV", "NV12", "NV21", "Y42B", "422P", "444P", "J420", "GREY", "Y800"}
)
"""Pixel formats whose first plane is the luma: it is the grey picture, without a detour over colours."""

INDEX_TOLERANCE = 0.35
"""Share of a frame's period that presentation times may stray from a constant rate and still count frames."""

DEFAULT_FPS = 30.0

Image = NDArray[np.uint8]


class VideoFile:
    """A video file; opening reads its header alone.

    ``width``, ``height`` in pixels, ``fps`` as the container says (0: it does not), ``frame_count`` as the
    container estimates it. Raises DriverError if there is no video in the file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
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
        """Index in the recording and grey image (height, width) of every frame that can be decoded.

        The index counts frames; where the file has a constant rate, frames lost to damage leave a gap in it,
        found by the presentation times.
        """
        capture = self._open()
        fourcc = int(capture.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)) & 0xFFFFFFFF
        luma = fourcc.to_bytes(4, "little").decode("latin-1") in PLANAR_LUMA
        if luma:
            capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        counted, lost, first_ms, constant_rate = 0, 0, None, self.fps > 0
        while capture.grab():
            decoded, image = capture.retrieve()
            if not decoded:
                break
            if image.ndim == 3:
                image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
            pts_ms = capture.get(cv2.CAP_PROP_POS_MSEC)
            first_ms = pts_ms if first_ms is None else first_ms
            index = (pts_ms - first_ms) * self.fps / 1000
            constant_rate = constant_rate and abs(index - round(index)) < INDEX_TOLERANCE
            if constant_rate and round(index) > counted + lost:
                lost = round(index) - counted
            yield counted + lost, np.asarray(image, np.uint8)
            counted += 1
        capture.release()

    def frames(self, fps: float | None = None, start_us: int = 0) -> Iterator[Frame | Refusal]:
        """Frames stamped by ``fps`` (default: the file's own, else 30 a second) from ``start_us`` on."""
        period_us = 1e6 / (fps or self.fps or DEFAULT_FPS)
        index = -1
        for index, image in self._with_losses():
            stamp_us = start_us + round(index * period_us)
            if image is None:
                yield Refusal(stamp_us, "camera", "undecodable_frame", f"{self.path.name}, frame {index}")
                continue
            yield Frame(index, stamp_us, stamp_us, image)
        if index < 0:
            raise DriverError(f"{self.path}: not a single frame can be decoded; record or copy it anew")
        if index + 1 < self.frame_count:
            # The container's count is an estimate, so that a short file is one remark, not a row of losses.
            missing = self.frame_count - index - 1
            yield Refusal(
                start_us + round(index * period_us),
                "camera",
                "video_cut_off",
                f"{self.path.name} ends {missing} frames early",
            )

    def _with_losses(self) -> Iterator[tuple[int, Image | None]]:
        """As images(), with None for every frame that damage took out of the middle."""
        due = 0
        for index, image in self.images():
            yield from ((lost, None) for lost in range(due, index))
            yield index, image
            due = index + 1

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
                yield Refusal(stamp_us, "camera", "undecodable_image", str(file))
            elif image.shape != (self.height, self.width):
                detail = f"{file}: {image.shape[1]} x {image.shape[0]}, not {self.width} x {self.height}"
                yield Refusal(stamp_us, "camera", "image_size", detail)
            else:
                yield Frame(index, stamp_us, stamp_us, image)


def open_pictures(path: Path) -> VideoFile | ImageFolder:
    """A video file or a folder of images, whichever the path is."""
    if not path.exists():
        raise DriverError(f"{path}: there is no such file or folder; check the path")
    return ImageFolder(path) if path.is_dir() else VideoFile(path)


def _read_grey(file: Path) -> Image | None:
    image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
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
