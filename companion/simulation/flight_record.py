"""Simulated flights as flight folders with their truth: what a recording of the real thing looks like."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from companion.core.approach import Ordered
from companion.core.core import Output, Processed
from companion.core.decision_logic import LandRequest
from companion.live.recording import flight_papers
from companion.messages.messages import encode, topic_of
from companion.settings.settings import Settings
from drivers.errors import DriverError
from drivers.files.flight_folder import STAMPS
from drivers.files.frame_table import read_frame_table
from drivers.files.recorder import FlightPapers, Recorder, RecorderOptions
from drivers.samples import Frame
from drivers.simulated.world.truth import FrameTruth, write_truth

UNBOUNDED = 10**15
"""A lockstep flight can wait for the disk: nothing is dropped."""
CLOSE_S = 60.0
TRUTH = "truth.csv"
SAME_FRAME_US = 3000
"""A recorded stamp and an exposure further apart than this are not the same frame."""


class FlightRecord:
    """Records frames, packets and messages of one flight into a new folder under ``directory``."""

    def __init__(self, directory: Path, settings: Settings, rate_hz: float) -> None:
        options = RecorderOptions(
            directory,
            rate_hz=rate_hz,
            max_waiting_bytes=UNBOUNDED,
            max_flight_bytes=UNBOUNDED,
            min_free_bytes=0,
        )
        papers: FlightPapers = flight_papers(settings)
        self._recorder = Recorder(options, papers)
        self._recorder.start()
        self._truths: list[FrameTruth] = []

    def frame(self, frame: Frame, truth: FrameTruth) -> None:
        """One frame and its truth."""
        self._recorder.frame(frame)
        self._truths.append(truth)

    def output(self, output: Output) -> None:
        """One output of the pipeline."""
        if not isinstance(output, LandRequest | Processed | Ordered):
            self._recorder.message(topic_of(output), encode(output))

    def close(self, packets: list[tuple[int, bytes]]) -> Path:
        """Write the packets (arrival, bytes) and the truth; the folder."""
        for arrival_us, packet in packets:
            self._recorder.mavlink(arrival_us, packet)
        self._recorder.close(CLOSE_S)
        folder = self._recorder.folder
        if folder is None or self._recorder.counters["failures"]:
            problems = "; ".join(e.text for e in self._recorder.events() if e.severity == "error")
            raise DriverError(f"the flight could not be recorded: {problems}")
        rows = [replace(truth, frame=index) for index, truth in enumerate(self._truths)]
        write_truth(folder / TRUTH, rows)
        return folder


def folders_in(directory: Path | None) -> set[Path]:
    """The folders that are in a directory, which need not exist."""
    if directory is None or not directory.is_dir():
        return set()
    return {entry for entry in directory.iterdir() if entry.is_dir()}


def add_truth(directory: Path, before: set[Path], truths: Sequence[tuple[int, FrameTruth]]) -> Path:
    """Write the truth into the folder that a daemon has just recorded under ``directory``.

    ``truths`` are (stamp in us, truth) of every exposure; the daemon skipped some. Raises DriverError without a
    new folder.
    """
    new = sorted(folders_in(directory) - before)
    if not new or not truths:
        raise DriverError(f"{directory}: nothing was recorded; is the disk full?")
    rows = read_frame_table(new[-1] / STAMPS).rows
    stamps = np.array([stamp for stamp, _ in truths])
    found = []
    for number, row in rows.items():
        nearest = int(np.abs(stamps - row.stamp_us).argmin())
        if abs(int(stamps[nearest]) - row.stamp_us) <= SAME_FRAME_US:
            found.append(replace(truths[nearest][1], frame=number))
    write_truth(new[-1] / TRUTH, found)
    return new[-1]
