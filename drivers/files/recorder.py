"""Records flights: folders of video, stamps, telemetry, calibration, settings and messages that a replay plays back.

All writing is done by one thread, so that a slow card never holds the pipeline up. Twice a second everything written is
forced to the disk, the video before the rows that speak of it, so that a power cut costs less than a second.
"""

import os
import shutil
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO

import cv2

from drivers.events import DriverEvent
from drivers.files.flight_folder import CALIBRATION, SETTINGS, STAMPS, TELEMETRY, VIDEO
from drivers.files.matroska import JpegMatroska
from drivers.samples import Frame
from drivers.system.host_clock import now_us

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
class RecorderOptions:
    """Where and how much is recorded."""

    directory: Path
    jpeg_quality: int = 95
    rate_hz: float = 30.0
    max_flight_bytes: int = 4_000_000_000
    min_free_bytes: int = 500_000_000
    sync_interval_s: float = 0.5
    max_waiting: int = 2000
    """Items that may wait for a slow disk; more are dropped, counted and told."""


@dataclass(frozen=True, slots=True)
class FlightPapers:
    """What goes into a folder once: the settings in force as TOML, and the calibration file's content."""

    settings: str
    calibration: str = ""


class Recorder:
    """Takes everything at any time, and keeps it between ``start`` and ``stop``.

    None of the methods waits for the disk, except ``close``. A disk that fails or fills up ends the recording with an
    event; the rest of the program never notices.
    """

    def __init__(self, options: RecorderOptions, papers: FlightPapers) -> None:
        self._options = options
        self._papers = papers
        self._work: deque[Callable[[], None]] = deque()
        self._wake = threading.Condition()
        self._wanted = False
        self._closing = False
        self._flight: _Flight | None = None
        self._folder: Path | None = None
        self._events: deque[DriverEvent] = deque(maxlen=100)
        self.counters: Counter[str] = Counter()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def recording(self) -> bool:
        """Whether a recording is wanted and has not ended by itself."""
        return self._wanted

    @property
    def folder(self) -> Path | None:
        """The folder of the present recording, or of the last one."""
        return self._folder

    def start(self) -> None:
        """Begin a new flight folder, unless one is being written."""
        if not self._wanted:
            self._wanted = True
            self._put(self._begin)

    def stop(self, reason: str = "as asked") -> None:
        """End the recording once everything given so far is written."""
        if self._wanted:
            self._wanted = False
            self._put(lambda: self._end(reason))

    def frame(self, frame: Frame) -> None:
        """One camera frame."""
        if self._wanted:
            self._add(lambda flight: flight.frame(frame))

    def mavlink(self, arrival_us: int, packet: bytes) -> None:
        """One MAVLink packet as it was on the wire, of either direction."""
        if self._wanted:
            self._add(lambda flight: flight.mavlink(arrival_us, packet))

    def message(self, topic: str, line: bytes) -> None:
        """One published message as a line of JSON without the line's end."""
        if self._wanted and topic in MESSAGE_FILES:
            self._add(lambda flight: flight.message(topic, line))

    def events(self) -> list[DriverEvent]:
        """What happened since the last call."""
        with self._wake:
            events = list(self._events)
            self._events.clear()
            return events

    def close(self, patience_s: float = 5.0) -> None:
        """Write what waits, close the files; gives up after ``patience_s``, the files stay readable."""
        self.stop("the program ends")
        with self._wake:
            self._closing = True
            self._wake.notify()
        self._thread.join(patience_s)

    def _add(self, write: Callable[["_Flight"], None]) -> None:
        """Hand something to the flight being written, unless too much waits already."""
        with self._wake:
            if len(self._work) < self._options.max_waiting:
                self._work.append(lambda: self._write(write))
                self._wake.notify()
                return
            self.counters["dropped"] += 1
            if self.counters["dropped"] == 1:
                self._tell(
                    "recording_behind", "warning", "the disk is too slow, parts of the recording are lost"
                )

    def _put(self, work: Callable[[], None]) -> None:
        with self._wake:
            self._work.append(work)
            self._wake.notify()

    def _write(self, write: Callable[["_Flight"], None]) -> None:
        if self._flight is not None:
            write(self._flight)

    def _run(self) -> None:
        """The writing thread."""
        next_sync = time.monotonic()
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._work or self._closing, self._options.sync_interval_s)
                if self._closing and not self._work:
                    return
                work = self._work.popleft() if self._work else None
            try:
                if work is not None:
                    work()
                if time.monotonic() >= next_sync:
                    next_sync = time.monotonic() + self._options.sync_interval_s
                    self._sync()
            except OSError as error:
                self._fail(error)

    def _begin(self) -> None:
        options = self._options
        options.directory.mkdir(parents=True, exist_ok=True)
        free = shutil.disk_usage(options.directory).free
        if free < options.min_free_bytes:
            self._wanted = False
            text = f"{options.directory}: {free // 10**6} MB free, less than record.min_free_mb; nothing is recorded"
            self._tell("recording_refused", "error", text)
            return
        self._flight = _Flight(_new_folder(options.directory), options, self._papers, self.counters)
        self._folder = self._flight.path
        self._tell("recording_started", "info", str(self._flight.path))

    def _end(self, reason: str, severity: str = "info") -> None:
        flight, self._flight = self._flight, None
        if flight is not None:
            flight.close()
            self._tell("recording_stopped", severity, f"{flight.path}: {reason}")

    def _sync(self) -> None:
        flight, options = self._flight, self._options
        if flight is None:
            return
        flight.sync()
        free = shutil.disk_usage(flight.path).free
        if flight.size > options.max_flight_bytes:
            reason = f"{flight.size // 10**6} MB written, record.max_flight_mb allows no more"
        elif free < options.min_free_bytes:
            reason = f"{free // 10**6} MB left on the disk, record.min_free_mb keeps them"
        else:
            return
        self._wanted = False
        self._end(reason, "warning")

    def _fail(self, error: OSError) -> None:
        self._wanted = False
        flight, self._flight = self._flight, None
        self.counters["failures"] += 1
        where = flight.path if flight is not None else self._options.directory
        self._tell(
            "recording_failed", "error", f"{where}: {error.strerror or error}; the recording ends here"
        )
        if flight is not None:
            flight.abandon()

    def _tell(self, event: str, severity: str, text: str) -> None:
        with self._wake:
            self._events.append(DriverEvent(event, severity, text, now_us()))


