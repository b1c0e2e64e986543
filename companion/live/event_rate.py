"""Events about inputs, limited in rate: a fault that repeats is an event with a count, not a flood of events."""

from collections import deque

import msgspec

from companion.messages.events import REPEATING
from companion.messages.messages import Event

BURST, PERIOD_US = 3, 10_000_000
"""So many events of a kind pass within this time; later ones are counted, and the newest of them passes after it."""

_Kind = tuple[str, str]


class EventRate:
    """Takes every event in order and gives those that may pass; times are the companion clock's, microseconds.

    What was decided or commanded always passes (``REPEATING`` names the others). An event about one input does not
    hold back those about another.
    """

    def __init__(self) -> None:
        self._passed: dict[_Kind, deque[int]] = {}
        self._held: dict[_Kind, tuple[Event, int]] = {}
        """Kind -> the newest event that was held back, and how many were."""

    def feed(self, event: Event) -> list[Event]:
        """The event, or nothing while there are too many of its kind."""
        if event.event not in REPEATING:
            return [event]
        kind = (event.event, str(event.details.get("input", "")))
        passed = self._passed.setdefault(kind, deque(maxlen=BURST))
        if kind in self._held or (len(passed) == BURST and event.time_unix_us - passed[0] < PERIOD_US):
            self._held[kind] = event, self._held.get(kind, (event, 0))[1] + 1
            return []
        passed.append(event.time_unix_us)
        return [event]

    def step(self, now_us: int) -> list[Event]:
        """Events that were held back and may pass now, each with its count."""
        due = [kind for kind in self._held if now_us - self._passed[kind][-1] >= PERIOD_US]
        return [self._release(kind, now_us) for kind in due]

    def finish(self) -> list[Event]:
        """The end: whatever is still held back."""
        return [self._release(kind, self._held[kind][0].time_unix_us) for kind in list(self._held)]

    def _release(self, kind: _Kind, now_us: int) -> Event:
        event, count = self._held.pop(kind)
        passed = self._passed[kind]
        text = event.text
        if count > 1:
            text += f" ({count} times in {(event.time_unix_us - passed[-1]) * 1e-6:.0f} s)"
        passed.extend([now_us] * BURST)  # one in a period from here on, until the fault rests for one
        return msgspec.structs.replace(event, text=text, details={**event.details, "count": count})
