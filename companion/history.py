"""All that a flight gave, kept for the summary and the plot."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from companion.messages import Decision, Estimate, Event, Health, Message


@dataclass(slots=True)
class History:
    """The messages of one flight in order; of the health only the newest."""

    estimates: list[Estimate] = field(default_factory=list)
    decisions: list[Decision] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    health: Health | None = None

    def add(self, message: Message) -> None:
        """Keep one message."""
        match message:
            case Estimate():
                self.estimates.append(message)
            case Decision():
                self.decisions.append(message)
            case Event():
                self.events.append(message)
            case Health():
                self.health = message

    @property
    def start_us(self) -> int:
        """Time of the first frame; 0 without frames."""
        return self.estimates[0].time_unix_us if self.estimates else 0

    @property
    def duration_s(self) -> float:
        """From the first frame to the end of the last."""
        if len(self.estimates) < 2:
            return 0.0
        span_us = self.estimates[-1].time_unix_us - self.start_us
        return span_us / 1e6 * len(self.estimates) / (len(self.estimates) - 1)

    def seconds(self, time_unix_us: int) -> float:
        """Time since the first frame."""
        return (time_unix_us - self.start_us) / 1e6

    def times_s(self) -> NDArray[np.float64]:
        """(n,) times of the estimates since the first frame."""
        return np.array([self.seconds(e.time_unix_us) for e in self.estimates])

    def series(self, name: str) -> NDArray[np.float64]:
        """(n,) one field of the estimates; NaN where it is unknown."""
        values = [getattr(e, name) if e.status == "ok" else None for e in self.estimates]
        return np.array([np.nan if v is None else v for v in values], dtype=np.float64)

    def verdicts(self) -> list[str]:
        """The verdict in force at each estimate."""
        found, at = [], 0
        verdict = "unknown"
        for estimate in self.estimates:
            while at < len(self.decisions) and self.decisions[at].time_unix_us <= estimate.time_unix_us:
                verdict = self.decisions[at].verdict
                at += 1
            found.append(verdict)
        return found
