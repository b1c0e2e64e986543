"""The files of one flight folder, and the folder itself: what is written survives a power cut."""

import os
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import cv2

from drivers.files.flight_folder import CALIBRATION, SETTINGS, STAMPS, TELEMETRY, VIDEO
from drivers.files.folder_clock import folder_name, free_names
from drivers.files.matroska import JpegMatroska
from drivers.samples import Frame

MESSAGE_FILES = {
    "estimate": "estimates.jsonl",
    "decision": "decisions.jsonl",
    "health": "health.jsonl",
    "event": "events.jsonl",
}
"""Topic -> file of a flight folder, one JSON object a line."""

STAMPS_HEADER = b"frame,host_time_us,arrival_us,number\n"
"""Index in the video, capture, arrival, and the number under which the frame appears in the messages."""


@dataclass(frozen=True, slots=True)
class FlightPapers:
    """What goes into a folder once: the settings in force as TOML, and the calibration file's content."""

    settings: str
    calibration: str = ""


class FlightWriter:
    """The files of one flight folder; raises OSError when the disk does."""

    def __init__(
        self,
        path: Path,
        jpeg_quality: int,
        rate_hz: float,
        papers: FlightPapers,
        counters: Counter[str],
        shift_us: int = 0,
    ) -> None:
        """``shift_us``: what is added to every stamp, the same in all of the folder."""
        self.path = path
        self.size = 0
        self.shift_us = shift_us
        self._jpeg_quality, self._rate_hz = jpeg_quality, rate_hz
        self._counters = counters
        self._files: dict[str, BinaryIO] = {}
        self._video: JpegMatroska | None = None
        self._shape: tuple[int, ...] | None = None
        self._rows = [STAMPS_HEADER]
        self._created = False
        self._changed: set[str] = set()
        self._put(SETTINGS, papers.settings.encode())
        if papers.calibration:
            self._put(CALIBRATION, papers.calibration.encode())
        self._put(TELEMETRY, b"")
        self.sync()

    def fits(self, frame: Frame) -> bool:
        """Whether the frame has the size of the video; a video holds one size alone."""
        return self._shape in (None, frame.image.shape)

    def frame(self, frame: Frame) -> None:
        """Append a frame; its row follows at the next ``sync``."""
        quality = [cv2.IMWRITE_JPEG_QUALITY, self._jpeg_quality]
        jpeg = cv2.imencode(".jpg", frame.image, quality)[1].tobytes()
        if self._video is None:
            self._shape = frame.image.shape
            height, width = frame.image.shape
            self._video = JpegMatroska(self._file(VIDEO), width, height, self._rate_hz)
        index = self._video.write(jpeg)
        self._note(VIDEO, len(jpeg))
        stamp_us, arrival_us = frame.stamp_us + self.shift_us, frame.arrival_us + self.shift_us
        self._rows.append(b"%d,%d,%d,%d\n" % (index, stamp_us, arrival_us, frame.number))
        self._counters["frames"] += 1

    def mavlink(self, arrival_us: int, packet: bytes) -> None:
        """Append a packet with its arrival."""
        self._put(TELEMETRY, (arrival_us + self.shift_us).to_bytes(8, "big") + packet)
        self._counters["packets"] += 1

    def message(self, topic: str, line: bytes) -> None:
        """Append a message to its topic's file."""
        self._put(MESSAGE_FILES[topic], line + b"\n")
        self._counters["messages"] += 1

    def sync(self) -> None:
        """Force everything to the disk; the rows of frames.csv only after the frames they speak of."""
        self._force_changed()
        if self._rows:
            self._put(STAMPS, b"".join(self._rows))
            self._rows.clear()
            self._force_changed()
        if self._created:
            self._created = False
            _force_directory(self.path)

    def close(self) -> None:
        """Force everything to the disk and let the files go."""
        self.sync()
        for file in self._files.values():
            file.close()
        self._files.clear()

    def abandon(self) -> None:
        """Let all files go, whatever they still hold."""
        for file in self._files.values():
            try:
                file.close()
            except OSError:
                self._counters["failures"] += 1
        self._files.clear()

    def _force_changed(self) -> None:
        for name in sorted(self._changed):
            _force(self._files[name])
        self._changed.clear()

    def _file(self, name: str) -> BinaryIO:
        if name not in self._files:
            self._created = True
            self._files[name] = (self.path / name).open("wb")
        return self._files[name]

    def _put(self, name: str, data: bytes) -> None:
        self._file(name).write(data)
        self._note(name, len(data))

    def _note(self, name: str, length: int) -> None:
        self.size += length
        self._changed.add(name)


def new_folder(directory: Path, unix_us: int) -> Path:
    """A folder named by the time (UTC) that does not exist yet; a clock set back finds its names taken."""
    for path in free_names(directory, folder_name(unix_us)):
        try:
            path.mkdir()
        except FileExistsError:
            continue
        _force_directory(directory)
        return path
    raise AssertionError("there is always another name")


def _force(file: BinaryIO) -> None:
    file.flush()
    os.fsync(file.fileno())


def _force_directory(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
