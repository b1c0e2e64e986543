"""What the daemon costs: latency from a frame's capture to its zenoh sample, processor time and memory, measured live.

The daemon runs as a process of its own; here a stream of pictures, a simulated autopilot's telemetry and a
subscriber stand around it. All clocks are this machine's monotonic one, so times may be subtracted.
"""

import json
import os
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from bisect import bisect_left, bisect_right
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from companion.errors import LandslopeError
from companion.latency_peers import PictureServer, Telemetry
from drivers.bus import Endpoints, Subscription
from drivers.host_clock import now_us

SETTLE_S = 3.0
START_S = 30.0


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
    """Slope of the resident memory over the second half of the run; only long runs tell a leak from a warm-up."""
    start_to_estimate_s: float


def measure(width: int, height: int, seconds: float) -> LatencyFigures:
    """Run the daemon at one image size for ``seconds``. Raises LandslopeError when it does not come up."""
    with ExitStack() as stack:
        directory = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="landslope-benchmark-")))
        pictures = stack.enter_context(PictureServer(width, height))
        link, bus = _free_port(socket.SOCK_DGRAM), _free_port(socket.SOCK_STREAM)
        telemetry = stack.enter_context(Telemetry(link))
        name = f"benchmark{bus}"
        settings = (
            f"camera.source=http://127.0.0.1:{pictures.port}/",
            f"mavlink.connection=udpin:127.0.0.1:{link}",
            f"zenoh.listen=tcp/127.0.0.1:{bus}",
            f"vehicle.name={name}",
        )
        started = time.monotonic()
        process = _daemon(settings, directory)
        stack.callback(_end, process)
        subscription = stack.enter_context(Subscription(Endpoints(connect=(f"tcp/127.0.0.1:{bus}",)), name))
        first_s = _wait_for_estimate(subscription, process, started)
        _collect(subscription, SETTLE_S)
        before = _usage(process.pid)
        watch = stack.enter_context(_MemoryWatch(process.pid))
        received = _collect(subscription, seconds)
        after = _usage(process.pid)
        return _figures(
            (width, height),
            seconds,
            received,
            (before, after),
            watch.growth_per_s(),
            pictures.sent_us,
            telemetry.sent_us,
            first_s,
        )


def table(figures: list[LatencyFigures]) -> str:
    """The figures as text, one line a size."""
    head = (
        f"{'size':>10} {'frames':>7} {'Hz':>6} {'capture to sample, ms':>22} {'of it software, ms':>19} "
        f"{'CPU ms/frame':>13} {'RSS MB':>7} {'MB/10 min':>10}"
    )
    lines = [head, f"{'':>10} {'':>7} {'':>6} {'median / p95':>22} {'median / p95':>19}"]
    for f in figures:
        lines.append(
            f"{f'{f.width}x{f.height}':>10} {f.frames:>7} {f.rate_hz:>6.1f} "
            f"{f'{f.total_median_ms:.1f} / {f.total_p95_ms:.1f}':>22} "
            f"{f'{f.software_median_ms:.1f} / {f.software_p95_ms:.1f}':>19} "
            f"{f.cpu_ms_per_frame:>13.1f} {f.rss_mb:>7.0f} {f.growth_mb_per_10_min:>10.1f}"
        )
    return "\n".join(lines)


def _daemon(settings: tuple[str, ...], directory: Path) -> "subprocess.Popen[bytes]":
    arguments = [argument for setting in settings for argument in ("--set", setting)]
    return subprocess.Popen(
        [sys.executable, "-m", "companion.cli", "run", *arguments],
        stderr=(directory / "log").open("wb"),
        env=os.environ | {"XDG_RUNTIME_DIR": str(directory)},
    )


def _end(process: "subprocess.Popen[bytes]") -> None:
    process.send_signal(signal.SIGTERM)
    try:
        process.wait(15)
    except subprocess.TimeoutExpired:
        process.kill()


def _wait_for_estimate(
    subscription: Subscription, process: "subprocess.Popen[bytes]", started: float
) -> float:
    while time.monotonic() - started < START_S:
        delivery = subscription.receive(0.1)
        if delivery is not None and delivery.topic == "estimate":
            return time.monotonic() - started
        if process.poll() is not None:
            raise LandslopeError(
                f"the daemon ended with {process.returncode}: run 'landslope run' to see why"
            )
    raise LandslopeError(f"the daemon made no estimate within {START_S:g} s: run 'landslope run' to see why")


def _collect(subscription: Subscription, seconds: float) -> list[tuple[int, dict[str, object]]]:
    """(arrival in us, estimate) of everything that comes."""
    until = time.monotonic() + seconds
    received = []
    while time.monotonic() < until:
        delivery = subscription.receive(0.1)
        if delivery is not None and delivery.topic == "estimate":
            received.append((now_us(), json.loads(delivery.payload)))
    return received


@dataclass(frozen=True, slots=True)
class _Usage:
    cpu_s: float
    rss_bytes: int


class _MemoryWatch:
    """Looks at a process's resident memory twice a second."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._points: list[tuple[float, int]] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> "_MemoryWatch":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

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
    received: list[tuple[int, dict[str, object]]],
    usage: tuple[_Usage, _Usage],
    growth_per_s: float,
    frames_us: list[int],
    attitudes_us: list[int],
    first_s: float,
) -> LatencyFigures:
    if len(received) < 2:
        raise LandslopeError(
            f"the daemon made {len(received)} estimates in {seconds:g} s: nothing to measure"
        )
    total, software = [], []
    for arrived_us, estimate in received:
        exposed_us = int(str(estimate["time_unix_us"]))
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
        start_to_estimate_s=first_s,
    )


def _percentile(values: list[float], share: float) -> float:
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def _free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])
