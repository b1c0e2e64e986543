"""Recordings as cameras: a video, a folder of pictures or a recorded flight, at the pace they were recorded at."""

import csv
import threading
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.cameras.grey import grey_of
from drivers.cameras.interface import Grab
from drivers.errors import DriverError
from drivers.host_clock import now_us

PICTURES = (".png", ".jpg", ".jpeg", ".pgm", ".bmp", ".tif", ".tiff")
DEFAULT_RATE_HZ = 30.0
"""Pace of pictures that carry no times."""


class FileGrabber:
    """Plays a recording: the first frame now, every other one as much later as it was recorded."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._frames: Iterator[tuple[int, NDArray[np.uint8]]] = iter(())
        self._start_us: int | None = None
        self._wait = threading.Event()

    def open(self) -> None:
        """Find the pictures; raises DriverError when there are none."""
        path = self._path
        if path.is_file():
            self._frames = _video(
                path, _stamps(path.with_name("frames.csv")) if path.stem == "camera" else None
            )
        elif (path / "camera.mkv").is_file():
            self._frames = _video(path / "camera.mkv", _stamps(path / "frames.csv"))
        else:
            pictures = sorted(p for p in path.iterdir() if p.suffix.lower() in PICTURES)
            if not pictures:
                raise DriverError(
                    f"{path}: neither a flight (camera.mkv) nor pictures ({', '.join(PICTURES)})"
                )
            self._frames = _pictures(pictures, _stamps(path / "frames.csv"))

    def grab(self) -> Grab | None:
        """The next frame, when its time has come."""
        following = next(self._frames, None)
        if following is None:
            return None
        at_us, image = following
        if self._start_us is None:
            self._start_us = now_us() - at_us
        due_us = self._start_us + at_us
        self._wait.wait(max(0, due_us - now_us()) * 1e-6)
        return Grab(image, due_us)

    def close(self) -> None:
        """Let the file go."""
        self._frames = iter(())


def _stamps(path: Path) -> list[int] | None:
    """The capture times of a frames.csv, in microseconds; None when there is no such file."""
    if not path.is_file():
        return None
    try:
        with path.open(newline="") as file:
            stamps = [int(row["host_time_us"]) for row in csv.DictReader(file)]
    except (KeyError, TypeError, ValueError) as error:
        raise DriverError(f"{path}: not a table with the columns frame,host_time_us: {error}") from error
    if any(later <= earlier for earlier, later in pairwise(stamps)):
        raise DriverError(f"{path}: its times do not rise, so the pace is unknown")
    return stamps


def _video(path: Path, stamps: list[int] | None) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
    try:
        if not capture.isOpened():
            raise DriverError(f"{path}: not a video that FFmpeg reads")
        number = 0
        while stamps is None or number < len(stamps):
            taken, image = capture.read()
            if not taken:
                return
            at_us = round(capture.get(cv2.CAP_PROP_POS_MSEC) * 1000) if stamps is None else stamps[number]
            yield at_us, grey_of(image)
            number += 1
    finally:
        capture.release()


def _pictures(paths: list[Path], stamps: list[int] | None) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    if stamps is not None and len(stamps) != len(paths):
        raise DriverError(f"{paths[0].parent}: {len(paths)} pictures, but {len(stamps)} times in frames.csv")
    for number, path in enumerate(paths):
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise DriverError(f"{path}: not a picture")
        at_us = round(number * 1e6 / DEFAULT_RATE_HZ) if stamps is None else stamps[number]
        yield at_us, grey_of(image)
