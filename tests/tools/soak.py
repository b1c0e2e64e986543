"""A long time compressed: the real daemon while its camera, autopilot and router come and go and recordings roll over.

    python tests/tools/soak.py --minutes 25 --out FOLDER

In every cycle the camera's server, the router and the autopilot's telemetry go away for a tenth of it, one after
the other, and SIGHUP is sent once. Recordings begin a new folder every few megabytes and keep a limit for all by
deleting the oldest. Memory, threads and open files of the process are read every second; their slope over the second
half of the run is the result.
"""

import argparse
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.benchmark.latency_peers import PictureServer, Telemetry
from companion.benchmark.measured_daemon import free_port
from drivers.bus import Endpoints, Subscription

VEHICLE = "soak"
SIZE = 160, 120
AWAY = {"camera": (0.2, 0.3), "router": (0.45, 0.55), "autopilot": (0.7, 0.8)}
"""When each is away, as shares of a cycle."""
TOPICS = ("health", "event")
END_S = 30.0
STEP_S = 0.2
SETTLING = 0.5
"""Share of the run that is left out of the slopes: caches and pools fill."""


@dataclass(frozen=True, slots=True)
class Slope:
    """A straight line through a quantity: growth an hour, its standard deviation, first and last value of the line."""

    per_hour: float
    std: float
    first: float
    last: float


def slope(times_s: NDArray[np.float64], values: NDArray[np.float64], blocks: int = 10) -> Slope:
    """Least squares over (n,) samples; the standard deviation by leaving out one stretch after another (jackknife)."""
    if len(times_s) < 2 * blocks:
        raise ValueError(f"{len(times_s)} samples: at least {2 * blocks} are needed")
    hours = times_s / 3600
    growth, at_zero = np.polyfit(hours, values, 1)
    parts = np.array_split(np.arange(len(hours)), blocks)
    without = np.array([np.polyfit(np.delete(hours, p), np.delete(values, p), 1)[0] for p in parts])
    std = float(np.sqrt((blocks - 1) / blocks * ((without - growth) ** 2).sum()))
    return Slope(float(growth), std, float(at_zero + growth * hours[0]), float(at_zero + growth * hours[-1]))


def away(share: float) -> frozenset[str]:
    """Who is away at this share of a cycle."""
    return frozenset(name for name, (since, until) in AWAY.items() if since <= share < until)


def of_process(pid: int) -> tuple[float, int, int]:
    """Resident memory in MB, threads, open files."""
    text = Path(f"/proc/{pid}/status").read_text()
    fields = dict(line.split(":", 1) for line in text.splitlines() if ":" in line)
    files = len(os.listdir(f"/proc/{pid}/fd"))
    return int(fields["VmRSS"].split()[0]) / 1e3, int(fields["Threads"]), files


def size_mb(folder: Path) -> float:
    """Size of all files below a folder, in MB; files that go away meanwhile are left out."""
    total = 0
    for path in folder.rglob("*"):
        try:
            total += path.stat().st_size if path.is_file() else 0
        except FileNotFoundError:
            continue
    return total / 1e6


class Soak:
    """The daemon in a process of its own, and what it is connected to."""

    def __init__(self, out: Path, flight_mb: int, total_mb: int) -> None:
        self.flights = out / "flights"
        self.flights.mkdir(parents=True, exist_ok=True)
        self._ports = {
            "camera": free_port(socket.SOCK_STREAM),
            "router": free_port(socket.SOCK_STREAM),
            "autopilot": free_port(socket.SOCK_DGRAM),
        }
        self._there: dict[str, Any] = {}
        self._config = out / "landslope.toml"
        self._config.write_text(
            f"""[vehicle]
name = "{VEHICLE}"
[camera]
source = "http://127.0.0.1:{self._ports["camera"]}/"
read_timeout_s = 1.0
[mavlink]
connection = "udpin:127.0.0.1:{self._ports["autopilot"]}"
[zenoh]
connect = ["tcp/127.0.0.1:{self._ports["router"]}"]
scouting = false
[record]
directory = "{self.flights}"
when = "always"
max_flight_mb = {flight_mb}
max_total_mb = {total_mb}
when_full = "delete_oldest"
min_free_mb = 1
"""
        )
        self.heard: Counter[str] = Counter()
        self.health: dict[str, Any] = {}
        self._log = (out / "log").open("wb")
        self.process = subprocess.Popen(
            [sys.executable, "-m", "companion.cli", "run", "--config", str(self._config)],
            stderr=self._log,
            env=os.environ | {"XDG_RUNTIME_DIR": str(out)},
        )

    def arrange(self, gone: frozenset[str]) -> None:
        """Let those go who are to be away, and the others come."""
        for name, port in self._ports.items():
            if name in gone and name in self._there:
                self._there.pop(name).close()
            elif name not in gone and name not in self._there:
                self._there[name] = self._come(name, port)

    def _come(self, name: str, port: int) -> ExitStack:
        stack = ExitStack()
        if name == "camera":
            stack.enter_context(PictureServer(*SIZE, port))
        elif name == "autopilot":
            stack.enter_context(Telemetry(port))
        else:
            endpoints = Endpoints(listen=(f"tcp/127.0.0.1:{port}",))
            self._subscription = stack.enter_context(Subscription(endpoints, VEHICLE, TOPICS))
        return stack

    def listen(self) -> None:
        """Take what the vehicle publishes, where the router is there."""
        if "router" not in self._there:
            time.sleep(STEP_S)
            return
        until = time.monotonic() + STEP_S
        while (left_s := until - time.monotonic()) > 0:
            delivery = self._subscription.receive(left_s)
            if delivery is None:
                continue
            if delivery.topic not in TOPICS:
                continue
            message = json.loads(delivery.payload)
            if delivery.topic == "health":
                self.health = message
            self.heard[message.get("event", delivery.topic)] += 1

    def end(self) -> float:
        """End everything; seconds from SIGTERM to the end of the process, NaN where it had to be killed."""
        asked = time.monotonic()
        self.process.send_signal(signal.SIGTERM)
        try:
            self.process.wait(END_S)
            took_s = time.monotonic() - asked
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            took_s = float("nan")
        self.arrange(frozenset(self._ports))
        self._log.close()
        return took_s


