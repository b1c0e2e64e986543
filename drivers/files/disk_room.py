"""Room for recordings: a limit for all of them and free space, kept by stopping or by deleting the oldest."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

from drivers.files.flight_folder import SETTINGS

FOLDER_NAME = re.compile(r"(\d{8}T\d{6}Z)(?:-(\d+))?")
"""Names that the recorder gives; no other folder is ever deleted."""

MB = 1_000_000


class DiskRoom:
    """Looks after the flight folders of one directory; raises OSError when the disk does.

    Only folders that carry a recorder's name and its settings file are deleted, never the one being written.
    """

    def __init__(
        self, directory: Path, max_total_bytes: int, min_free_bytes: int, delete_oldest: bool
    ) -> None:
        self._directory = directory
        self._max_total_bytes = max_total_bytes
        self._min_free_bytes = min_free_bytes
        self._delete_oldest = delete_oldest
        self._sizes: dict[Path, int] = {}
        self._deleted: list[Path] = []

    def refusal(self, present: Path | None, present_bytes: int, *, new: bool = False) -> str:
        """Why no more may be written beside ``present_bytes`` of the present folder; empty when there is room.

        ``new``: a new folder is to be begun, the last one counts with the others.
        """
        kept = {path for path in (present,) if path is not None and not new}
        self._look(kept)
        while reason := self._reason(present_bytes):
            oldest = min(self._sizes, key=_age) if self._sizes and self._delete_oldest else None
            if oldest is None:
                return reason
            shutil.rmtree(oldest)
            del self._sizes[oldest]
            self._deleted.append(oldest)
        return ""

    def deleted(self) -> list[Path]:
        """Folders deleted since the last call."""
        deleted, self._deleted = self._deleted, []
        return deleted

    def _reason(self, present_bytes: int) -> str:
        total = sum(self._sizes.values()) + present_bytes
        if self._max_total_bytes and total >= self._max_total_bytes:
            return f"record.max_total_mb is reached, {total // MB} MB of flights are there"
        free = shutil.disk_usage(self._directory).free
        if free < self._min_free_bytes:
            return f"record.min_free_mb is reached, {free // MB} MB are free"
        return ""

    def _look(self, kept: set[Path]) -> None:
        """The sizes of finished folders; each is measured once, unless it is gone."""
        there = {path for path in _flights(self._directory) if path not in kept}
        self._sizes = {path: self._sizes[path] if path in self._sizes else _size(path) for path in there}


def _flights(directory: Path) -> Iterator[Path]:
    for path in directory.iterdir():
        if FOLDER_NAME.fullmatch(path.name) and (path / SETTINGS).is_file() and not path.is_symlink():
            yield path


def _age(path: Path) -> tuple[str, int]:
    """Sorts by the time in the name, then by the number behind it."""
    match = FOLDER_NAME.fullmatch(path.name)
    return (match[1], int(match[2] or 1)) if match else (path.name, 1)


def _size(path: Path) -> int:
    return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
