"""Links that are late for a while: by how much each message is, from when it was sent; seen on radios and boards."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

from drivers.samples import Attitude, ClockOffset, Frame, Sample

Lateness = Callable[[float], float]
"""Seconds that a message sent at a time (s) comes later than it would."""


def step(at_s: float, for_s: float, late_s: float, ramp_s: float = 0.0) -> Lateness:
    """A congested radio, or parameters being loaded: later by ``late_s``, which comes and goes over ``ramp_s``."""

    def late(t_s: float) -> float:
        since_s = t_s - at_s
        if not 0 <= since_s < for_s + ramp_s:
            return 0.0
        if ramp_s == 0:
            return late_s
        return late_s * min(since_s / ramp_s, 1.0, 1.0 - (since_s - for_s) / ramp_s)

    return late


def drained(at_s: float, hold_s: float, pace: float) -> Lateness:
    """Nothing comes for ``hold_s``, then the backlog at ``pace`` times real time."""
    return lambda t_s: max(0.0, hold_s - (t_s - at_s) * (1 - 1 / pace)) if t_s >= at_s else 0.0


def bursts(period_s: float = 1.2) -> Lateness:
    """A telemetry radio that sends what it has every ``period_s``."""
    return lambda t_s: math.ceil(t_s / period_s) * period_s - t_s


def slowed(samples: Iterable[Sample], late: Lateness) -> list[Sample]:
    """The same samples with telemetry that comes late, in its order; sorted by arrival."""
    out: list[Sample] = []
    first_us, newest_us = None, 0
    for sample in samples:
        if isinstance(sample, Frame):
            out.append(sample)
            continue
        first_us = sample.arrival_us if first_us is None else first_us
        by_us = round(late((sample.arrival_us - first_us) * 1e-6) * 1e6)
        newest_us = max(newest_us, sample.arrival_us + by_us)
        if not isinstance(sample, ClockOffset):
            out.append(replace(sample, arrival_us=newest_us))
    return sorted(out, key=lambda s: s.arrival_us)


class HeldBack:
    """An edit of a played recording: messages sent in a span are held, then come at ``pace`` for each that is sent."""

    def __init__(self, from_s: float, to_s: float, pace: int) -> None:
        self._from_s, self._to_s, self._pace = from_s, to_s, pace
        self._held: list[bytes] = []

    def __call__(self, t_s: float, frame: bytes) -> list[bytes]:
        if t_s < self._from_s:
            return [frame]
        self._held.append(frame)
        if t_s < self._to_s:
            return []
        out, self._held = self._held[: self._pace], self._held[self._pace :]
        return out


def attitudes(samples: Sequence[Sample]) -> int:
    """How many attitudes there are."""
    return sum(isinstance(s, Attitude) for s in samples)
