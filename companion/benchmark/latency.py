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

from companion.benchmark.latency_peers import FRAME_RATE_HZ, Background, PictureServer, Telemetry
from companion.benchmark.measured_daemon import MeasuredDaemon, Received, Spent, free_port
from companion.errors import LandslopeError

SETTLE_S = 3.0
KEPT_UP = 0.97
"""Share of the camera's frames from which the daemon counts as keeping up."""
BY_TIME = ("link", "camera")
"""Parts whose work comes at the rates of telemetry and camera, whatever the pipeline does."""
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
    """Processor time of the whole process."""
    pipeline_ms_per_frame: float
    """That of the pipeline's steps alone, in the same process and over the same frames."""
    parts_ms_per_frame: dict[str, float]
    """That of the threads, by what they are for; the core's contains the pipeline's."""
    rss_mb: float
    growth_mb_per_10_min: float
    """Slope of the resident memory over the second half of the run; means something after LONG_S only."""

    @property
    def cost_ratio(self) -> float:
        """The whole daemon's processor time over its pipeline's, for a frame of a daemon that keeps up.

        Where frames were skipped, link and camera worked for those too: their part counts by the camera's frames.
        """
        every_frame_ms = sum(self.parts_ms_per_frame.get(kind, 0.0) for kind in BY_TIME)
        skipped_ms = every_frame_ms * (1 - min(1.0, self.rate_hz / FRAME_RATE_HZ))
        return (self.cpu_ms_per_frame - skipped_ms) / self.pipeline_ms_per_frame


def measure(width: int, height: int, seconds: float) -> LatencyFigures:
    """Run the daemon at one image size for ``seconds``. Raises LandslopeError when it does not come up."""
    with ExitStack() as stack:
        pictures = stack.enter_context(PictureServer(width, height))
        link = free_port(socket.SOCK_DGRAM)
        telemetry = stack.enter_context(Telemetry(link))
        daemon = stack.enter_context(MeasuredDaemon(pictures.port, link))
        daemon.wait_for(lambda estimate: True)
        daemon.collect(SETTLE_S)
        before = daemon.spent()
        watch = stack.enter_context(_MemoryWatch(daemon.pid))
        received = daemon.collect(seconds)
        after, rss_bytes = daemon.spent(), _rss_bytes(daemon.pid)
        return _figures(
            (width, height),
            seconds,
            received,
            (before, after),
            rss_bytes,
            watch.growth_per_s(),
            pictures.sent_us,
            telemetry.sent_us,
        )


def table(figures: list[LatencyFigures]) -> str:
    """The figures as text, one line a size."""
    head = (
        f"{'size':>10} {'frames':>7} {'Hz':>6} {'capture to sample, ms':>22} {'of it software, ms':>19} "
        f"{'CPU ms/frame':>13} {'of it pipeline':>15} {'ratio':>6} {'RSS MB':>7} {'MB/10 min':>10}"
    )
    lines = [head, f"{'':>10} {'':>7} {'':>6} {'median / p95':>22} {'median / p95':>19}"]
    for f in figures:
        growth = f"{f.growth_mb_per_10_min:.1f}" if f.seconds >= LONG_S else "-"
        lines.append(
            f"{f'{f.width}x{f.height}':>10} {f.frames:>7} {f.rate_hz:>6.1f} "
            f"{f'{f.total_median_ms:.1f} / {f.total_p95_ms:.1f}':>22} "
            f"{f'{f.software_median_ms:.1f} / {f.software_p95_ms:.1f}':>19} "
            f"{f.cpu_ms_per_frame:>13.2f} {f.pipeline_ms_per_frame:>15.2f} {f.cost_ratio:>6.2f} "
            f"{f.rss_mb:>7.0f} {growth:>10}"
        )
    lines.append("")
    for f in figures:
        if f.rate_hz < KEPT_UP * FRAME_RATE_HZ:
            lines.append(
                f"{f'{f.width}x{f.height}':>10} too busy: {f.rate_hz:.1f} of {FRAME_RATE_HZ:.0f} frames a second; a "
                "frame's cost contains what came in for those that were skipped, the ratio does not"
            )
        parts = {"pipeline": f.pipeline_ms_per_frame, **f.parts_ms_per_frame}
        parts["core"] = parts.get("core", 0.0) - f.pipeline_ms_per_frame
        words = ", ".join(f"{name} {ms:.2f}" for name, ms in parts.items())
        lines.append(f"{f'{f.width}x{f.height}':>10} CPU ms a frame by part: {words}")
    return "\n".join(lines)


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
                self._points.append((time.monotonic(), _rss_bytes(self._pid)))
            except OSError:
                return  # the process ended


def _rss_bytes(pid: int) -> int:
    """Resident memory of a process, from /proc."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def _figures(
    size: tuple[int, int],
    seconds: float,
    received: list[Received],
    spent: tuple[Spent, Spent],
    rss_bytes: int,
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
    before, after = spent
    frames = after.frames - before.frames
    if frames < 1:
        raise LandslopeError(f"the daemon's pipeline made no step in {seconds:g} s: nothing to measure")
    return LatencyFigures(
        *size,
        seconds=seconds,
        frames=len(received),
        rate_hz=len(received) / seconds,
        total_median_ms=statistics.median(total),
        total_p95_ms=_percentile(total, 0.95),
        software_median_ms=statistics.median(software),
        software_p95_ms=_percentile(software, 0.95),
        cpu_ms_per_frame=(after.process_ms - before.process_ms) / frames,
        pipeline_ms_per_frame=(after.pipeline_ms - before.pipeline_ms) / frames,
        parts_ms_per_frame={
            kind: (ms - before.threads_ms.get(kind, 0.0)) / frames for kind, ms in after.threads_ms.items()
        },
        rss_mb=rss_bytes / 1e6,
        growth_mb_per_10_min=growth_per_s / 1e6 * 600,
    )


def _percentile(values: list[float], share: float) -> float:
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]
