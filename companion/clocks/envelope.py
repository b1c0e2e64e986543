"""The lower envelope of arrival delays: delays can only grow, so the least ones of a window give the relation.

Each second of boot time keeps its least delay. The line below all of them with the least sum of distances gives the
drift of the two crystals (Moon, Skelly and Towsley 1999: it is the edge of the lower convex hull at the mean time). A
link that is late for a part of the window does not move that line.
"""

import math
from collections import deque
from dataclasses import dataclass

from companion.settings.settings import SyncSettings

BUCKET_US = 1_000_000

DRIFT_FROM_BUCKETS = 8
"""Seconds of arrivals from which the drift is estimated."""

WANDER_PPM = 5.0
"""How much the drift itself changes within the window: crystals with temperature."""

FALL_FADES_US = 1_000_000
"""How long a fall of the envelope speaks against it: until a second has passed without another one."""

LATE_SPAN_US = 1_000_000
"""The least delay of this span is compared with the envelope: jitter and bursts are over within it."""

RECENT_BUCKETS = 10


@dataclass(slots=True)
class _Bucket:
    start_us: int
    least_us: float
    at_us: int
    sum_us: float
    count: int = 1


class Envelope:
    """Feed it delays (arrival minus boot time, microseconds) by boot time; ``offset_us(boot)`` is the relation."""

    def __init__(self, settings: SyncSettings) -> None:
        self._s = settings
        self._buckets: deque[_Bucket] = deque()
        self._recent: deque[tuple[int, float]] = deque()
        self.count = 0
        self.drift = 0.0
        self.std_us = math.inf
        """One sigma from the arrivals while nothing contradicts them."""
        self._offset_us, self._at_us = 0.0, 0
        self._fall_us, self._fell_at_us = 0.0, 0
        self._fell_total_us = 0.0

    def offset_us(self, boot_us: int) -> float:
        """Companion time minus boot time, at a boot time."""
        return self._offset_us + self.drift * (boot_us - self._at_us)

    def doubt_us(self, boot_us: int) -> float:
        """How wrong the envelope may be: by what it fell lately, or by what all newest arrivals are late."""
        return math.hypot(self._fall(boot_us), self.late_us())

    def draining(self, boot_us: int) -> bool:
        """Whether the envelope falls by more than jitter: a backlog drains, the least delay is still to come."""
        return self._fall(boot_us) > 2 * self._s.link_jitter_s * 1e6

    def correction_us(self, boot_us: int) -> float:
        """By what the envelope fell in one go, once that is over; 0 while it falls, and where it fell little."""
        if self._fell_total_us == 0 or self._fall(boot_us) > 0:
            return 0.0
        total_us, self._fell_total_us = self._fell_total_us, 0.0
        return total_us if total_us > self._s.jump_min_s * 1e6 else 0.0

    def _fall(self, boot_us: int) -> float:
        return self._fall_us * max(0.0, 1.0 - (boot_us - self._fell_at_us) / FALL_FADES_US)

    def late_us(self) -> float:
        """By what even the least delayed of the newest arrivals is later than jitter explains; 0 in order."""
        if not self._recent or self._recent[-1][0] - self._buckets[0].start_us < LATE_SPAN_US:
            return 0.0
        at_us, least_us = self._recent[0]
        late_us = least_us - self.offset_us(at_us)
        return late_us if late_us > self._s.link_jitter_s * 1e6 else 0.0

    def add(self, boot_us: int, delay_us: float) -> None:
        """Take one delay; the envelope is drawn anew once a second, or when it falls."""
        self.count += 1
        self._keep_recent(boot_us, delay_us)
        start_us = boot_us - boot_us % BUCKET_US
        if not self._buckets or start_us > self._buckets[-1].start_us:
            self._buckets.append(_Bucket(start_us, delay_us, boot_us, delay_us))
            while self._buckets[0].start_us < start_us - self._s.clock_window_s * 1e6:
                self._buckets.popleft()
            self._draw(boot_us)
            return
        bucket = self._buckets[-1]
        bucket.count += 1
        bucket.sum_us += delay_us
        if delay_us < bucket.least_us:
            bucket.least_us, bucket.at_us = delay_us, boot_us
        if self.count <= self._s.clock_min_messages or delay_us < self.offset_us(boot_us):
            self._draw(boot_us)

    def _keep_recent(self, boot_us: int, delay_us: float) -> None:
        """The delays of the last span that none behind them undercuts: the first one is the least."""
        while self._recent and self._recent[-1][1] >= delay_us:
            self._recent.pop()
        self._recent.append((boot_us, delay_us))
        while self._recent[0][0] < boot_us - LATE_SPAN_US:
            self._recent.popleft()

    def _draw(self, now_us: int) -> None:
        before_us = self.offset_us(now_us)
        self.drift, doubt = self._line()
        rise = self.drift + doubt
        self._offset_us, held_us = min(
            (b.least_us + rise * (now_us - b.at_us), now_us - b.at_us) for b in self._buckets
        )
        self._at_us = now_us
        fell_us = before_us - self._offset_us
        if self.count > 1 and fell_us > 0:
            self._fall_us, self._fell_at_us = self._fall(now_us) + fell_us, now_us
            self._fell_total_us += fell_us
        recent = list(self._buckets)[-RECENT_BUCKETS:]
        jitter_us = self._s.link_jitter_s * 1e6
        levels = [b.least_us + self.drift * (now_us - b.at_us) for b in recent]
        levels = [level for level in levels if level <= min(levels) + jitter_us]
        spread_us = max(levels) - min(levels)
        few_us = jitter_us / (1 + sum(b.count for b in recent))
        # Bursts come down to the least delay only as near as messages follow each other.
        count = sum(b.count for b in recent)
        above_us = max(0.0, sum(b.sum_us - b.count * self.offset_us(b.at_us) for b in recent) / count)
        step_us = above_us * len(recent) / count
        level_us = spread_us / len(levels)
        self.std_us = math.hypot(self._s.link_delay_std_s * 1e6, level_us, few_us, step_us, doubt * held_us)

    def _line(self) -> tuple[float, float]:
        """Drift of full buckets' least delays, within what crystals do, and the doubt about it; late ones aside."""
        limit = self._s.drift_max_ppm * 1e-6
        late_us = 2 * self._s.link_jitter_s * 1e6
        full = [b for b in list(self._buckets)[:-1] if b.count > 1]
        full = [b for b in full if b.least_us - self.offset_us(b.at_us) <= late_us]
        if len(full) < DRIFT_FROM_BUCKETS:
            return 0.0, limit
        mean_us = sum(b.at_us for b in full) / len(full)
        hull: list[_Bucket] = []
        for b in full:
            while len(hull) > 1 and _turns_down(hull[-2], hull[-1], b):
                hull.pop()
            hull.append(b)
        at = next((k for k, b in enumerate(hull) if b.at_us >= mean_us), len(hull) - 1)
        first, second = hull[max(0, at - 1)], hull[at]
        if second.at_us <= first.at_us:
            return 0.0, limit
        slope = (second.least_us - first.least_us) / (second.at_us - first.at_us)
        per_bucket = sum(b.count for b in full) / len(full)
        noise_us = self._s.link_jitter_s * 1e6 / (1 + per_bucket)
        doubt = min(limit, noise_us / (second.at_us - first.at_us) + WANDER_PPM * 1e-6)
        return max(-limit, min(limit, slope)), doubt


def _turns_down(a: _Bucket, b: _Bucket, c: _Bucket) -> bool:
    """Whether b lies on or above the line from a to c."""
    return (b.least_us - a.least_us) * (c.at_us - a.at_us) >= (c.least_us - a.least_us) * (b.at_us - a.at_us)
