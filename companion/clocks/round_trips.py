"""TIMESYNC round trips: each bounds the relation of the clocks to both sides, within half its length.

The arrivals bound it from above only. A trip that does not agree with them is an outlier, kept and tested: three in a
row that agree among themselves are right, and the arrivals were late, or another clock answers and the doubt grows.
"""

from collections import deque
from dataclasses import dataclass

from companion.clocks.envelope import Envelope
from companion.settings.settings import SyncSettings

OUTLIERS_AGREE = 3


@dataclass(frozen=True, slots=True)
class RoundTrip:
    """Companion minus boot time, ``offset_us``, at ``boot_us``; one sigma ``std_us``."""

    boot_us: int
    offset_us: float
    std_us: float
    trip_us: int = 0


class RoundTrips:
    """The trips of the last ``sync.timesync_window_s`` that agree with the arrivals, or among themselves."""

    def __init__(self, settings: SyncSettings) -> None:
        self._s = settings
        self._kept: deque[RoundTrip] = deque()
        self._outliers: list[RoundTrip] = []

    def add(self, boot_us: int, offset_us: float, trip_us: int, arrivals: Envelope) -> None:
        """Take one trip."""
        std_us = max(self._s.timesync_std_floor_s * 1e6, trip_us / 4)
        trip = RoundTrip(boot_us, offset_us, std_us, trip_us)
        if arrivals.count and not self._agrees(trip, arrivals):
            if self._outliers and not _overlap(self._outliers[-1], trip, self._s.link_jitter_s * 1e6):
                self._outliers = []
            self._outliers = [*self._outliers, trip][-OUTLIERS_AGREE:]
            early = all(o.offset_us < arrivals.offset_us(o.boot_us) for o in self._outliers)
            if len(self._outliers) == OUTLIERS_AGREE and early:
                self._kept = deque(self._outliers)
            return
        self._outliers = []
        self._kept.append(trip)
        while self._kept[0].boot_us < boot_us - self._s.timesync_window_s * 1e6:
            self._kept.popleft()

    def best(self, now_us: int, drift: float) -> RoundTrip | None:
        """The trip that leaves the least doubt now, moved to now; None without any of the window."""
        limit_us = self._s.timesync_window_s * 1e6
        usable = [t for t in self._kept if now_us - t.boot_us <= limit_us]
        if not usable:
            return None
        best = min(usable, key=lambda t: t.std_us)
        return RoundTrip(now_us, best.offset_us + drift * (now_us - best.boot_us), best.std_us, best.trip_us)

    def contradiction_us(self, now_us: int, arrivals: Envelope) -> float:
        """By what the newest trips, agreeing among themselves, say that messages arrive before they are sent."""
        if len(self._outliers) < OUTLIERS_AGREE:
            return 0.0
        newest = self._outliers[-1]
        if now_us - newest.boot_us > self._s.timesync_window_s * 1e6:
            return 0.0
        return max(0.0, newest.offset_us - newest.trip_us / 2 - arrivals.offset_us(newest.boot_us))

    def _agrees(self, trip: RoundTrip, arrivals: Envelope) -> bool:
        """Nothing arrives before it was sent, and messages wait little longer than the answer to a trip did."""
        late_us = arrivals.offset_us(trip.boot_us) - trip.offset_us
        slack_us = self._s.timesync_std_floor_s * 1e6
        return -trip.trip_us / 2 - slack_us <= late_us <= trip.trip_us + self._s.link_jitter_s * 1e6


def _overlap(a: RoundTrip, b: RoundTrip, slack_us: float) -> bool:
    return abs(a.offset_us - b.offset_us) <= (a.trip_us + b.trip_us) / 2 + slack_us