def run(out: Path, minutes: float, cycle_s: float, flight_mb: int, total_mb: int) -> dict[str, Any]:
    """The whole soak; its figures by name."""
    soak = Soak(out, flight_mb, total_mb)
    started = time.monotonic()
    rows: list[tuple[float, float, int, int, float]] = []
    cycle, names = -1, set()
    try:
        while (at_s := time.monotonic() - started) < 60 * minutes and soak.process.poll() is None:
            if int(at_s / cycle_s) > cycle:
                cycle = int(at_s / cycle_s)
                if rows:
                    soak.process.send_signal(signal.SIGHUP)
            soak.arrange(away(at_s % cycle_s / cycle_s))
            soak.listen()
            if not rows or at_s - rows[-1][0] >= 1.0:
                rows.append((at_s, *of_process(soak.process.pid), size_mb(soak.flights)))
                names |= {path.name for path in soak.flights.iterdir()}
    finally:
        code = soak.process.poll()
        took_s = soak.end()
    table = np.array(rows)
    (out / "samples.csv").write_text(
        "seconds,rss_mb,threads,files,flights_mb\n"
        + "\n".join(",".join(f"{v:g}" for v in row) for row in rows)
    )
    settled = table[table[:, 0] > SETTLING * table[-1, 0]]
    slopes = {
        name: slope(settled[:, 0], settled[:, column])
        for column, name in enumerate(("rss_mb", "threads", "files"), start=1)
    }
    counters = soak.health.get("counters", {})
    return {
        "minutes": table[-1, 0] / 60,
        "cycles": cycle + 1,
        "ended_early_with": code,
        "end_s": took_s,
        "slopes": slopes,
        "rss_mb": (
            table[0, 1],
            float(np.interp(0.5, (0, 1), (settled[0, 1], settled[-1, 1]))),
            table[:, 1].max(),
        ),
        "frames": counters.get("camera delivered", 0),
        "reopened": counters.get("camera reopened", 0),
        "folders": len(names),
        "kept": len(list(soak.flights.iterdir())),
        "largest_total_mb": table[:, 4].max(),
        "heard": soak.heard,
    }


def main() -> int:
    """0 when the daemon lived to the end and its limit and memory held."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=25.0, help="how long (25)")
    parser.add_argument("--cycle", type=float, default=24.0, help="seconds of a cycle (24)")
    parser.add_argument("--flight-mb", type=int, default=5, help="record.max_flight_mb (5)")
    parser.add_argument("--total-mb", type=int, default=50, help="record.max_total_mb (50)")
    parser.add_argument(
        "--max-growth", type=float, default=0.5, help="MB of memory an hour of 24 compressed (0.5)"
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for flights, log and samples")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    found = run(args.out.resolve(), args.minutes, args.cycle, args.flight_mb, args.total_mb)
    rss: Slope = found["slopes"]["rss_mb"]
    compressed = 60 * 24 / found["minutes"]
    for name, value in found.items():
        print(f"{name}: {value}")
    print(f"memory: {rss.per_hour:+.2f} +- {rss.std:.2f} MB an hour of the run,")
    print(
        f"  {rss.per_hour / compressed:+.3f} +- {rss.std / compressed:.3f} MB an hour of 24 h with as many events"
    )
    too_large = found["largest_total_mb"] > args.total_mb + 2 * args.flight_mb
    grows = rss.per_hour / compressed > args.max_growth
    lived = found["ended_early_with"] is None and found["end_s"] < END_S
    return 0 if lived and not too_large and not grows else 1


if __name__ == "__main__":
    raise SystemExit(main())
