"""What the daemon costs: latency from a frame's capture to its zenoh sample, processor time and memory, measured live.

The daemon runs as a process of its own; here a stream of pictures, a simulated autopilot's telemetry and a
subscriber stand around it. All clocks are this machine's monotonic one, so times may be subtracted.
"""

import os
import socket
import statistics
import time
from bisect import bisect_left, bisect_right
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from companion.benchmark.latency_peers import Background, PictureServer, Telemetry
from companion.benchmark.measured_daemon import MeasuredDaemon, Received, free_port
from companion.errors import LandslopeError

SETTLE_S = 3.0
LONG_S = 300.0
"""From so many seconds on a growth of the memory is reported: a shorter run shows only the warm-up."""


@dataclass(frozen=True, slots=True)
class LatencyFigures:
    """One size of image. Latencies in ms, memory in MB (10^6 bytes)."""

    width: int
    height: int
    seconds: float
    frames: int
    rate_hz: float
    total_median_ms: float
    """From the sending of a frame to the zenoh sample of its estimate, the wait for the next attitude included."""
    total_p95_ms: float
    software_median_ms: float
    """From the moment frame and attitude behind it had both been sent: what the software adds."""
    software_p95_ms: float
    cpu_ms_per_frame: float
    rss_mb: float
    growth_mb_per_10_min: float
    """Slope of the resident memory over the second half of the run; means something after LONG_S only."""


def measure(width: int, height: int, seconds: float) -> LatencyFigures:
    """Run the daemon at one image size for ``seconds``. Raises LandslopeError when it does not come up."""
    with ExitStack() as stack:
        pictures = stack.enter_context(PictureServer(width, height))
        link = free_port(socket.SOCK_DGRAM)
        telemetry = stack.enter_context(Telemetry(link))
        daemon = stack.enter_context(MeasuredDaemon(pictures.port, link))
        daemon.wait_for(lambda estimate: True)
        daemon.collect(SETTLE_S)
        before = _usage(daemon.pid)
        watch = stack.enter_context(_MemoryWatch(daemon.pid))
        received = daemon.collect(seconds)
        after = _usage(daemon.pid)
        return _figures(
            (width, height),
            seconds,
            received,
            (before, after),
            watch.growth_per_s(),
            pictures.sent_us,
            telemetry.sent_us,
        )


def table(figures: list[LatencyFigures]) -> str:
    """The figures as text, one line a size."""
    head = (
        f"{'size':>10} {'frames':>7} {'Hz':>6} {'capture to sample, ms':>22} {'of it software, ms':>19} "
        f"{'CPU ms/frame':>13} {'RSS MB':>7} {'MB/10 min':>10}"
    )
    lines = [head, f"{'':>10} {'':>7} {'':>6} {'median / p95':>22} {'median / p95':>19}"]
    for f in figures:
        growth = f"{f.growth_mb_per_10_min:.1f}" if f.seconds >= LONG_S else "-"
        lines.append(
            f"{f'{f.width}x{f.height}':>10} {f.frames:>7} {f.rate_hz:>6.1f} "
            f"{f'{f.total_median_ms:.1f} / {f.total_p95_ms:.1f}':>22} "
            f"{f'{f.software_median_ms:.1f} / {f.software_p95_ms:.1f}':>19} "
            f"{f.cpu_ms_per_frame:>13.1f} {f.rss_mb:>7.0f} {growth:>10}"
        )
    return "\n".join(lines)


@dataclass(frozen=True, slots=True)
class _Usage:
    cpu_s: float
    rss_bytes: int


class _MemoryWatch(Background):
    """Looks at a process's resident memory twice a second."""

    def __init__(self, pid: int) -> None:
        super().__init__()
        self._pid = pid
        self._points: list[tuple[float, int]] = []

    def growth_per_s(self) -> float:
        """Bytes a second, by least squares over the second half."""
        times, sizes = np.array(self._points[len(self._points) // 2 :], float).T
        return float(np.polyfit(times - times[0], sizes, 1)[0]) if len(times) > 1 else 0.0

    def _run(self) -> None:
        while not self._stop.wait(0.5):
            try:
                self._points.append((time.monotonic(), _usage(self._pid).rss_bytes))
            except OSError:
                return  # the process ended


def _usage(pid: int) -> _Usage:
    """Processor time and resident memory of a process, from /proc."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    ticks = int(fields[11]) + int(fields[12])
    return _Usage(ticks / os.sysconf("SC_CLK_TCK"), pages * os.sysconf("SC_PAGE_SIZE"))


def _figures(
    size: tuple[int, int],
    seconds: float,
    received: list[Received],
    usage: tuple[_Usage, _Usage],
    growth_per_s: float,
    frames_us: list[int],
    attitudes_us: list[int],
) -> LatencyFigures:
    if len(received) < 2:
        raise LandslopeError(
            f"the daemon made {len(received)} estimates in {seconds:g} s: nothing to measure"
        )
    total, software = [], []
    for arrived_us, estimate in received:
        exposed_us = estimate["time_unix_us"]
        sent_us = frames_us[max(0, bisect_right(frames_us, exposed_us) - 1)]
        behind = bisect_left(attitudes_us, exposed_us)
        ready_us = max(sent_us, attitudes_us[behind]) if behind < len(attitudes_us) else sent_us
        total.append((arrived_us - sent_us) / 1e3)
        software.append((arrived_us - ready_us) / 1e3)
    before, after = usage
    return LatencyFigures(
        *size,
        seconds=seconds,
        frames=len(received),
        rate_hz=len(received) / seconds,
        total_median_ms=statistics.median(total),
        total_p95_ms=_percentile(total, 0.95),
        software_median_ms=statistics.median(software),
        software_p95_ms=_percentile(software, 0.95),
        cpu_ms_per_frame=(after.cpu_s - before.cpu_s) * 1e3 / len(received),
        rss_mb=after.rss_bytes / 1e6,
        growth_mb_per_10_min=growth_per_s / 1e6 * 600,
    )


def _percentile(values: list[float], share: float) -> float:
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]
