"""Carries out orders to the autopilot: one thread, one command at a time, answers come back as samples.

Velocities do not wait in its queue: they go out at once, past the link's gate, which a takeover has shut by then.
"""

import logging
import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from companion.core.command import NAV_LAND
from companion.core.core import LandRequest
from drivers.autopilot.outcome import ENDED, NO_AUTOPILOT, Outcome
from drivers.errors import DriverError
from drivers.events import DriverEvent
from drivers.mavlink.link import Link
from drivers.samples import CommandAnswer, Sample, Vector3
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

Name = Literal["land", "hold", "start", "stop", "drop"]


@dataclass(frozen=True, slots=True)
class _Order:
    """``given_in``: the flight mode when it was given; it is carried out in no other."""

    name: Name
    given: float
    given_in: str | None
    yaw: float = 0.0
    limit_m_s: float = 0.0
    lease_s: float = 0.0


class Commander:
    """Owns MAVSDK. ``on_samples`` gets an answer where the autopilot gave none, ``on_event`` how a hold ended.

    The autopilot's own answers reach the pipeline through the link, like all its messages. ``on_target``: landings
    follow LANDING_TARGET, which on PX4 is a flight mode of its own.
    """

    def __init__(
        self,
        link: Link,
        on_samples: Callable[[list[Sample]], None],
        on_event: Callable[[DriverEvent], None] = lambda event: None,
        *,
        on_target: bool = False,
    ) -> None:
        self._link = link
        self._on_target = on_target
        self._on_samples = on_samples
        self._on_event = on_event
        self._autopilot: Autopilot | None = None
        self._orders: queue.SimpleQueue[_Order] = queue.SimpleQueue()
        self._open = 0
        self._steering = False
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

    def take_over(self, given_in: str, yaw: float, limit_m_s: float, lease_s: float) -> None:
        """Begin to fly by velocities of at most ``limit_m_s``, each good for ``lease_s``; returns at once."""
        self._steering = True
        self._put(_Order("start", time.monotonic(), given_in, yaw, limit_m_s, lease_s))

    def velocity(self, velocity_ned: Vector3) -> bool:
        """Fly with a velocity from now on; False when it did not go out."""
        offboard = self._autopilot.offboard if self._autopilot is not None else None
        return self._steering and offboard is not None and offboard.velocity(velocity_ned)

    def give_back(self) -> None:
        """End the velocities, and have the autopilot hold; returns at once."""
        if self._steering:
            self._steering = False
            self._link.gate.shut()
            self._order("stop")

    def let_go(self) -> None:
        """End the velocities without a word: the pilot flies, or a failsafe; returns at once."""
        if self._steering:
            self._steering = False
            self._link.gate.shut()
            self._order("drop")

    def close(self, timeout_s: float = LONGEST_COMMAND_S) -> bool:
        """Give back what is flown by us, and let a command under way get its answer.

        False when it did not in time (MAVSDK is then left alone).
        """
        self.give_back()
        self._stop.set()
        self._thread.join(timeout=timeout_s)
        if self._thread.is_alive():
            return False
        if self._autopilot is not None:
            self._autopilot.close()
        return True

    def _order(self, name: Name) -> None:
        self._put(_Order(name, time.monotonic(), self._link.gate.mode))

    def _put(self, order: _Order) -> None:
        with self._lock:
            self._open += 1
        self._orders.put(order)

    def _run(self) -> None:
        # Here and not above: MAVSDK is slow to import, and nobody waits for it before there is a vehicle.
        from drivers.autopilot.autopilot import Autopilot

        self._autopilot = Autopilot(self._link)
        while not (self._stop.is_set() and self._orders.empty()):
            self._connect(self._autopilot)
            try:
                order = self._orders.get(timeout=0.1)
            except queue.Empty:
                continue
            self._carry_out(self._autopilot, order)
            with self._lock:
                self._open -= 1

    def _connect(self, autopilot: "Autopilot") -> None:
        if not autopilot.connected and not self._stop.is_set():
            try:
                autopilot.connect(CONNECT_S)
            except DriverError as error:
                log.error("%s", error)
                self._stop.wait(CONNECT_S)

    def _carry_out(self, autopilot: "Autopilot", order: _Order) -> None:
        outcome = self._outcome(autopilot, order)
        words = outcome.result.lower().replace("_", " ")
        log.info("%s: %s (MAVSDK: %s)", order.name, words, outcome.mavsdk)
        if order.name == "hold":
            done = outcome.result == "ACCEPTED"
            name, severity = ("hold_accepted", "info") if done else ("hold_failed", "error")
            self._on_event(DriverEvent(name, severity, f"hold: {words}", now_us()))
        elif order.name == "land" and outcome.result not in outcome.answers:
            result = TOO_LATE if outcome.result == ENDED else outcome.result
            self._on_samples([CommandAnswer(now_us(), NAV_LAND, result)])

    def _outcome(self, autopilot: "Autopilot", order: _Order) -> Outcome:
        offboard = autopilot.offboard
        late = time.monotonic() - order.given > LONGEST_WAIT_S
        if offboard is not None and (order.name == "drop" or (order.name == "stop" and late)):
            offboard.drop()
            return Outcome("DROPPED", (), "not called")
        if late:
            return Outcome(TOO_LATE, (), "not called")
        if self._link.ambiguous:
            return Outcome(AMBIGUOUS_VEHICLE, (), "not called")
        if order.name == "hold":
            return autopilot.hold()
        if order.name == "land":
            land = autopilot.land_on_target if self._on_target else autopilot.land
            outcome = land(order.given_in)
            if self._steering and offboard is not None:
                self._steering = False
                offboard.drop()
            return outcome
        if offboard is None or (order.name == "start" and not self._steering):
            return Outcome(NO_AUTOPILOT, (), "not called")
        if order.name == "stop":
            return offboard.stop()
        return offboard.start(order.given_in or "", order.yaw, order.limit_m_s, order.lease_s)
