"""How long the daemon takes to its first estimate, in any order in which things appear, and to its end."""

import socket
import statistics
import time
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from companion.benchmark.latency_peers import PictureServer, Telemetry
from companion.benchmark.measured_daemon import MeasuredDaemon, free_port

WAIT_S = (2.4, 3.1, 3.7)
"""When the last one appears after the daemon's start, run by run: at another moment of its retries each time."""

BOTH, CAMERA_LAST, AUTOPILOT_LAST = "daemon last", "camera last", "autopilot last"
FROM = {
    BOTH: "from the start of the process, camera and autopilot answer already",
    CAMERA_LAST: "from the moment the camera answers, daemon and autopilot are up",
    AUTOPILOT_LAST: "from the moment the autopilot answers, daemon and camera are up",
}


@dataclass(frozen=True, slots=True)
class StartFigures:
    """One order of appearance; a value a run, in seconds."""

    order: str
    message_s: tuple[float, ...]
    """To the first message on an estimate, whatever it says."""
    estimate_s: tuple[float, ...]
    """To the first estimate with an inclination."""
    end_s: tuple[float, ...]
    """From SIGTERM to the end of the process."""


def measure(width: int, height: int, waits_s: tuple[float, ...] = WAIT_S) -> list[StartFigures]:
    """All orders, a run of each for every wait. Raises LandslopeError when the daemon does not come up."""
    figures = []
    for order in FROM:
        runs = [_run(order, wait_s, (width, height)) for wait_s in waits_s]
        messages, estimates, ends = zip(*runs, strict=True)
        figures.append(StartFigures(order, messages, estimates, ends))
    return figures


def table(figures: list[StartFigures]) -> str:
    """The figures as text."""
    lines = [
        f"{'who appears last':>16} {'first message, s':>17} {'first estimate, s':>18} {'SIGTERM to end, s':>18}"
    ]
    lines.append(f"{'':>16} {'least / median':>17} {'least / median':>18} {'least / median':>18}")
    for f in figures:
        # While the autopilot is absent messages come all the time, without an inclination.
        message = "-" if f.order == AUTOPILOT_LAST else _both(f.message_s)
        lines.append(f"{f.order:>16} {message:>17} {_both(f.estimate_s):>18} {_both(f.end_s):>18}")
    return "\n".join([*lines, *(f"{order}: {words}" for order, words in FROM.items())])


def _both(values: tuple[float, ...]) -> str:
    return f"{min(values):.2f} / {statistics.median(values):.2f}"


def _run(order: str, wait_s: float, size: tuple[int, int]) -> tuple[float, float, float]:
    """(first message, first estimate, end) in seconds."""
    camera_port, link_port = free_port(socket.SOCK_STREAM), free_port(socket.SOCK_DGRAM)
    with ExitStack() as stack:
        if order != CAMERA_LAST:
            stack.enter_context(PictureServer(*size, camera_port))
        if order != AUTOPILOT_LAST:
            stack.enter_context(Telemetry(link_port))
        daemon = stack.enter_context(MeasuredDaemon(camera_port, link_port))
        answered = daemon.started
        if order != BOTH:
            daemon.collect(wait_s)
            answered = time.monotonic()
            stack.enter_context(
                PictureServer(*size, camera_port) if order == CAMERA_LAST else Telemetry(link_port)
            )
        message = daemon.wait_for(lambda estimate: True)
        estimate = daemon.wait_for(_complete)
        return message - answered, estimate - answered, daemon.end()


def _complete(estimate: dict[str, Any]) -> bool:
    return estimate["status"] == "ok" and estimate["inclination_deg"] is not None
