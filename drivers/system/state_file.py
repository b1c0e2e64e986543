"""The newest state of a process in a file beside its lock, for programs that may read that directory."""

import os
from pathlib import Path


class StateFile:
    """``write`` replaces the whole file at once and never raises; ``close`` removes it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._temporary = path.with_name(f"{path.name}.{os.getpid()}")

    def write(self, data: bytes) -> None:
        """The newest state; nothing where the directory takes none."""
        try:
            # a new file each time, and no link that somebody put there: the directory may be everybody's
            self._temporary.unlink(missing_ok=True)
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
            descriptor = os.open(self._temporary, flags, 0o640)
            try:
                os.write(descriptor, data)
            finally:
                os.close(descriptor)
            self._temporary.replace(self.path)
        except OSError:
            return

    def close(self) -> None:
        """Nobody shall read the state of a process that ended."""
        for path in (self.path, self._temporary):
            try:
                path.unlink(missing_ok=True)
            except OSError:
                continue

    def __enter__(self) -> "StateFile":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
