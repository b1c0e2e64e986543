"""Only one daemon a vehicle on a machine: a lock file that the kernel lets go of when the process ends."""

import fcntl
import os
import tempfile
from pathlib import Path

from drivers.errors import DriverError


class SingleInstance:
    """Holds the lock until ``close`` or the end of the process. Raises DriverError when another process holds it.

    The file lies in systemd's runtime directory, else in the user's, else among the temporary files.
    """

    def __init__(self, name: str) -> None:
        self.path = _directory() / f"landslope-{name}.lock"
        try:
            self._file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise DriverError(f"{self.path}: cannot be opened for the lock: {error.strerror}") from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.read(self._file, 32).decode("ascii", "replace").strip() or "unknown"
            os.close(self._file)
            raise DriverError(
                f"landslope already runs for vehicle '{name}' (process {holder}, lock {self.path}): "
                "stop it first, or set another vehicle.name"
            ) from None
        os.truncate(self._file, 0)
        os.write(self._file, f"{os.getpid()}\n".encode())

    def close(self) -> None:
        """Let go."""
        os.close(self._file)

    def __enter__(self) -> "SingleInstance":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def health_path(lock: Path) -> Path:
    """The file beside a lock that has the newest health of the process that holds it."""
    return lock.with_suffix(".health.json")


def _directory() -> Path:
    for variable in ("RUNTIME_DIRECTORY", "XDG_RUNTIME_DIR"):
        directory = Path(os.environ.get(variable, ""))
        if directory.is_absolute() and os.access(directory, os.W_OK):
            return directory
    return Path(tempfile.gettempdir())
