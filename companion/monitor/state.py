"""The newest messages of every vehicle and ten minutes of history, in bounded memory, for the monitor's page.

In: deliveries of the bus and the monitor's monotonic time (s). Out: the attributes of ``Vehicle``, which the page reads
under ``Watch.lock``. This module knows neither zenoh nor the page.
"""

import threading
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import msgspec

from companion.messages.messages import Decision, Estimate, Event, Health
from companion.messages.preview import Preview
from companion.messages.received import Received, received
from companion.monitor.ground_view import Place, way_on
from companion.monitor.options import MonitorOptions
from drivers.bus import Delivery

RATE_WINDOW_S = 2.0
"""Interval over which the rate of estimates is counted."""
GROUND = "ground"
VERDICTS = ("fit", "unfit", "unknown")


@dataclass(frozen=True, slots=True)
class Point:
    """One entry of the charts and of the timeline: ``time_s`` on the monitor's clock, the rest as in ``Estimate``."""

    time_s: float
    verdict: str
    inclination_deg: float | None
    inclination_std_deg: float | None
    height_m: float | None
    height_std_m: float | None
    time_to_contact_s: float | None
    ventral_flow_x: float | None
    ventral_flow_y: float | None
    roughness: float | None
    roughness_std: float | None


def point_of(time_s: float, verdict: str, e: Estimate) -> Point:
    """The entry of an estimate."""
    return Point(
        time_s,
        verdict,
        e.inclination_deg,
        e.inclination_std_deg,
        e.height_m,
        e.height_std_m,
        e.time_to_contact_s,
        e.ventral_flow_x,
        e.ventral_flow_y,
        e.roughness,
        e.roughness_std,
    )


PATH_PLACES = 240
"""Longest ``Vehicle.path``, one place per ground message: two minutes at 2 Hz."""


@dataclass(slots=True)
class Vehicle:
    """One vehicle as the monitor knows it; None or empty where nothing was received yet."""

    name: str
    alive: bool | None = None
    """Whether its zenoh liveliness token is there; None while unknown."""
    heard_s: float | None = None
    """Arrival of its last message, on the monitor's clock."""
    silent_since_s: float | None = None
    estimate: Estimate | None = None
    decision: Decision | None = None
    health: Health | None = None
    preview: Preview | None = None
    picture: bytes = b""
    ground: dict[str, Any] | None = None
    """The newest ground message."""
    ground_map: dict[str, Any] | None = None
    """The newest one that has a map."""
    path: list[Place] = field(default_factory=list)
    """Its latest places in the map's axes (north and east, m)."""
    limits: dict[str, float] = field(default_factory=dict)
    """Limits of the decision by name, from the vehicle's own settings; empty until it has answered."""
    events: deque[Event] = field(default_factory=deque)
    points: deque[Point] = field(default_factory=deque)
    received: Counter[str] = field(default_factory=Counter)
    refused: int = 0
    missed: int = 0
    """Estimates that were lost on the way, by the gaps in the frame numbers."""
    rate_hz: float = 0.0
    rate_count: int = 0
    rate_since_s: float = 0.0


