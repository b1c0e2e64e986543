"""A daemon in a process of its own that is measured, and its messages as a subscriber gets them."""

import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import msgspec

from companion.errors import LandslopeError
from drivers.bus import Endpoints, Subscription
from drivers.system.host_clock import now_us

START_S = 30.0
END_S = 15.0

Received = tuple[int, dict[str, Any]]
"""When an estimate arrived (host clock, us), and the estimate."""


class Spent(msgspec.Struct, frozen=True):
    """Frames until now, and processor time in ms: of the pipeline's steps, of the process, of its kinds of threads."""

    frames: int
    pipeline_ms: float
    process_ms: float
    threads_ms: dict[str, float]


class MeasuredDaemon:
    """``landslope run`` with a camera and an autopilot on ports of this machine; ``started`` is the monotonic time.

    The daemon connects to the subscriber, not the other way round: a subscriber that tries again and again to reach a
    daemon that is not up yet would measure its own pauses.
    """

    def __init__(self, camera_port: int, link_port: int) -> None:
        bus = free_port(socket.SOCK_STREAM)
        name = f"benchmark{bus}"
        settings = (
            f"camera.source=http://127.0.0.1:{camera_port}/",
            f"mavlink.connection=udpin:127.0.0.1:{link_port}",
            f"zenoh.connect=tcp/127.0.0.1:{bus}",
            f"vehicle.name={name}",
        )
        arguments = [argument for setting in settings for argument in ("--set", setting)]
        with ExitStack() as stack:
            directory = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="landslope-benchmark-")))
            self._ledger = directory / "ledger.json"
            self._subscription = stack.enter_context(
                Subscription(Endpoints(listen=(f"tcp/127.0.0.1:{bus}",)), name, ("estimate",))
            )
            log = stack.enter_context((directory / "log").open("wb"))
            self.started = time.monotonic()
            self._process = subprocess.Popen(
                [
                    sys.executable,
                    *("-m", "companion.benchmark.timed_daemon", str(self._ledger)),
                    *("run", *arguments),
                ],
                stderr=log,
                env=os.environ | {"XDG_RUNTIME_DIR": str(directory)},
            )
            stack.callback(self.end)
            self._stack = stack.pop_all()

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    def wait_for(self, wanted: Callable[[dict[str, Any]], bool]) -> float:
        """The monotonic time at which the first estimate came that is ``wanted``. Raises LandslopeError without one."""
        until = time.monotonic() + START_S
        while time.monotonic() < until:
            received = self._receive()
            if received is not None and wanted(received[1]):
                return time.monotonic()
            if self._process.poll() is not None:
                code = self._process.returncode
                raise LandslopeError(f"the daemon ended with {code}: run 'landslope run' to see why")
        raise LandslopeError(
            f"the daemon made no such estimate within {START_S:g} s: run 'landslope run' to see why"
        )

    def collect(self, seconds: float) -> list[Received]:
        """All estimates of so many seconds."""
        until = time.monotonic() + seconds
        found = []
        while time.monotonic() < until:
            received = self._receive()
            if received is not None:
                found.append(received)
        return found

    def spent(self) -> Spent:
        """What it has spent until its newest word, at most a second ago. Raises LandslopeError when it said none."""
        try:
            return msgspec.json.decode(self._ledger.read_bytes(), type=Spent)
        except (OSError, msgspec.DecodeError) as error:
            raise LandslopeError(f"the daemon did not write down what it costs: {error}") from None

    def end(self) -> float:
        """End it by SIGTERM; how many seconds that took."""
        asked = time.monotonic()
        self._process.send_signal(signal.SIGTERM)
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        return time.monotonic() - asked

    def _receive(self) -> Received | None:
        delivery = self._subscription.receive(0.1)
        if delivery is None or delivery.topic != "estimate":
            return None
        return now_us(), json.loads(delivery.payload)

    def __enter__(self) -> "MeasuredDaemon":
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()


def free_port(kind: socket.SocketKind) -> int:
    """A port of the loopback device that was free a moment ago."""
    with socket.socket(socket.AF_INET, kind) as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])
