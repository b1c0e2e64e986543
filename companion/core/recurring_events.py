"""Events that come and go many times in a flight: the first ones at once, then rarely, with their number."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TypeVar

import msgspec

from companion.messages.messages import Event

T = TypeVar("T")

RECURRING = frozenset(
    {
        "attitude_lost",
        "attitude_back",
        "input_stale",
        "input_back",
        "camera_frozen",
        "camera_moves",
        "motion_agrees",
    }
    | {"rotation_contradicts", "velocity_contradicts", "lateness_contradicts", "height_contradicts"}
)
"""States that health has too: of their changes an event is no more than a log."""
AT_ONCE = 3
"""Events of one kind within the period that are reported as they come."""
PERIOD_US = 30_000_000


@dataclass(slots=True)
class _Kind:
    reported_us: deque[int] = field(default_factory=lambda: deque(maxlen=AT_ONCE))
    held: Event | None = None
    count: int = 0
    since_us: int = 0


class RecurringEvents:
    """Outputs pass through; of recurring events those too many are held, counted, and the newest of them reported."""

    def __init__(self) -> None:
        self._kinds: dict[tuple[str, object], _Kind] = {}

    def step(self, outputs: Iterable[T], now_us: int) -> list[T | Event]:
        """``outputs`` without the events that come too often, and with those held that are due; steady time in us."""
        out: list[T | Event] = []
        for output in outputs:
            if not isinstance(output, Event) or output.event not in RECURRING:
                out.append(output)
                continue
            kind = self._kinds.setdefault((output.event, output.details.get("input")), _Kind())
            times = kind.reported_us
            if kind.held is None and (len(times) < AT_ONCE or now_us - times[0] >= PERIOD_US):
                times.append(now_us)
                out.append(output)
                continue
            if kind.held is None:
                kind.since_us = now_us
            kind.held, kind.count = output, kind.count + 1
        out += [
            self._counted(kind, now_us)
            for kind in self._kinds.values()
            if kind.held is not None and now_us - kind.since_us >= PERIOD_US
        ]
        return out

    def finish(self, now_us: int) -> list[Event]:
        """What is held at the end."""
        return [self._counted(kind, now_us) for kind in self._kinds.values() if kind.held is not None]

    def _counted(self, kind: _Kind, now_us: int) -> Event:
        held = kind.held
        assert held is not None
        seconds = round((now_us - kind.since_us) * 1e-6)
        text = f"{held.text}: {kind.count} times in {seconds} s" if kind.count > 1 else held.text
        details = held.details | {"times": kind.count}
        kind.held, kind.count = None, 0
        # it recurs: the next ones are held until it has been quiet for the period
        kind.reported_us.extend([now_us] * AT_ONCE)
        return msgspec.structs.replace(held, text=text, details=details)