class Watch:
    """All vehicles. ``take`` may be called from another thread than the rest; ``lock`` guards the vehicles."""

    def __init__(self, options: MonitorOptions) -> None:
        self.options = options
        self.lock = threading.Lock()
        self.vehicles: dict[str, Vehicle] = {}
        self.left_out = 0
        """Deliveries of vehicles beyond the most that are kept."""
        self.listeners: list[Callable[[str, object], None]] = []
        """Called with (vehicle, message) for every message that was taken."""
        self._ground_decoder: msgspec.json.Decoder[dict[str, Any]] = msgspec.json.Decoder(dict[str, Any])

    def take(self, delivery: Delivery, now_s: float) -> None:
        """Store one delivery; one that cannot be decoded is counted in ``refused`` and ignored."""
        with self.lock:
            vehicle = self.vehicles.get(delivery.vehicle)
            if vehicle is None:
                vehicle = self._new_vehicle(delivery, now_s)
                if vehicle is None:
                    return
            if delivery.alive is not None:
                vehicle.alive = delivery.alive
                return
            if delivery.topic == GROUND:
                self._take_ground(vehicle, delivery, now_s)
                return
            message = self._decoded(delivery)
            if message is None:
                vehicle.refused += 1
                return
            self._store(vehicle, delivery, message, now_s)
        for listener in self.listeners:
            listener(delivery.vehicle, delivery if isinstance(message, Preview) else message)

    def is_silent(self, vehicle: Vehicle, now_s: float) -> bool:
        """Whether the vehicle's liveliness token is gone, or no message came for ``silent_after_s``."""
        if vehicle.alive is False:
            return True
        return vehicle.heard_s is not None and now_s - vehicle.heard_s > self.options.silent_after_s

    def tick(self, now_s: float) -> None:
        """Update ``silent_since_s`` and the rates of all vehicles; to be called a few times a second."""
        with self.lock:
            for vehicle in self.vehicles.values():
                if not self.is_silent(vehicle, now_s):
                    vehicle.silent_since_s = None
                elif vehicle.silent_since_s is None:
                    vehicle.silent_since_s = now_s if vehicle.heard_s is None else vehicle.heard_s
                if now_s - vehicle.rate_since_s >= RATE_WINDOW_S:
                    vehicle.rate_hz = vehicle.rate_count / (now_s - vehicle.rate_since_s)
                    vehicle.rate_count, vehicle.rate_since_s = 0, now_s

    def _new_vehicle(self, delivery: Delivery, now_s: float) -> Vehicle | None:
        if delivery.alive is False:
            return None
        if len(self.vehicles) >= self.options.max_vehicles and not self._make_room(now_s):
            self.left_out += 1
            return None
        options = self.options
        vehicle = Vehicle(
            delivery.vehicle,
            events=deque(maxlen=options.max_events),
            points=deque(maxlen=int(options.history_s * options.history_hz) + 1),
        )
        self.vehicles[vehicle.name] = vehicle
        return vehicle

    def _make_room(self, now_s: float) -> bool:
        """Forget the vehicle that has been silent longest, if there is one."""
        silent = [vehicle for vehicle in self.vehicles.values() if self.is_silent(vehicle, now_s)]
        if not silent:
            return False
        del self.vehicles[min(silent, key=lambda vehicle: vehicle.heard_s or 0.0).name]
        return True

    def _decoded(self, delivery: Delivery) -> Received | None:
        raw = delivery.attachment if delivery.topic == "preview" else delivery.payload
        if len(delivery.payload) + len(raw) > self.options.max_message_bytes:
            return None
        return received(delivery.topic, raw, self.options.max_message_bytes)

    def _take_ground(self, vehicle: Vehicle, delivery: Delivery, now_s: float) -> None:
        if len(delivery.payload) > self.options.max_message_bytes:
            vehicle.refused += 1
            return
        try:
            found = self._ground_decoder.decode(delivery.payload)
        except (msgspec.MsgspecError, RecursionError):
            vehicle.refused += 1
            return
        vehicle.heard_s = now_s
        vehicle.received[GROUND] += 1
        vehicle.ground = found
        vehicle.path = way_on(vehicle.path, found)[-PATH_PLACES:]
        if isinstance(found.get("map"), dict):
            vehicle.ground_map = found

    def _store(
        self,
        vehicle: Vehicle,
        delivery: Delivery,
        message: Received,
        now_s: float,
    ) -> None:
        vehicle.heard_s = now_s
        vehicle.received[delivery.topic] += 1
        match message:
            case Estimate():
                before = vehicle.estimate
                if before is not None and message.frame > before.frame + 1:
                    vehicle.missed += message.frame - before.frame - 1
                vehicle.estimate = message
                vehicle.rate_count += 1
                if not vehicle.points or now_s - vehicle.points[-1].time_s >= 1 / self.options.history_hz:
                    verdict = vehicle.decision.verdict if vehicle.decision else "unknown"
                    known = verdict if verdict in VERDICTS else "unknown"
                    vehicle.points.append(point_of(now_s, known, message))
            case Decision():
                vehicle.decision = message
            case Health():
                vehicle.health = message
            case Event():
                vehicle.events.append(message)
            case Preview():
                vehicle.preview, vehicle.picture = message, delivery.payload
