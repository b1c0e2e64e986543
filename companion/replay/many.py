"""Many recorded flights, here, in processes of this machine or on the workers of a Dask scheduler; each is a row."""

import importlib.metadata
import json
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from companion.errors import LandslopeError
from companion.replay.history import History
from companion.replay.replay import Progress, Replayed, ReplayJob, replay
from companion.replay.summary import Pace
from drivers.errors import DriverError
from drivers.files.remote_folder import fetched
from drivers.files.row_table import SETTINGS, VERSION, RowTable
from drivers.system.pools import Pool, each
from landing.errors import LandingError

ERRORS = (LandslopeError, DriverError, LandingError)
TROUBLE = ("warning", "error")
NO_PROGRESS: Progress = lambda done, total: None  # noqa: E731


@dataclass(frozen=True, slots=True)
class FlightRow:
    """What a replayed flight amounts to; None where it is not known, ``error`` where it could not be replayed."""

    flight: str
    frames: int = 0
    seconds: float = 0.0
    estimates: float | None = None
    """Share of the frames with an estimate."""
    fit: float | None = None
    """Share of the frames at which the verdict was fit."""
    inclination_deg: float | None = None
    """Median over the flight."""
    inclination_p95_deg: float | None = None
    inclination_std_deg: float | None = None
    """Median of the standard deviation."""
    roughness: float | None = None
    """Median."""
    requested_s: float | None = None
    """When a landing was requested first."""
    against: str = ""
    """The reason that was given most often against a landing, by its code."""
    trouble: str = ""
    """Events of warnings and errors by name, with how often each came."""
    computing_s: float = 0.0
    """Processor time without drawing."""
    error: str = ""


@dataclass(frozen=True, slots=True)
class Result:
    """A flight's summary, or its error as one line, and its row."""

    text: str
    failed: bool
    row: FlightRow


def replay_one(job: ReplayJob, progress: Progress = NO_PROGRESS) -> Result:
    """Replay a flight, a remote one from a copy; an error is the result's, in one line."""
    try:
        if job.address:
            with fetched(job.address) as copy:
                done = replay(replace(job, path=copy), progress)
        else:
            done = replay(job, progress)
    except ERRORS as error:
        return failed(job, str(error))
    except OSError as error:
        return failed(job, f"{error.filename or 'a file'}: {error.strerror}")
    return Result(done.text, False, row_of(flight_of(job), done))


def failed(job: ReplayJob, what: str) -> Result:
    """The result of a flight that could not be replayed."""
    row = FlightRow(flight=flight_of(job), error=what)
    return Result(f"landslope replay: {job.name}: {what}", True, row)


def flight_of(job: ReplayJob) -> str:
    """How a table names the flight."""
    return job.address or str(job.path)


def row_of(flight: str, done: Replayed) -> FlightRow:
    """The figures of a flight that was replayed."""
    history: History = done.history
    pace: Pace = done.pace
    count = len(history.estimates)
    asked = [at_s for at_s, event in history.events if event.event == "landing_requested"]
    against = Counter(code for _, d in history.decisions for code in d.reason_codes[:1])
    troubles = Counter(event.event for _, event in history.events if event.severity in TROUBLE)
    inclination = history.series("inclination_deg")
    return FlightRow(
        flight=flight,
        frames=count,
        seconds=round(history.duration_s, 3),
        estimates=_share(sum(e.status == "ok" for e in history.estimates), count),
        fit=_share(history.verdicts.count("fit"), count),
        inclination_deg=_quantile(inclination, 0.5),
        inclination_p95_deg=_quantile(inclination, 0.95),
        inclination_std_deg=_quantile(history.series("inclination_std_deg"), 0.5),
        roughness=_quantile(history.series("roughness"), 0.5),
        requested_s=round(asked[0], 3) if asked else None,
        against=against.most_common(1)[0][0] if against else "",
        trouble=" ".join(f"{name}:{n}" for name, n in sorted(troubles.items())),
        computing_s=round(pace.computing_s, 3),
    )


class FlightTable(RowTable):
    """A row a flight. Raises DriverError where the folder holds flights that were replayed with other settings."""

    def __init__(self, path: Path, job: ReplayJob) -> None:
        """``job``: any of them; what is asked of all of them is in the settings."""
        text = job.config.read_text(encoding="utf-8") if job.config is not None else ""
        asked = {"config": text, "set": list(job.overrides), "enable_after_s": job.enable_after_s}
        same = {
            SETTINGS: json.dumps(asked | {"enable_from_rc": job.enable_from_rc}),
            VERSION: importlib.metadata.version("landslope"),
        }
        super().__init__(path, FlightRow, same)

    def left(self, jobs: Sequence[ReplayJob]) -> list[ReplayJob]:
        """Those that have no row of an earlier run."""
        done = {row["flight"] for row in self.before}
        return [job for job in jobs if flight_of(job) not in done]


def replay_many(
    jobs: Sequence[ReplayJob], pool: Pool, ahead: int, work: Callable[[ReplayJob], Result] = replay_one
) -> Iterator[tuple[ReplayJob, Result]]:
    """Every flight with its result, as it ends; one whose process died is a result with that error."""
    for job, result in each(pool, work, jobs, ahead):
        if isinstance(result, BaseException):
            what = f"{type(result).__name__}: {result}".splitlines()[0]
            result = failed(job, f"its process ended: {what}; replay it on its own")
        yield job, result


def _share(count: int, total: int) -> float | None:
    return round(count / total, 4) if total else None


def _quantile(values: np.ndarray, share: float) -> float | None:
    known = values[np.isfinite(values)]
    return round(float(np.quantile(known, share)), 5) if known.size else None
