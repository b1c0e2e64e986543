"""The rangefinder's distance at an exposure."""

from collections import deque

from drivers.samples import Distance

MAX_AGE_US = 300_000
"""Oldest distance that is used; rangefinders report ten times a second."""
ASSUMED_STD_M, ASSUMED_SHARE = 0.03, 0.01
"""Error of a sensor that reports none, m and a share of the distance, one sigma: data sheets of small lidars."""

_KEPT = 16
_WRAP_US = 2**32 * 1000


class Rangefinder:
    """The newest distances, by boot time."""

    def __init__(self) -> None:
        self._samples: deque[Distance] = deque(maxlen=_KEPT)

    def feed(self, sample: Distance) -> None:
        """Take one distance."""
        self._samples.append(sample)

    def forget(self) -> None:
        """The autopilot started anew."""
        self._samples.clear()

    def at(self, boot_us: int) -> tuple[float, float] | None:
        """Distance and its standard deviation, m, on the line between the samples about a moment, or of the nearest.

        None where the nearest is too old, or measured nothing.
        """
        before = after = None
        for sample in self._samples:
            # its boot time starts anew after 49.7 days
            away_us = (sample.boot_us - boot_us + _WRAP_US // 2) % _WRAP_US - _WRAP_US // 2
            if -MAX_AGE_US <= away_us <= 0 and (before is None or away_us >= before[0]):
                before = away_us, sample
            elif 0 < away_us <= MAX_AGE_US and (after is None or away_us < after[0]):
                after = away_us, sample
        near = [found for found in (before, after) if found is not None]
        if not near or any(sample.distance_m is None for _, sample in near):
            return None
        (first_us, first), (last_us, last) = near[0], near[-1]
        low, high = first.distance_m or 0.0, last.distance_m or 0.0
        share = -first_us / (last_us - first_us) if last_us > first_us else 0.0
        distance_m = low + share * (high - low)
        reported = max(sample.std_m or 0.0 for _, sample in near)
        return distance_m, reported or ASSUMED_STD_M + ASSUMED_SHARE * distance_m
