"""An MCAP file beside the flight folder that the daemon records, written by a thread of its own."""

import logging
import queue
import threading
from pathlib import Path

from companion.core.camera_model import camera_model
from companion.core.core import Output, Processed
from companion.errors import LandslopeError
from companion.export.mcap_sink import McapSink
from companion.settings.settings import Settings
from drivers.samples import Attitude, Sample, Velocity

log = logging.getLogger(__name__)

STEM = "flight"
FILE = f"{STEM}.mcap"
QUEUE_LENGTH = 256
"""About eight seconds of frames with their messages; what does not fit is dropped and counted."""
CLOSE_PATIENCE_S = 10.0


class LiveMcap:
    """Takes outputs and samples at any time and writes them while a flight folder is set.

    Never waits and never raises: a disk that fails ends the file, and the flight goes on without it.
    """

    def __init__(self, settings: Settings) -> None:
        self.dropped = 0
        self._settings = settings
        self._queue: queue.Queue[Output | Sample | tuple[Path | None, str]] = queue.Queue(QUEUE_LENGTH)
        self._folder: Path | None = None
        self._part = self._part_begun = 0
        self._pending: Path | None = None
        self.open: Path | None = None
        """The folder that a file is being written in."""
        self._sink: McapSink | None = None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="mcap", daemon=True)
        self._thread.start()

    def follow(self, folder: Path | None) -> None:
        """Record into that flight folder from now on; None ends the file."""
        if folder != self._folder:
            self._part = 0
        if (folder, self._part) != (self._folder, self._part_begun):
            name = FILE if self._part == 0 else f"{STEM}_{self._part + 1}.mcap"
            try:
                self._queue.put_nowait((folder, name))
            except queue.Full:
                return  # the next call tries again
            self._folder, self._part_begun = folder, self._part
            self.open = folder or self.open

    def begin_anew(self) -> None:
        """Go on in another file of the same folder, soon: the times of what follows step."""
        self._part += 1

    def sample(self, sample: Sample) -> None:
        """Heading and position."""
        if self._folder is not None and isinstance(sample, Attitude | Velocity):
            self._put(sample)

    def put(self, output: Output) -> None:
        """One output of the core."""
        if self._folder is not None:
            self._put(output)

    def close(self) -> None:
        """Complete the file."""
        self._closing.set()
        self._thread.join(CLOSE_PATIENCE_S)

    def _put(self, item: Output | Sample) -> None:
        try:
            self._queue.put_nowait(item)
        except queue.Full:
            self.dropped += 1

    def _run(self) -> None:
        while True:
            try:
                item = self._queue.get(timeout=0.1)
            except queue.Empty:
                if self._closing.is_set():
                    break
                continue
            if isinstance(item, tuple):
                self._end()
                folder, name = item
                self._pending = None if folder is None else folder / name
                if folder is None:
                    self.open = None
            else:
                self._write(item)
        self._end()

    def _write(self, item: Output | Sample) -> None:
        if self._sink is None:
            # The first frame has the camera's size, which the model needs.
            if self._pending is None or not isinstance(item, Processed):
                return
            self._sink = self._opened(self._pending, item)
            self._pending = None
            if self._sink is None:
                return
        if isinstance(item, Attitude | Velocity):
            self._sink.sample(item)
        else:
            self._sink.put(item)  # type: ignore[arg-type]

    def _opened(self, path: Path, first: Processed) -> McapSink | None:
        height, width = first.frame.image.shape
        try:
            camera, _ = camera_model(self._settings.camera, width, height)
            return McapSink(path, self._settings.vehicle.name, camera)
        except LandslopeError as error:
            log.error("no MCAP recording: %s", error)
            return None

    def _end(self) -> None:
        sink, self._sink = self._sink, None
        if sink is not None:
            try:
                sink.close()
            except (OSError, RuntimeError) as error:
                log.error("the MCAP recording could not be completed: %s", error)
