"""How late the page is, and whether it grows: run with ``PYTHONPATH=tests/support:tests/stand_ins``; needs Chromium.

Ten vehicles publish ten estimates a second each. Latency is from the publishing of an estimate to the picture of the
page that shows its frame number, by the clock of this machine; growth is that of Chromium's heap after a collection,
and the monitor's resident memory.
"""

import argparse
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from monitor_support import Browser, Monitor, Vehicle, decision, health, show
from ports import free_endpoint, free_tcp_port

from companion.messages.messages import Decision, Estimate, Event, Health
from drivers.bus import Endpoints, open_session

VEHICLES = 10
SETTLE_S = 10.0
SAMPLES = 8
WATCH = """
if (window.seen) return;
window.seen = [];
const shown = document.querySelector('[data-field=frame]');
new MutationObserver(() => {
  const frame = Number(shown.textContent.match(/frame (\\d+)/)[1]);
  requestAnimationFrame(() => window.seen.push([frame, Date.now()]));
}).observe(shown, {childList: true, characterData: true, subtree: true});
"""


class Stamped(Vehicle):
    """A vehicle that remembers when it said what."""

    def __init__(self, name: str, endpoint: str) -> None:
        self.said_ms: dict[int, float] = {}
        super().__init__(name, endpoint)

    def say(self, message: Estimate | Decision | Health | Event) -> None:
        if isinstance(message, Estimate):
            self.said_ms[message.frame] = time.time() * 1e3
        super().say(message)


def heap_mb(browser: Browser) -> float:
    """What Chromium's page keeps after its garbage was collected."""
    browser.driver.execute_cdp_cmd("HeapProfiler.collectGarbage", {})
    return float(browser.driver.execute_cdp_cmd("Runtime.getHeapUsage", {})["usedSize"]) / 1e6


def measure(browser: Browser, monitor: Monitor, vehicles: list[Stamped], seconds: float) -> None:
    """Watch the first vehicle's page and print what was found."""
    show(browser, monitor, vehicles[0])
    time.sleep(SETTLE_S)
    browser.script(WATCH)
    started, growth = time.monotonic(), []
    latencies: list[float] = []
    for _ in range(SAMPLES):
        time.sleep(seconds / SAMPLES)
        seen: list[tuple[int, float]] = browser.script("return (window.seen || []).splice(0)")
        browser.script(WATCH)  # a page that lost its connection loads anew
        said = vehicles[0].said_ms
        latencies += [at_ms - said[frame] for frame, at_ms in seen if frame in said]
        growth.append((time.monotonic() - started, heap_mb(browser), monitor.rss_mb()))
    rows: list[Any] = [f"{at:6.0f} s  heap {heap:6.2f} MB  monitor {rss:6.1f} MB" for at, heap, rss in growth]
    print("\n".join(rows))
    later = np.array(growth[len(growth) // 2 :])
    for name, column in (("heap", 1), ("monitor", 2)):
        slope = float(np.polyfit(later[:, 0], later[:, column], 1)[0]) * 600
        print(f"{name}: {slope:+.2f} MB in ten minutes, by the second half")
    ordered = sorted(latencies)
    print(
        f"{len(ordered)} frames shown of {len(vehicles)} vehicles: from publishing to the picture, median "
        f"{statistics.median(ordered):.0f} ms, p95 {ordered[int(0.95 * len(ordered))]:.0f} ms"
    )


def main() -> None:
    """Set up a router, the monitor, a browser and the vehicles."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--vehicles", type=int, default=VEHICLES)
    args = parser.parse_args()
    endpoint = free_endpoint()
    port = free_tcp_port()
    with tempfile.TemporaryDirectory() as name:
        router = open_session(Endpoints(mode="router", listen=(endpoint,)))
        monitor = Monitor(port, "--connect", endpoint)
        browser = Browser(Path(name) / "profile")
        vehicles = [Stamped(f"drone-{n:02d}", endpoint) for n in range(1, args.vehicles + 1)]
        well = msgspec.structs.replace(health(), state="ok", problems=(), inputs={})
        try:
            for vehicle in vehicles:
                vehicle.say(well)
                vehicle.say(decision(verdict="fit", reasons=()))
            measure(browser, monitor, vehicles, args.seconds)
        finally:
            for vehicle in vehicles:
                vehicle.close()
            browser.close()
            monitor.close()
            router.close()


if __name__ == "__main__":
    main()
