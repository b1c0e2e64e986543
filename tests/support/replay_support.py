"""Replays of recorded flights by the real command, each run once for all tests that ask for it."""

import fcntl
import hashlib
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flight_copy import FLIGHTS, short_flight

NAMES = ("stairs_a", "ramp_a", "descent_a", "agile_a", "rubble_a", "stairs_c")
ENABLED = {"stairs_a": ("--enable-after", "8"), "ramp_a": ("--enable-after", "17")}
"""When landing is enabled in replays for all tests; no estimate depends on it."""
PATIENCE_S = 3600
"""Only so that a command that hangs ends some day; a busy machine takes long."""


@dataclass(frozen=True)
class Replayed:
    """What one replay wrote."""

    folder: Path
    flight: Path

    @property
    def out(self) -> bytes:
        """The ``--out`` file."""
        return (self.folder / "out.jsonl").read_bytes()

    @property
    def estimates(self) -> list[dict[str, Any]]:
        """One mapping a frame."""
        return [json.loads(line) for line in self.out.splitlines()]

    @property
    def events(self) -> list[dict[str, Any]]:
        """One mapping an event or a change of decision."""
        return [json.loads(line) for line in (self.folder / "events.jsonl").read_bytes().splitlines()]

    @property
    def summary(self) -> str:
        """What was printed."""
        return (self.folder / "summary.txt").read_text()


def landslope(*arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "companion.cli", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        **options,
    )


def replayed(cache: Path, flight: str, *arguments: str, seconds: float | None = None) -> Replayed:
    """The replay of a flight with further arguments; run at most once in a test session, by whichever worker.

    Without any, landing is enabled as ``ENABLED`` says. ``seconds``: how much of the flight, from its beginning.
    """
    arguments = arguments or ENABLED.get(flight, ())
    digest = hashlib.sha256(f"{arguments} {seconds}".encode()).hexdigest()[:8]
    folder = cache / f"{flight}-{digest}"
    path = FLIGHTS / flight if seconds is None else folder / "part" / flight
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "summary.txt").exists():
            if seconds is not None:
                short_flight(path, flight, seconds)
            run(path, folder, *arguments)
    return Replayed(folder, path)


def run(flight: Path, folder: Path, *arguments: str) -> Replayed:
    """Replay a flight into a folder; the command must succeed."""
    files = ("--out", folder / "out.jsonl", "--events", folder / "events.jsonl")
    result = landslope("replay", flight, *files, *arguments, env=os.environ | {"PYTHONHASHSEED": "random"})
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    (folder / "summary.txt").write_text(result.stdout)
    return Replayed(folder, flight)
