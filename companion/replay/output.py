"""Where a replay writes: paths for one flight or many, checked before the run, and the lines of its files."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import msgspec

from companion.errors import LandslopeError
from companion.messages.messages import Decision, Event, Message, encode

PLACEHOLDER = "{flight}"
ENDINGS = {
    "out": ".jsonl",
    "ground": ".ground.jsonl",
    "events": ".events.jsonl",
    "plot": ".png",
    "video": ".webm",
    "report": ".html",
}


@dataclass(frozen=True, slots=True)
class Outputs:
    """The files of one flight; None: not wanted."""

    out: Path | None = None
    ground: Path | None = None
    events: Path | None = None
    plot: Path | None = None
    video: Path | None = None
    report: Path | None = None

    @property
    def paths(self) -> list[Path]:
        """Those that are wanted."""
        return [
            path
            for path in (self.out, self.ground, self.events, self.plot, self.video, self.report)
            if path is not None
        ]


def names_of(flights: Sequence[Path]) -> list[str]:
    """A short name for each flight, the same for none."""
    names = [flight.resolve().name for flight in flights]
    if len(set(names)) < len(names):
        names = ["_".join(flight.resolve().parts[-2:]) for flight in flights]
    if len(set(names)) < len(names):
        raise LandslopeError("the same flight is given twice: give each once")
    return names


def outputs_for(name: str, wanted: dict[str, str | None], several: bool) -> Outputs:
    """The files of one flight for the option values of ``--out``, ``--ground``, ``--events`` and so on.

    A directory (it exists, or the value ends in a slash) takes ``FLIGHT.jsonl`` and so on; ``{flight}``
    stands for the flight's name. With several flights a plain file name is refused.
    """
    return Outputs(
        **{option: _path(option, value, name, several) for option, value in wanted.items() if value}
    )


def check_writable(outputs: Sequence[Outputs]) -> None:
    """Raise LandslopeError for the first file that could not be written, or that two outputs share."""
    seen: set[Path] = set()
    for path in (path for one in outputs for path in one.paths):
        if path.resolve() in seen:
            raise LandslopeError(f"{path}: would be written twice: give every output a file of its own")
        seen.add(path.resolve())
        existed = path.exists()
        try:
            path.open("ab").close()
            if not existed:
                path.unlink()
        except OSError as error:
            raise LandslopeError(
                f"{path}: cannot be written: {error.strerror}; choose another path"
            ) from None


class LineFile:
    """A file of JSON lines; a disk that is full is a LandslopeError that names the file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._named():
            self._file = path.open("wb")

    def message(self, message: Message) -> None:
        """Write one message."""
        self._line(encode(message))

    def event(self, message: Message, before: Decision | None) -> None:
        """An event as it is, a decision as the event ``decision`` when it says something new."""
        if isinstance(message, Event):
            self.message(message)
        elif isinstance(message, Decision) and _substance(message) != (before and _substance(before)):
            self._line(msgspec.json.encode({"event": "decision", **msgspec.to_builtins(message)}))

    def close(self) -> None:
        """Write what is left and close."""
        with self._named():
            self._file.close()

    def _line(self, line: bytes) -> None:
        with self._named():
            self._file.write(line + b"\n")

    @contextmanager
    def _named(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise LandslopeError(f"{self.path}: cannot be written: {error.strerror}") from None


def _substance(decision: Decision) -> tuple[object, ...]:
    d = decision
    return (d.verdict, d.permitted, d.withheld, d.requested, d.command)


def _path(option: str, value: str, name: str, several: bool) -> Path:
    if PLACEHOLDER in value:
        return Path(value.replace(PLACEHOLDER, name))
    if value.endswith("/") or Path(value).is_dir():
        try:
            Path(value).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise LandslopeError(
                f"{value}: cannot be made: {error.strerror}; choose another directory"
            ) from None
        return Path(value) / f"{name}{ENDINGS[option]}"
    if several:
        raise LandslopeError(
            f"--{option} {value}: several flights cannot share one file; give a directory ({value}/) or a name with "
            f"{PLACEHOLDER} in it ({PLACEHOLDER}{ENDINGS[option]})"
        )
    return Path(value)
