"""A recorder with small limits, and its events."""

import time
from pathlib import Path

from drivers.files.recorder import FlightPapers, Recorder, RecorderOptions

PAPERS = FlightPapers(settings="[vehicle]\nsystem_id = 1\n", calibration="")
START_US = 1_795_299_001_000_000
STEP_US = 33_333


def options(directory: Path, **changes) -> RecorderOptions:
    return RecorderOptions(directory, **{"min_free_bytes": 1_000_000, **changes})


def await_event(recorder: Recorder, name: str) -> str:
    """The text of the first event of that name."""
    until = time.monotonic() + 20
    while time.monotonic() < until:
        for event in recorder.events():
            if event.event == name:
                return event.text
        time.sleep(0.02)
    raise AssertionError(f"no event {name}")
