"""Records flights: folders of video, stamps, telemetry, calibration, settings and messages that a replay plays back.

All writing is done by one thread, so that a slow card never holds the pipeline up. Twice a second everything written is
forced to the disk, the video before the rows that speak of it, so that a power cut costs less than a second. A folder
that has reached its size is followed by a new one; what stops a recording is tried again until it works.
"""

import shutil
import threading
import time
import uuid
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from drivers.events import DriverEvent
from drivers.files.disk_room import DiskRoom
from drivers.files.flight_writer import MESSAGE_FILES, FlightPapers, FlightWriter, new_folder
from drivers.files.folder_clock import FolderClock, read_clock, set_right, write_clock
from drivers.samples import Frame
from drivers.system.host_clock import now_us

ITEM_BYTES = 500
"""What an item in the queue takes beside its payload."""

SAY_AGAIN_S = 30.0
"""Parts that a slow disk loses are reported at most this often, with their number."""


@dataclass(frozen=True, slots=True)
class RecorderOptions:
    """Where and how much is recorded."""

    directory: Path
    jpeg_quality: int = 95
    rate_hz: float = 30.0
    max_flight_bytes: int = 4_000_000_000
    """Size at which the recording goes on in a new folder."""
    max_total_bytes: int = 0
    """Size of all flight folders together; 0: no limit."""
    delete_oldest: bool = False
    """Whether the oldest flight folders make room, or the recording stops."""
    min_free_bytes: int = 500_000_000
    sync_interval_s: float = 0.5
    max_waiting_bytes: int = 64_000_000
    """What may wait for a slow disk; more is dropped, counted and reported."""
    retry_s: float = 5.0
    """Pause before a recording that stopped by itself is tried again."""


