"""A lockstep flight as a flight folder with truth: what a recording of the real thing looks like."""

from dataclasses import replace
from pathlib import Path

from companion.core import Output, Processed
from companion.judge import LandRequest
from companion.messages import encode, topic_of
from companion.recording import flight_papers
from companion.settings import Settings
from drivers.errors import DriverError
from drivers.recorder import FlightPapers, Recorder, RecorderOptions
from drivers.samples import Frame
from drivers.simulated.truth import FrameTruth, write_truth

UNBOUNDED = 10**9
"""A lockstep flight can wait for the disk: nothing is dropped."""
CLOSE_S = 60.0
TRUTH = "truth.csv"


class FlightRecord:
    """Records frames, packets and messages of one flight into a new folder under ``directory``."""

    def __init__(self, directory: Path, settings: Settings, rate_hz: float) -> None:
        options = RecorderOptions(directory, rate_hz=rate_hz, max_waiting=UNBOUNDED, min_free_bytes=0)
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
        if not isinstance(output, LandRequest | Processed):
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
