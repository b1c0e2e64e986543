"""Many simulated vehicles under one router: how much gets lost and how late the rest is."""

import multiprocessing
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from multiprocessing.sharedctypes import Synchronized
from multiprocessing.synchronize import Event as ProcessEvent
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from companion.errors import LandslopeError
from companion.messages.messages import Estimate, encode, estimate_message
from drivers.bus import Bus, Endpoints, Subscription, open_session
from landing.estimate import SurfaceEstimate
from landing.options import Limits
from landing.reasons import Certainty, Code, Reason

START_TIMEOUT_S = 60.0
POLL_S = 0.2
SETTLE_S = 1.0
MS = 1e3


@dataclass(frozen=True, slots=True)
class FleetOptions:
    """What is simulated."""

    vehicles: Annotated[int, Limits(1, 500, "", "simulated vehicles")] = 20
    rate_hz: Annotated[float, Limits(0.1, 500, "Hz", "estimates a second and vehicle")] = 30.0
    duration_s: Annotated[float, Limits(0.5, 3600, "s", "how long they publish")] = 10.0


@dataclass(frozen=True, slots=True)
class FleetReport:
    """What came of it. ``latency_ms`` is (n,): from before the put to the watcher's hands, same clock."""

    vehicles: int
    sent: int
    received: int
    duplicated: int
    vehicles_heard: int
    latency_ms: NDArray[np.float64]

    @property
    def lost(self) -> int:
        """Messages that never arrived."""
        return self.sent - self.received

    def lines(self) -> list[str]:
        """For people."""
        found = [
            f"vehicles heard   {self.vehicles_heard} of {self.vehicles}",
            f"messages sent    {self.sent}",
            f"received         {self.received}",
            f"lost             {self.lost} ({100 * self.lost / max(1, self.sent):.3f} %)",
            f"duplicated       {self.duplicated}",
        ]
        if len(self.latency_ms):
            p50, p95, p99 = np.percentile(self.latency_ms, (50, 95, 99))
            found.append(
                f"latency          median {p50:.2f} ms, p95 {p95:.2f} ms, p99 {p99:.2f} ms,"
                f" max {self.latency_ms.max():.2f} ms"
            )
        return found


def free_endpoint() -> str:
    """A TCP endpoint on loopback that nobody listens on now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def embedded_router(endpoint: str) -> Iterator[None]:
    """A zenoh router in a process of its own, as long as the context lasts."""
    with _process(_route, endpoint):
        yield


def measure(options: FleetOptions, router: str = "") -> FleetReport:
    """Publish from simulated vehicles, receive as one watcher. Without ``router`` one is started."""
    if router:
        return _measure(options, router)
    endpoint = free_endpoint()
    with embedded_router(endpoint):
        return _measure(options, endpoint)


def _measure(options: FleetOptions, router: str) -> FleetReport:
    context = multiprocessing.get_context("spawn")
    sent = context.Value("q", 0)
    with (
        Subscription(Endpoints(mode="client", connect=(router,)), topics=("estimate",)) as watcher,
        _process(_publish, router, options, sent) as publisher,
    ):
        latencies, seen, duplicated = _receive(watcher, publisher)
    return FleetReport(
        vehicles=options.vehicles,
        sent=sent.value,
        received=len(seen),
        duplicated=duplicated,
        vehicles_heard=len({vehicle for vehicle, _ in seen}),
        latency_ms=np.array(latencies),
    )


@contextmanager
def _process(target: Callable[..., None], *args: object) -> Iterator[BaseProcess]:
    context = multiprocessing.get_context("spawn")
    ready, stop = context.Event(), context.Event()
    process = context.Process(target=target, args=(ready, stop, *args), daemon=True)
    process.start()
    try:
        if not ready.wait(START_TIMEOUT_S):
            raise LandslopeError(f"a process of the measurement did not start within {START_TIMEOUT_S:g} s")
        yield process
    finally:
        stop.set()
        process.join(START_TIMEOUT_S)
        if process.is_alive():
            process.kill()
            process.join()


def _route(ready: ProcessEvent, stop: ProcessEvent, endpoint: str) -> None:
    session = open_session(Endpoints(mode="router", listen=(endpoint,)))
    ready.set()
    stop.wait()
    session.close()


def _publish(
    ready: ProcessEvent, stop: ProcessEvent, router: str, options: FleetOptions, sent: "Synchronized[int]"
) -> None:
    buses = [Bus(f"sim{i}", Endpoints(mode="client", connect=(router,))) for i in range(options.vehicles)]
    # Declarations travel on their own; publishing before the watcher's has arrived would count as loss.
    time.sleep(SETTLE_S)
    ready.set()
    period_s = 1 / options.rate_hz
    start = time.monotonic()
    for number in range(max(1, round(options.duration_s * options.rate_hz))):
        for i, bus in enumerate(buses):
            due = start + (number + i / len(buses)) * period_s
            delay = due - time.monotonic()
            if delay > 0 and stop.wait(delay):
                return
            bus.put("estimate", encode(_estimate(number)))
            sent.value += 1
    time.sleep(SETTLE_S)
    for bus in buses:
        bus.close()


def _estimate(number: int) -> Estimate:
    surface = SurfaceEstimate(
        frame=number,
        time_s=0.0,
        status="ok",
        method="map",
        ventral_flow_x=0.123456,
        ventral_flow_y=-0.123456,
        divergence=0.05,
        time_to_contact_s=40.0,
        slope_x_deg=12.3456,
        slope_y_deg=-1.2345,
        slope_x_std_deg=0.1234,
        slope_y_std_deg=0.1234,
        inclination_deg=12.4,
        inclination_std_deg=0.2,
        roughness=0.004,
        features=150,
        inlier_fraction=0.95,
        fit_error_px=0.12,
        against_flat=(Reason(Code.TOO_STEEP, Certainty.CERTAIN, 12.4, limit=10.0),),
    )
    return estimate_message(surface, time.time_ns() // 1000, None, True)


def _receive(watcher: Subscription, publisher: BaseProcess) -> tuple[list[float], set[tuple[str, int]], int]:
    latencies: list[float] = []
    seen: set[tuple[str, int]] = set()
    duplicated = 0
    decoder = msgspec.json.Decoder(Estimate)
    while True:
        delivery = watcher.receive(POLL_S)
        if delivery is None:
            if not publisher.is_alive():
                return latencies, seen, duplicated
            continue
        if delivery.alive is not None:
            continue
        estimate = decoder.decode(delivery.payload)
        latencies.append((time.time_ns() / 1000 - estimate.time_unix_us) / MS)
        here = (delivery.vehicle, estimate.frame)
        duplicated += here in seen
        seen.add(here)
