"""clock.json of a flight folder: what to add to the times in it, once the date is known, and the name it then has."""

import json
import os
from collections.abc import Collection, Iterator
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from itertools import count
from pathlib import Path

FILE = "clock.json"
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
LIMIT_US = 200 * 365 * 86_400 * 1_000_000
"""No clock is wrong by more than two centuries."""


@dataclass(frozen=True, slots=True)
class FolderClock:
    """``begun_us``: when the folder was begun, as its files say; ``add_us``: what makes their times true, None while
    the date is not known; ``source``: what the date is from; ``process``: who recorded it."""

    begun_us: int
    add_us: int | None
    source: str
    process: str = ""

    @property
    def name(self) -> str:
        """The folder's name: the true time of its beginning, as far as it is known."""
        return folder_name(self.begun_us + (self.add_us or 0))


def folder_name(unix_us: int) -> str:
    """The name of a folder begun at this time."""
    return (EPOCH + timedelta(microseconds=unix_us)).strftime("%Y%m%dT%H%M%SZ")


def free_names(directory: Path, name: str) -> Iterator[Path]:
    """The paths to try for a folder of this name, which may be taken: NAME, NAME-2, NAME-3, ..."""
    yield directory / name
    for number in count(2):
        yield directory / f"{name}-{number}"


def read_clock(folder: Path) -> FolderClock | None:
    """The folder's clock; None without one, or with one that makes no sense."""
    try:
        found = json.loads((folder / FILE).read_bytes())
        clock = FolderClock(found["begun_us"], found["add_us"], found["source"], found["process"])
        numbers = (clock.begun_us, 0 if clock.add_us is None else clock.add_us)
        if all(type(n) is int and abs(n) < LIMIT_US for n in numbers) and 0 <= sum(numbers) < LIMIT_US:
            return clock
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        pass
    return None


def write_clock(folder: Path, clock: FolderClock) -> None:
    """Write it whole or not at all; OSError when the disk fails."""
    part = folder / f"{FILE}.part"
    with part.open("w") as file:
        json.dump(asdict(clock), file)
        file.flush()
        os.fsync(file.fileno())
    part.replace(folder / FILE)


def set_right(directory: Path, busy: Collection[Path]) -> list[tuple[Path, Path]]:
    """Rename the folders that were named before the date was known; (old, new) of each.

    ``busy``: folders that are still written. Only folders with a clock whose date is known are renamed.
    """
    renamed = []
    for path in sorted(directory.iterdir()):
        clock = None if path in busy or path.is_symlink() else read_clock(path)
        if clock is None or not clock.add_us or path.name.partition("-")[0] == clock.name:
            continue
        new = next(p for p in free_names(directory, clock.name) if not p.exists())
        path.rename(new)
        renamed.append((path, new))
    return renamed