class _Flight:
    """The files of one flight folder; raises OSError when the disk does."""

    def __init__(
        self, path: Path, options: RecorderOptions, papers: FlightPapers, counters: Counter[str]
    ) -> None:
        self.path = path
        self.size = 0
        self._options = options
        self._counters = counters
        self._files: dict[str, BinaryIO] = {}
        self._video: JpegMatroska | None = None
        self._rows = [STAMPS_HEADER]
        self._created = False
        self._changed: set[str] = set()
        self._put(SETTINGS, papers.settings.encode())
        if papers.calibration:
            self._put(CALIBRATION, papers.calibration.encode())
        self._put(TELEMETRY, b"")
        self.sync()

    def frame(self, frame: Frame) -> None:
        quality = [cv2.IMWRITE_JPEG_QUALITY, self._options.jpeg_quality]
        jpeg = cv2.imencode(".jpg", frame.image, quality)[1].tobytes()
        if self._video is None:
            height, width = frame.image.shape
            self._video = JpegMatroska(self._file(VIDEO), width, height, self._options.rate_hz)
        index = self._video.write(jpeg)
        self._note(VIDEO, len(jpeg))
        self._rows.append(b"%d,%d,%d,%d\n" % (index, frame.stamp_us, frame.arrival_us, frame.number))
        self._counters["frames"] += 1

    def mavlink(self, arrival_us: int, packet: bytes) -> None:
        self._put(TELEMETRY, arrival_us.to_bytes(8, "big") + packet)
        self._counters["packets"] += 1

    def message(self, topic: str, line: bytes) -> None:
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


def _new_folder(directory: Path) -> Path:
    """A folder named by the time (UTC) that does not exist yet; a clock set back finds its names taken."""
    name = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
    number = 1
    while True:
        path = directory / (name if number == 1 else f"{name}-{number}")
        try:
            path.mkdir()
        except FileExistsError:
            number += 1
            continue
        _force_directory(directory)
        return path


def _force(file: BinaryIO) -> None:
    file.flush()
    os.fsync(file.fileno())


def _force_directory(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
