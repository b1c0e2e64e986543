"""Carries out requests to land: one thread, one command at a time, answers come back as samples."""

import logging
import queue
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Literal

from companion.core.command import NAV_LAND
from companion.core.core import LandRequest
from drivers.autopilot.outcome import Outcome
from drivers.errors import DriverError
from drivers.events import DriverEvent
from drivers.mavlink.link import Link
from drivers.samples import CommandAnswer, Sample
from drivers.system.host_clock import now_us

if TYPE_CHECKING:
    from drivers.autopilot.autopilot import Autopilot

log = logging.getLogger(__name__)

CONNECT_S = 0.5
LONGEST_WAIT_S = 1.0
"""An order that waited longer behind another one is not carried out: what it was given for has passed."""
TOO_LATE = "TOO_LATE"
AMBIGUOUS_VEHICLE = "AMBIGUOUS_VEHICLE"
LONGEST_COMMAND_S = 12.0
"""MAVSDK gives up after 10 s at the latest."""

Order = Literal["land", "hold"]


class Commander:
    """Owns MAVSDK. ``on_samples`` gets an answer where the autopilot gave none, ``on_event`` how a hold ended.

    The autopilot's own answers reach the pipeline through the link, like all its messages.
    """

    def __init__(
        self,
        link: Link,
        on_samples: Callable[[list[Sample]], None],
        on_event: Callable[[DriverEvent], None] = lambda event: None,
    ) -> None:
        self._link = link
        self._on_samples = on_samples
        self._on_event = on_event
        self._autopilot: Autopilot | None = None
        self._orders: queue.SimpleQueue[tuple[Order, float]] = queue.SimpleQueue()
        self._open = 0
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="commander", daemon=True)

    def start(self) -> None:
        """Begin: MAVSDK connects as soon as the link knows the vehicle."""
        self._thread.start()

    @property
    def busy(self) -> bool:
        """Whether a command waits or is under way."""
        return self._open > 0

    @property
    def connected(self) -> bool:
        """Whether MAVSDK has found the vehicle."""
        return self._autopilot is not None and self._autopilot.connected

    def request(self, request: LandRequest) -> None:
        """Send MAV_CMD_NAV_LAND, once; returns at once."""
        log.info("landing requested at frame %s", request.frame)
        self._order("land")

    def hold(self) -> None:
        """Ask the autopilot to hold; returns at once."""
        self._order("hold")

    def close(self, timeout_s: float = LONGEST_COMMAND_S) -> bool:
        """Let a command under way get its answer; False when it did not in time (MAVSDK is then left alone)."""
        self._stop.set()
        self._thread.join(timeout=timeout_s)
        if self._thread.is_alive():
            return False
        if self._autopilot is not None:
            self._autopilot.close()
        return True

    def _order(self, order: Order) -> None:
        with self._lock:
            self._open += 1
        self._orders.put((order, time.monotonic()))

    def _run(self) -> None:
        # Here and not above: MAVSDK is slow to import, and nobody waits for it before there is a vehicle.
        from drivers.autopilot.autopilot import Autopilot

        self._autopilot = Autopilot(self._link)
        while not (self._stop.is_set() and self._orders.empty()):
            self._connect(self._autopilot)
            try:
                order, given = self._orders.get(timeout=0.1)
            except queue.Empty:
                continue
            self._carry_out(self._autopilot, order, time.monotonic() - given)
            with self._lock:
                self._open -= 1

    def _connect(self, autopilot: "Autopilot") -> None:
        if not autopilot.connected and not self._stop.is_set():
            try:
                autopilot.connect(CONNECT_S)
            except DriverError as error:
                log.error("%s", error)
                self._stop.wait(CONNECT_S)

    def _carry_out(self, autopilot: "Autopilot", order: Order, age_s: float) -> None:
        if age_s > LONGEST_WAIT_S:
            outcome = Outcome(TOO_LATE, (), "not called")
        elif self._link.ambiguous:
            outcome = Outcome(AMBIGUOUS_VEHICLE, (), "not called")
        elif order == "hold":
            outcome = autopilot.hold()
        else:
            outcome = autopilot.land()
        log.info("%s: %s (MAVSDK: %s)", order, outcome.result.lower().replace("_", " "), outcome.mavsdk)
        if order == "hold":
            done = outcome.result == "ACCEPTED"
            words = outcome.result.lower().replace("_", " ")
            name, severity = ("hold_accepted", "info") if done else ("hold_failed", "error")
            self._on_event(DriverEvent(name, severity, f"hold: {words}", now_us()))
        elif outcome.result not in outcome.answers:
            self._on_samples([CommandAnswer(now_us(), NAV_LAND, outcome.result)])
