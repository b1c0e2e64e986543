"""Edits of a list of samples, without files."""

import math
from collections.abc import Callable, Iterable
from dataclasses import replace

from drivers.samples import Attitude, ClockOffset, Frame, Sample

Lateness = Callable[[float], float]
"""Seconds that a message sent at a time (s) comes later than it would."""


def drop(samples: Iterable[Sample], kind: type) -> list[Sample]:
    """Samples without those of one kind."""
    return [s for s in samples if not isinstance(s, kind)]


def thin(samples: Iterable[Sample], kind: type, every: int) -> list[Sample]:
    """Of one kind only every n-th sample."""
    kept, count = [], 0
    for sample in samples:
        if isinstance(sample, kind):
            count += 1
            if count % every:
                continue
        kept.append(sample)
    return kept


def blank(samples: Iterable[Sample], first: int, last: int) -> list[Sample]:
    """Frames from ``first`` to ``last`` go dark."""
    return [
        replace(s, image=s.image * 0) if isinstance(s, Frame) and first <= s.number <= last else s
        for s in samples
    ]


def late(samples: Iterable[Sample], after_us: int, by_us: int) -> list[Sample]:
    """Attitudes that arrive behind ``after_us`` arrive later by ``by_us``; in order of arrival."""
    moved = [
        replace(s, arrival_us=s.arrival_us + by_us)
        if isinstance(s, Attitude) and s.arrival_us >= after_us
        else s
        for s in samples
    ]
    return sorted(moved, key=lambda s: s.arrival_us)


def stepped(at_s: float, for_s: float, late_s: float, ramp_s: float = 0.0) -> Lateness:
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
