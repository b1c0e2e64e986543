"""Recordings as cameras: a video, a folder of pictures or a recorded flight, at the pace they were recorded at."""

import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.cameras.grey import grey_of
from drivers.cameras.interface import Grab
from drivers.files.flight_folder import STAMPS, VIDEO
from drivers.files.frame_table import read_frame_table
from drivers.files.video_file import VideoFile, open_pictures
from drivers.samples import Frame
from drivers.system.host_clock import now_us

TimedImage = tuple[int, NDArray[np.uint8]]


class FileGrabber:
    """Plays a recording: the first frame now, every other one as much later as it was recorded."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._images: Iterator[TimedImage] = iter(())
        self._start_us: int | None = None
        self._pause = threading.Event()

    def open(self) -> None:
        """Find the pictures; raises DriverError when there are none."""
        flight = (self._path / VIDEO).is_file()
        self._images = _of_flight(self._path) if flight else _of_pictures(self._path)

    def grab(self) -> Grab | None:
        """The next frame, when its time has come."""
        following = next(self._images, None)
        if following is None:
            return None
        at_us, image = following
        if self._start_us is None:
            self._start_us = now_us() - at_us
        due_us = self._start_us + at_us
        self._pause.wait(max(0, due_us - now_us()) * 1e-6)
        return Grab(grey_of(image), due_us)

    def close(self) -> None:
        """Let the file go."""
        self._images = iter(())


def _of_flight(path: Path) -> Iterator[TimedImage]:
    rows = read_frame_table(path / STAMPS).rows
    for index, image in VideoFile(path / VIDEO).images():
        if index in rows:
            yield rows[index].order_us, image


def _of_pictures(path: Path) -> Iterator[TimedImage]:
    for sample in open_pictures(path).frames():
        if isinstance(sample, Frame):
            yield sample.stamp_us, sample.image
