"""The time of a signed link, kept on disk: without it a board that starts without a clock believes any old frame."""

import json
import logging
import os
from collections.abc import Mapping
from pathlib import Path

log = logging.getLogger(__name__)

Stream = tuple[int, int, int]
"""Link id, system, component."""

MAX_BYTES = 65536


class SigningMemory:
    """One file: the newest signing time, and the newest of every stream. Failures are logged once, never raised."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._complained = False

    def load(self) -> tuple[int, dict[Stream, int]]:
        """What was kept; nothing where there is no file, or none of ours."""
        try:
            if self._path.stat().st_size > MAX_BYTES:
                raise ValueError("too large")
            content = json.loads(self._path.read_text(encoding="ascii"))
            streams = {
                (int(link), int(system), int(component)): int(stamp)
                for link, system, component, stamp in content["streams"]
            }
            return int(content["time"]), streams
        except FileNotFoundError:
            pass
        except (OSError, ValueError, TypeError, KeyError, RecursionError) as error:
            self._complain(f"cannot be read: {error}")
        return 0, {}

    def save(self, time: int, streams: Mapping[Stream, int]) -> None:
        """Replace what was kept; a power cut leaves the old or the new file."""
        content = {"time": time, "streams": [[*stream, stamp] for stream, stamp in sorted(streams.items())]}
        temporary = self._path.with_name(self._path.name + ".tmp")
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with temporary.open("w", encoding="ascii") as file:
                json.dump(content, file)
                file.flush()
                os.fsync(file.fileno())
            temporary.replace(self._path)
        except OSError as error:
            self._complain(f"cannot be written: {error.strerror or error}")

    def _complain(self, what: str) -> None:
        if not self._complained:
            self._complained = True
            log.warning("%s: %s; old signed frames may be believed after a restart", self._path, what)