class Recorder:
    """Takes everything at any time, and keeps it between ``start`` and ``stop``.

    None of the methods waits for the disk, except ``close``. A disk that fails or fills up stops the recording with an
    event, and ``stopped`` says why until it goes on by itself; the rest of the program never notices.
    """

    def __init__(self, options: RecorderOptions, papers: FlightPapers) -> None:
        self._options = options
        self._papers = papers
        self._room = _room(options)
        self._work: deque[tuple[int, Callable[[], None]]] = deque()
        self._waiting_bytes = 0
        self._wake = threading.Condition()
        self._wanted = False
        self._closing = False
        self._flight: FlightWriter | None = None
        self._folder: Path | None = None
        self._retry_at = 0.0
        self._process = uuid.uuid4().hex
        self._offset_us, self._date_source = 0, ""
        self._names_due = True
        self.kept_open: Path | None = None
        """A folder that others still write into; it keeps its name until they are done."""
        self._dropped_since, self._said_at = 0, float("-inf")
        self._events: deque[DriverEvent] = deque(maxlen=100)
        self.stopped = ""
        """Why a recording that is wanted does not run; empty while it does."""
        self.counters: Counter[str] = Counter()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def recording(self) -> bool:
        """Whether a recording is wanted and has not stopped by itself."""
        return self._wanted and not self.stopped

    @property
    def folder(self) -> Path | None:
        """The folder of the present recording, or of the last one."""
        return self._folder

    def start(self) -> None:
        """Begin a new flight folder, unless one is being written."""
        if not self._wanted:
            self._wanted = True
            self.stopped = ""
            self._put(self._begin)

    def stop(self, reason: str = "as asked") -> None:
        """End the recording once everything given so far is written."""
        if self._wanted:
            self._wanted = False
            self._put(lambda: self._end(reason))

    def change(self, options: RecorderOptions, papers: FlightPapers) -> None:
        """Other options and papers from now on; a flight that is being written goes on in a new folder."""

        def work() -> None:
            self._options, self._papers = options, papers
            self._room = _room(options)
            if self._wanted:
                self._end("other settings")
                self._begin()

        self._put(work)

    def set_date(self, offset_us: int, source: str) -> None:
        """The date is known: what is to be added to the companion's times, and where it is from."""

        def work() -> None:
            self._offset_us, self._date_source = offset_us, source
            directory = self._options.directory
            for path in directory.iterdir() if directory.is_dir() else ():
                clock = read_clock(path)
                if clock is None or clock.process != self._process:
                    continue
                present = self._flight is not None and path == self._flight.path
                if present or clock.add_us is None:
                    self._note_clock(path, clock)
            self._names_due = True

        self._put(work)

    def frame(self, frame: Frame) -> None:
        """One camera frame."""
        if self.recording:
            self._add(frame.image.nbytes, lambda flight: self._frame(flight, frame))

    def mavlink(self, arrival_us: int, packet: bytes) -> None:
        """One MAVLink packet as it was on the wire, of either direction."""
        if self.recording:
            self._add(len(packet), lambda flight: flight.mavlink(arrival_us, packet))

    def message(self, topic: str, line: bytes) -> None:
        """One published message as a line of JSON without the line's end."""
        if self.recording and topic in MESSAGE_FILES:
            self._add(len(line), lambda flight: flight.message(topic, line))

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

    def _add(self, size: int, write: Callable[[FlightWriter], None]) -> None:
        """Hand something to the flight being written, unless too much waits already."""
        size += ITEM_BYTES
        with self._wake:
            if self._waiting_bytes + size <= self._options.max_waiting_bytes:
                self._waiting_bytes += size
                self._work.append((size, lambda: self._write(write)))
                self._wake.notify()
                return
            self.counters["dropped"] += 1
            self._dropped_since += 1
            now = time.monotonic()
            if now - self._said_at >= SAY_AGAIN_S:
                text = f"the disk is too slow, {self._dropped_since} parts of the recording are lost"
                self._report("recording_behind", "warning", text)
                self._dropped_since, self._said_at = 0, now

    def _put(self, work: Callable[[], None]) -> None:
        with self._wake:
            self._work.append((0, work))
            self._wake.notify()

    def _frame(self, flight: FlightWriter, frame: Frame) -> None:
        if not flight.fits(frame):
            self._go_on("the camera's pictures have another size")
        if self._flight is not None:
            self._flight.frame(frame)

    def _go_on(self, why: str) -> None:
        """Close the present folder and write on in a new one."""
        flight, self._flight = self._flight, None
        if flight is not None:
            flight.close()
        self._open()
        self._report("recording_continued", "info", f"{self._folder}: {why}")

    def _write(self, write: Callable[[FlightWriter], None]) -> None:
        if self._flight is not None:
            write(self._flight)

    def _run(self) -> None:
        """The writing thread."""
        next_sync = time.monotonic()
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._work or self._closing, self._options.sync_interval_s)
                if self._closing and not self._work:
                    break
                size, work = self._work.popleft() if self._work else (0, None)
                self._waiting_bytes -= size
            try:
                if work is not None:
                    work()
                if time.monotonic() >= next_sync:
                    next_sync = time.monotonic() + self._options.sync_interval_s
                    self._sync()
                    self._set_names_right()
            except OSError as error:
                self._fail(error)
        try:
            self._set_names_right()
        except OSError as error:
            self._fail(error)

    def _begin(self) -> None:
        """A new folder, when there is room for one; else why there is none stands in ``stopped``."""
        options = self._options
        options.directory.mkdir(parents=True, exist_ok=True)
        refusal = self._room.refusal(self._folder, 0, new=True)
        self._report_deleted()
        if refusal:
            self._stand_still("recording_refused", "error", f"{options.directory}: {refusal}", refusal)
            return
        self._open()
        self._report("recording_started", "info", str(self._folder))

    def _open(self) -> None:
        began_us = now_us()
        folder = new_folder(self._options.directory, began_us + self._offset_us)
        self._folder = folder
        o = self._options
        try:
            shift_us = self._offset_us
            self._flight = FlightWriter(
                folder, o.jpeg_quality, o.rate_hz, self._papers, self.counters, shift_us
            )
            add_us = 0 if self._date_source else None
            write_clock(folder, FolderClock(began_us + shift_us, add_us, self._date_source, self._process))
        except OSError:
            shutil.rmtree(folder, ignore_errors=True)  # every attempt would leave one
            raise
        self.stopped = ""

    def _end(self, reason: str, severity: str = "info") -> None:
        flight, self._flight = self._flight, None
        if flight is not None:
            flight.close()
            self._report("recording_stopped", severity, f"{flight.path}: {reason}")
            self._names_due = True

    def _note_clock(self, path: Path, clock: FolderClock) -> None:
        """What makes the folder's times true; those of a folder begun with a date carry that one's offset already."""
        flight = self._flight
        shift_us = flight.shift_us if flight is not None and flight.path == path else 0
        add_us = self._offset_us - shift_us
        if add_us != clock.add_us:
            write_clock(path, FolderClock(clock.begun_us, add_us, self._date_source, clock.process))

    def _set_names_right(self) -> None:
        """Folders begun before the date was known get their true names, once nobody writes into them."""
        directory = self._options.directory
        if not self._names_due or not self._date_source or not directory.is_dir():
            return
        busy = {self.kept_open} | ({self._flight.path} if self._flight is not None else set())
        open_now = {path for path in busy if path is not None}
        self._names_due = bool(open_now)
        for old, new in set_right(directory, open_now):
            if self._folder == old:
                self._folder = new
            self._report("recording_renamed", "info", f"{old} is {new.name} now")

    def _sync(self) -> None:
        flight = self._flight
        if flight is None:
            if self._wanted and self.stopped and time.monotonic() >= self._retry_at:
                self._retry_at = time.monotonic() + self._options.retry_s
                self._begin()
            return
        flight.sync()
        refusal = self._room.refusal(flight.path, flight.size)
        self._report_deleted()
        if refusal:
            self._end(refusal, "warning")
            self._stand_still("", "", "", refusal)
        elif flight.size > self._options.max_flight_bytes:
            self._go_on(f"{flight.path.name} is {flight.size // 10**6} MB, record.max_flight_mb")

    def _stand_still(self, event: str, severity: str, text: str, reason: str) -> None:
        """Why nothing is recorded, reported once for each reason, until a later attempt works."""
        if event and reason.partition(",")[0] != self.stopped.partition(",")[0]:
            self._report(event, severity, text)
        self.stopped = reason
        self._retry_at = time.monotonic() + self._options.retry_s

    def _fail(self, error: OSError) -> None:
        flight, self._flight = self._flight, None
        self.counters["failures"] += 1
        where = flight.path if flight is not None else self._options.directory
        reason = error.strerror or str(error)
        text = f"{where}: {reason}; it is tried again every {self._options.retry_s:g} s"
        self._stand_still("recording_failed", "error", text, reason)
        if flight is not None:
            flight.abandon()

    def _report_deleted(self) -> None:
        for path in self._room.deleted():
            self.counters["folders deleted"] += 1
            self._report("recording_deleted", "info", f"{path}: the oldest flight made room for the newest")

    def _report(self, event: str, severity: str, text: str) -> None:
        with self._wake:
            self._events.append(DriverEvent(event, severity, text, now_us()))


def _room(options: RecorderOptions) -> DiskRoom:
    o = options
    return DiskRoom(o.directory, o.max_total_bytes, o.min_free_bytes, o.delete_oldest)
