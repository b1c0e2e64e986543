"""Where the drivers' threads leave samples and events for the one thread of the pipeline."""

import threading
from collections import deque
from collections.abc import Iterable

from drivers.events import DriverEvent
from drivers.samples import Sample

CAPACITY = 20_000
"""A minute of telemetry: more than that means the pipeline hangs, and the watchdog will end it."""


class Inbox:
    """Bounded: what does not fit pushes out the oldest and is counted in ``dropped``. Frames never wait here."""

    def __init__(self, capacity: int = CAPACITY) -> None:
        self.dropped = 0
        self._samples: deque[Sample] = deque(maxlen=capacity)
        self._events: deque[DriverEvent] = deque(maxlen=capacity)
        self._changed = threading.Condition()
        self._woken = False
        self._patient = False

    def put(self, samples: Iterable[Sample]) -> None:
        """Leave samples; never waits."""
        with self._changed:
            for sample in samples:
                self.dropped += len(self._samples) == self._samples.maxlen
                self._samples.append(sample)
            if not self._patient:
                self._changed.notify()

    def report(self, event: DriverEvent) -> None:
        """Leave an event."""
        with self._changed:
            self._events.append(event)
            self._changed.notify()

    def wake(self) -> None:
        """Somebody has something elsewhere (a camera a frame, the user a signal)."""
        with self._changed:
            self._woken = True
            self._changed.notify()

    def take(self, timeout_s: float, gather_s: float = 0.0) -> tuple[list[Sample], list[DriverEvent]]:
        """Everything there is, waiting up to ``timeout_s`` for something.

        With ``gather_s`` samples alone wait that long for more of their kind: one turn for many, not one for each.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._samples or self._urgent(), timeout_s)
            if gather_s and not self._urgent():
                self._patient = True
                self._changed.wait_for(self._urgent, gather_s)
                self._patient = False
            self._woken = False
            samples, events = list(self._samples), list(self._events)
            self._samples.clear()
            self._events.clear()
            return samples, events

    def _urgent(self) -> bool:
        return self._woken or bool(self._events)
