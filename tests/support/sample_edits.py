"""Edits of a list of samples, without files."""

from collections.abc import Iterable
from dataclasses import replace

from drivers.samples import Attitude, Frame, Sample


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
