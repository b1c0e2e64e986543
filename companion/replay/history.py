"""All that a flight gave, kept for the summary and the plot."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from companion.messages.messages import Decision, Estimate, Event, Health, Message

LONGEST_STEP_S = 5.0
"""Frames further apart than this, or backward, are a clock that was set, not a pause."""

FIRST_STEP_S = 1 / 30


@dataclass(slots=True)
class History:
    """The messages of one flight in order, of the health only the newest.

    Times are seconds since the first frame, across a clock that was set in between; a decision or an event
    has the time of the newest estimate before it.
    """

    estimates: list[Estimate] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    """Time of each estimate."""
    verdicts: list[str] = field(default_factory=list)
    """The verdict in force after each estimate."""
    decisions: list[tuple[float, Decision]] = field(default_factory=list)
    events: list[tuple[float, Event]] = field(default_factory=list)
    health: Health | None = None
    _step_s: float = FIRST_STEP_S

    def add(self, message: Message) -> None:
        """Keep one message."""
        match message:
            case Estimate():
                self.times.append(self._next_time(message))
                self.estimates.append(message)
                self.verdicts.append(self.decisions[-1][1].verdict if self.decisions else "unknown")
            case Decision():
                self.decisions.append((self.now_s, message))
                if self.verdicts:
                    self.verdicts[-1] = message.verdict
            case Event():
                self.events.append((self.now_s, message))
            case Health():
                self.health = message

    @property
    def now_s(self) -> float:
        """Time of the newest estimate."""
        return self.times[-1] if self.times else 0.0

    @property
    def duration_s(self) -> float:
        """From the first frame to the end of the last."""
        return self.now_s * len(self.times) / (len(self.times) - 1) if len(self.times) > 1 else 0.0

    def series(self, name: str) -> NDArray[np.float64]:
        """(n,) one field of the estimates; NaN where it is unknown."""
        values = [getattr(e, name) if e.status == "ok" else None for e in self.estimates]
        return np.array([np.nan if v is None else v for v in values], dtype=np.float64)

    def _next_time(self, estimate: Estimate) -> float:
        if not self.estimates:
            return 0.0
        step_s = (estimate.time_unix_us - self.estimates[-1].time_unix_us) / 1e6
        if not 0 <= step_s <= LONGEST_STEP_S:
            return self.now_s + self._step_s
        if step_s > 0:
            self._step_s = step_s
        return self.now_s + step_s
