"""From zenoh into the watch, in a thread of its own; pictures are asked for only while somebody looks."""

import threading
import time
from typing import Annotated

import msgspec
import zenoh

from companion.monitor.state import Watch
from drivers.bus import CONFIGURATION, Endpoints, Subscription

TOPICS = ("estimate", "decision", "health", "event", "ground")
POLL_S = 0.1
ASK_EVERY_S = 2.0
ASK_S = 1.0
MOST_ASKS = 5
"""A vehicle that never answers is asked so many times for its settings."""

Limit = Annotated[float, msgspec.Meta(gt=0, lt=1e6)]


class _Decision(msgspec.Struct):
    max_inclination_deg: Limit | None = None
    max_roughness: Limit | None = None


class _Configuration(msgspec.Struct):
    decision: _Decision = msgspec.field(default_factory=_Decision)


class Feed:
    """Drains a subscription; ``look`` and ``look_away`` say which pages want pictures."""

    def __init__(self, watch: Watch, endpoints: Endpoints, vehicle: str = "*") -> None:
        self._watch = watch
        self._subscription = Subscription(endpoints, vehicle, TOPICS)
        self._looking: set[str] = set()
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="monitor-feed", daemon=True)
        self._thread.start()
        self._asker = threading.Thread(target=self._ask, name="monitor-limits", daemon=True)
        self._asker.start()

    @property
    def dropped(self) -> int:
        """Deliveries that were lost because they came faster than they could be taken."""
        return self._subscription.dropped

    def links(self) -> int:
        """Routers and peers that the monitor is connected to now; none when nobody listens to them any more."""
        return self._subscription.links() if self._thread.is_alive() else 0

    def look(self, page: str) -> None:
        """A page wants pictures; it may say so again."""
        with self._lock:
            self._looking.add(page)
            self._subscription.add("preview")

    def look_away(self, page: str) -> None:
        """A page is gone."""
        with self._lock:
            self._looking.discard(page)
            if not self._looking:
                self._subscription.remove("preview")

    def close(self) -> None:
        """End the threads and the session."""
        self._stop.set()
        self._thread.join()
        self._asker.join(ASK_S + POLL_S)
        self._subscription.close()

    def _run(self) -> None:
        while not self._stop.is_set():
            delivery = self._subscription.receive(POLL_S)
            if delivery is not None:
                self._watch.take(delivery, time.monotonic())

    def _ask(self) -> None:
        """The limits that the charts show are the vehicles' own settings."""
        asked: dict[str, int] = {}
        while not self._stop.wait(ASK_EVERY_S):
            with self._watch.lock:
                wanted = [v.name for v in self._watch.vehicles.values() if not v.limits]
            for name in wanted:
                if self._stop.is_set() or asked.get(name, 0) >= MOST_ASKS:
                    continue
                asked[name] = asked.get(name, 0) + 1
                limits = self._limits_of(name)
                with self._watch.lock:
                    vehicle = self._watch.vehicles.get(name)
                    if vehicle is not None:
                        vehicle.limits = limits

    def _limits_of(self, name: str) -> dict[str, float]:
        try:
            answer = self._subscription.ask(name, CONFIGURATION, ASK_S)
            found = msgspec.json.decode(answer or b"{}", type=_Configuration).decision
        except (zenoh.ZError, msgspec.MsgspecError, RecursionError):
            return {}
        return {key: value for key, value in msgspec.structs.asdict(found).items() if value is not None}
