"""``landslope run`` that writes down once a second what its pipeline and its threads cost.

    python -m companion.benchmark.timed_daemon FILE run --set ...

``FILE`` gets one line of JSON, replaced as a whole: frames, and processor time of the pipeline's steps and of each kind
of thread until then. Clocks are those of threads, so that other programs on the machine do not count.
"""

import json
import os
import runpy
import sys
import threading
import time
from pathlib import Path
from typing import Any

from landing.pipeline import SurfacePipeline

PERIOD_S = 1.0
TICK_MS = 1e3 / os.sysconf("SC_CLK_TCK")


class Ledger:
    """What was spent, written from the pipeline's own thread: no thread more, no wake-up more."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._frames = self._pipeline_ns = 0
        self._due_s = 0.0

    def watch(self) -> None:
        """Time every step of every pipeline from now on."""
        step = SurfacePipeline.step

        def timed(pipeline: SurfacePipeline, *args: Any, **kwargs: Any) -> Any:
            if time.monotonic() >= self._due_s:
                self._due_s = time.monotonic() + PERIOD_S
                self._write()
            started = time.thread_time_ns()
            try:
                return step(pipeline, *args, **kwargs)
            finally:
                self._pipeline_ns += time.thread_time_ns() - started
                self._frames += 1

        SurfacePipeline.step = timed  # type: ignore[assignment,method-assign]

    def _write(self) -> None:
        names = {thread.native_id: thread.name for thread in threading.enumerate()}
        threads: dict[str, float] = {}
        for entry in Path("/proc/self/task").iterdir():
            kind = _kind(names.get(int(entry.name), "native"))
            try:
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue  # it ended meanwhile
            spent_ms = (int(fields[11]) + int(fields[12])) * TICK_MS
            threads[kind] = threads.get(kind, 0.0) + spent_ms
        content = {
            "frames": self._frames,
            "pipeline_ms": self._pipeline_ns * 1e-6,
            "process_ms": time.process_time_ns() * 1e-6,
            "threads_ms": threads,
        }
        beside = self._path.with_suffix(".new")
        beside.write_text(json.dumps(content))
        os.replace(beside, self._path)


def _kind(name: str) -> str:
    """Part of the daemon that a thread belongs to, by its name; zenoh's and MAVSDK's threads are native."""
    if name == "MainThread":
        return "core"
    if name.startswith("link"):
        return "link"
    return "camera" if name.startswith("camera") else "others"


def main() -> None:
    """Run the daemon as the command line says."""
    Ledger(Path(sys.argv[1])).watch()
    sys.argv[1:] = sys.argv[2:]
    runpy.run_module("companion.cli", run_name="__main__")


if __name__ == "__main__":
    main()
