"""Watchers and routers in processes of their own, over real sockets."""

import json
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

PATIENCE_S = 600.0

ROUTER = """
import sys
from drivers.bus import Endpoints, open_session
with open_session(Endpoints(mode="router", listen=(sys.argv[1],))):
    print("ready", flush=True)
    sys.stdin.read()
"""


@contextmanager
def router(endpoint: str) -> Iterator[None]:
    """A zenoh router in its own process."""
    process = subprocess.Popen(
        [sys.executable, "-c", ROUTER, endpoint], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield
    finally:
        process.kill()
        process.communicate()


class Watcher:
    """``landslope watch`` in its own process, its lines read as they come."""

    def __init__(self, *arguments: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "companion.cli", "watch", *arguments], stdout=subprocess.PIPE, text=True
        )
        self.seen: list[dict[str, Any]] = []
        self._lines: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._lines.put(line)

    def until(self, wanted: Any) -> list[dict[str, Any]]:
        """Everything seen, as soon as ``wanted(seen)`` holds; fails when it never does."""
        end = time.monotonic() + PATIENCE_S
        while not wanted(self.seen):
            try:
                line = self._lines.get(timeout=max(0.0, end - time.monotonic()))
            except queue.Empty:
                topics = [(m["topic"], m.get("alive")) for m in self.seen[-20:]]
                raise AssertionError(
                    f"waited in vain after {len(self.seen)} messages: ... {topics}"
                ) from None
            self.seen.append(json.loads(line))
        return self.seen

    def of(self, topic: str) -> list[dict[str, Any]]:
        """What was seen of one topic."""
        return [message for message in self.seen if message["topic"] == topic]

    def __enter__(self) -> "Watcher":
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()


def alive(state: bool) -> Any:
    """A condition for ``until``: the newest word on liveliness is ``state``."""

    def holds(seen: list[dict[str, Any]]) -> bool:
        words = [message["alive"] for message in seen if "alive" in message]
        return bool(words) and words[-1] is state

    return holds
