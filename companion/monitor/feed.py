"""From zenoh into the watch, in a thread of its own; pictures are asked for only while somebody looks."""

import threading
import time

from companion.monitor.state import Watch
from drivers.bus import Endpoints, Subscription

TOPICS = ("estimate", "decision", "health", "event")
POLL_S = 0.1


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
        """End the thread and the session."""
        self._stop.set()
        self._thread.join()
        self._subscription.close()

    def _run(self) -> None:
        while not self._stop.is_set():
            delivery = self._subscription.receive(POLL_S)
            if delivery is not None:
                self._watch.take(delivery, time.monotonic())
