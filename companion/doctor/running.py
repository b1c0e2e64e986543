"""A landslope that runs is asked for its own health, in the place of a fight for its camera and its link.

In: the settings. Out: ``Finding`` on the service, on each of its inputs and on each standing condition.
"""

import fcntl
import os
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from companion.doctor.findings import Finding, Level
from companion.messages.messages import Health, InputHealth
from companion.messages.received import MAX_BYTES, printable, received
from companion.settings.settings import Settings
from drivers.system.single_instance import health_path

LOCK_DIRECTORIES = ("/run/landslope",)
"""Where the service's lock lies; a landslope started by hand has it elsewhere."""
OLDEST_S = 5.0
"""Health comes once a second; the watchdog ends what hangs for so long."""
STOP = "for a look at camera and link themselves stop it: systemctl stop landslope"
SEVERITIES: dict[str, Level] = {"warning": "warning", "error": "failure"}


@dataclass(frozen=True, slots=True)
class Running:
    """A lock that another process holds, that process, and its newest health with its age in s."""

    lock: Path
    process: str
    health: Health | None
    age_s: float


def running(settings: Settings) -> Running | None:
    """The landslope of this vehicle that runs; None: none does. Raises PermissionError where it may not be looked."""
    directories = (*LOCK_DIRECTORIES, os.environ.get("XDG_RUNTIME_DIR", ""), tempfile.gettempdir())
    for directory in filter(None, directories):
        lock = Path(directory) / f"landslope-{settings.vehicle.name}.lock"
        process = _holder(lock)
        if process is not None:
            return Running(lock, process, *_health(health_path(lock)))
    return None


def running_findings(found: Running) -> Iterator[Finding]:
    """What the running landslope reports of itself."""
    health = found.health
    text = f"landslope runs (process {found.process}, {found.lock})"
    if health is None:
        yield Finding("service", "warning", f"{text} and has not reported its health: is it starting?", STOP)
        return
    if found.age_s > OLDEST_S:
        yield Finding("service", "failure", f"{text}, its newest health is {found.age_s:.0f} s old", STOP)
        return
    yield Finding("service", "ok", f"{text}; what follows is its own health", STOP)
    conditions = {condition.subject or condition.code: condition for condition in health.conditions}
    for name, state in health.inputs.items():
        condition = conditions.pop(name, None)
        if condition is None:
            yield Finding(_subject(name), "ok" if state.state == "ok" else "warning", _input_text(state))
        else:
            yield Finding(
                _subject(name), SEVERITIES.get(condition.severity, "failure"), printable(condition.text)
            )
    for name, condition in conditions.items():
        yield Finding(
            _subject(name), SEVERITIES.get(condition.severity, "failure"), printable(condition.text)
        )
    if health.clock_offset_s is not None:
        doubt = "" if health.clock_std_s is None else f", +- {health.clock_std_s * 1e3:.1f} ms"
        yield Finding("clocks", "ok", f"related{doubt}")
    if health.pipeline_ms is not None:
        yield Finding("pipeline", "ok", f"{health.pipeline_ms:.1f} ms a frame")
    if health.recording is not None:
        yield Finding("recording", "ok", "a flight is being recorded" if health.recording else "waits")


def _subject(name: str) -> str:
    return printable(name).replace("_", " ")


def _input_text(state: InputHealth) -> str:
    parts = [] if state.state == "ok" else [printable(state.state)]
    if state.rate_hz is not None:
        parts.append(f"{state.rate_hz:.1f} Hz")
    if state.age_s is not None:
        parts.append(f"newest {state.age_s:.2f} s old")
    return ", ".join([*parts, f"{state.count} taken, {state.refused} refused"])


def _holder(lock: Path) -> str | None:
    """The process that holds a lock file; None when nobody does. Raises PermissionError for one that is hidden."""
    try:
        descriptor = os.open(lock, os.O_RDONLY)
    except PermissionError:
        if os.access(lock.parent, os.X_OK):
            return None
        raise  # the service's directory, which is there while it runs
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return printable(os.read(descriptor, 32).decode("ascii", "replace").strip()) or "unknown"
    finally:
        os.close(descriptor)
    return None


def _health(path: Path) -> tuple[Health | None, float]:
    """The health in a file, as the schema allows it, and its age in s."""
    try:
        with path.open("rb") as file:
            raw, age_s = file.read(MAX_BYTES + 1), time.time() - os.fstat(file.fileno()).st_mtime
    except OSError:
        return None, 0.0
    found = received("health", raw)
    return (found if isinstance(found, Health) else None), max(age_s, 0.0)
