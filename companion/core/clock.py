"""One clock: the relation of the autopilot's boot time and the companion's time, learned from arrivals.

A message stamped at boot time ``b`` arrives at companion time ``a = b + offset + delay`` with a delay that jitters but
never falls below the link's least. So the offset (with that least delay in it) is the lower envelope of ``a - b``
over the last seconds, leaning with the drift of the two crystals. TIMESYNC round trips, where there are any, give the
offset without the delay. Boot time wraps after 49.7 days and falls back at a reboot; the companion's clock may be set.
"""

import math
from collections import deque
from dataclasses import dataclass, field
from enum import Enum

from companion.settings.settings import SyncSettings

WRAP_US = 2**32 * 1000
"""Boot times in milliseconds are 32 bits wide: they start anew after 49.7 days."""

BUCKET_US = 1_000_000
DRIFT_BUCKETS = 60
"""The least delay of each second of boot time is kept for a minute, to follow the drift."""

DRIFT_FROM_BUCKETS = 8
"""Seconds of arrivals from which the drift is worth estimating."""

REBOOT_WITNESSES = 5
JUMP_WITNESSES = 10
"""Messages in a row that must agree before a reboot or a jump is believed."""

BURST_SHARE = 0.5
"""Late messages of a stalled link arrive in a shorter time than they were sent in; after a jump, in the same."""


class ClockChange(Enum):
    """What the clock noticed on an arrival."""

    REBOOTED = "autopilot_rebooted"
    WRAPPED = "boot_time_wrapped"
    JUMPED = "clock_jumped"


@dataclass(frozen=True, slots=True)
class Arrival:
    """What became of one arrival.

    ``boot_us``: boot time without wraps, None where a reboot is suspected (the sample is not to be used);
    ``steady_us``: arrival with the jumps of the companion's clock taken out, None where it does not fit the relation.
    """

    boot_us: int | None
    steady_us: int | None
    change: ClockChange | None = None
    jump_us: int = 0


@dataclass(slots=True)
class _Bucket:
    start_us: int
    least_us: float
    at_us: int
    count: int = 1


@dataclass(slots=True)
class _Suspects:
    """Arrivals in a row that do not fit: boot times (raw) and delays against the relation."""

    raw_us: list[int] = field(default_factory=list)
    arrival_us: list[int] = field(default_factory=list)
    delay_us: list[float] = field(default_factory=list)


class AutopilotClock:
    """Feed it every arrival with a boot time; ask it for the boot time of a companion time.

    All times are microseconds. "Steady" is the companion's time with the jumps taken out that the arrivals show;
    ``shift_us`` is their sum (raw = steady + shift).
    """

    def __init__(self, settings: SyncSettings) -> None:
        self._s = settings
        self.shift_us = 0
        self.wraps = 0
        self._restart()
        self._newest_us = 0

    def _restart(self) -> None:
        self._buckets: deque[_Bucket] = deque(maxlen=DRIFT_BUCKETS)
        self._trips: deque[tuple[int, float, int]] = deque()
        self._suspects = _Suspects()
        self._base_us: int | None = None
        self._wrap_us = 0
        self._count = 0
        self._offset_us = 0.0
        self._at_us = 0
        self._drift = 0.0
        self._std_us = math.inf

    @property
    def settled(self) -> bool:
        """Whether the relation may be used: enough arrivals, and none in a row that speak against it."""
        return self._count >= self._s.clock_min_messages and len(self._suspects.raw_us) < REBOOT_WITNESSES

    @property
    def std_s(self) -> float:
        """One standard deviation of the relation."""
        return self._std_us * 1e-6

    @property
    def drift(self) -> float:
        """How much faster the companion's clock runs than the autopilot's (1e-6: one ppm)."""
        return self._drift

    def offset_us(self, boot_us: int) -> float:
        """Steady companion time minus boot time, at a boot time."""
        return self._offset_us + self._drift * (boot_us - self._at_us)

    def boot_us(self, steady_us: int) -> int:
        """Boot time (without wraps) of a steady companion time."""
        offset = self._offset_us + self._drift * (steady_us - self._offset_us - self._at_us)
        return round(steady_us - offset)

    def feed(self, raw_boot_us: int, arrival_us: int, truncated_us: int = 0) -> Arrival:
        """Take one arrival; ``raw_boot_us`` as the message says.

        ``truncated_us``: the stamp was cut off to this resolution and put into its middle; the envelope takes the
        beginning, since the middle of a late stamp would seem to arrive too early.
        """
        steady_us = arrival_us - self.shift_us
        if self._base_us is None:
            self._base_us = raw_boot_us % WRAP_US
            self._wrap_us = 0
            self._newest_us = self._base_us
        boot_us, wrapped = self._unwrap(raw_boot_us, steady_us)
        delay_us = steady_us - boot_us + truncated_us / 2
        if self._count >= self._s.clock_min_messages and not self._fits(boot_us, delay_us):
            return self._suspect(raw_boot_us, boot_us, arrival_us, delay_us - self.offset_us(boot_us))
        self._suspects = _Suspects()
        self._newest_us = max(self._newest_us, boot_us)
        self._take(boot_us, delay_us)
        return Arrival(boot_us, steady_us, ClockChange.WRAPPED if wrapped else None)

    def feed_round_trip(self, raw_boot_us: int, arrival_us: int, offset_us: int, round_trip_us: int) -> None:
        """Take one TIMESYNC round trip: companion minus autopilot clock, good to half the trip's length."""
        if self._base_us is None or round_trip_us < 0:
            return
        boot_us, _ = self._unwrap(raw_boot_us, arrival_us - self.shift_us)
        offset = offset_us + raw_boot_us - boot_us - self.shift_us
        # The truth lies within the trip; what is outside of it crossed a jump or belongs to another clock.
        if self._count and abs(offset - self.offset_us(boot_us)) > self._s.jump_min_s * 1e6:
            return
        self._trips.append((boot_us, offset, round_trip_us))
        horizon = boot_us - self._s.timesync_window_s * 1e6
        while self._trips and self._trips[0][0] < horizon:
            self._trips.popleft()

    def _unwrap(self, raw_boot_us: int, steady_us: int) -> tuple[int, bool]:
        """Boot time nearest to the newest one among those that look the same in 32 bits, and whether that wraps."""
        folded = raw_boot_us % WRAP_US
        wraps = round((self._newest_us - folded) / WRAP_US)
        boot_us = folded + wraps * WRAP_US
        if boot_us // WRAP_US > self._wrap_us and self._count and self._fits(boot_us, steady_us - boot_us):
            self._wrap_us = boot_us // WRAP_US
            self.wraps += 1
            return boot_us, True
        return boot_us, False

    def _fits(self, boot_us: int, delay_us: float) -> bool:
        """Whether an arrival is neither impossibly early nor much later than the relation says."""
        if boot_us < self._newest_us - self._s.jump_min_s * 1e6:
            return False
        return abs(delay_us - self.offset_us(boot_us)) <= self._s.jump_min_s * 1e6

    def _suspect(self, raw_us: int, boot_us: int, arrival_us: int, late_us: float) -> Arrival:
        """An arrival that does not fit: late by chance, or the first after a reboot or a jump."""
        s = self._suspects
        if s.raw_us and raw_us < s.raw_us[-1] - self._s.jump_min_s * 1e6:
            self._suspects = s = _Suspects()  # they do not agree among themselves
        s.raw_us.append(raw_us)
        s.arrival_us.append(arrival_us)
        s.delay_us.append(late_us)
        if boot_us < self._newest_us - self._s.jump_min_s * 1e6:
            if len(s.raw_us) < REBOOT_WITNESSES:
                return Arrival(None, None)
            return self._reboot(raw_us, arrival_us)
        sent_us, came_us = s.raw_us[-1] - s.raw_us[0], s.arrival_us[-1] - s.arrival_us[0]
        enough = len(s.raw_us) >= JUMP_WITNESSES and sent_us >= self._s.jump_confirm_s * 1e6
        if not enough or came_us < BURST_SHARE * sent_us:
            return Arrival(boot_us, None)
        jump_us = round(min(s.delay_us))
        self.shift_us += jump_us
        self._suspects = _Suspects()
        self._newest_us = max(self._newest_us, boot_us)
        steady_us = arrival_us - self.shift_us
        self._take(boot_us, steady_us - boot_us)
        return Arrival(boot_us, steady_us, ClockChange.JUMPED, jump_us)

    def _reboot(self, raw_us: int, arrival_us: int) -> Arrival:
        self._restart()
        first = self.feed(raw_us, arrival_us)
        return Arrival(first.boot_us, first.steady_us, ClockChange.REBOOTED)

    def _take(self, boot_us: int, delay_us: float) -> None:
        """Let the lower envelope know of one delay; it is drawn anew once a second of boot time, or when it falls."""
        self._count += 1
        start_us = boot_us - boot_us % BUCKET_US
        if not self._buckets or start_us > self._buckets[-1].start_us:
            self._buckets.append(_Bucket(start_us, delay_us, boot_us))
            self._draw(boot_us)
            return
        bucket = self._buckets[-1]
        bucket.count += 1
        if delay_us < bucket.least_us:
            bucket.least_us, bucket.at_us = delay_us, boot_us
        if self._count <= self._s.clock_min_messages or delay_us < self.offset_us(boot_us):
            self._draw(boot_us)

    def _draw(self, now_us: int) -> None:
        """The envelope: least delay over the window, leaning with the drift; its spread gives the uncertainty."""
        self._drift = self._estimate_drift()
        horizon = now_us - self._s.clock_window_s * 1e6
        recent = [b for b in self._buckets if b.at_us >= horizon] or [self._buckets[-1]]
        level = [b.least_us + self._drift * (now_us - b.at_us) for b in recent]
        self._offset_us, self._at_us = min(level), now_us
        spread = max(level) - min(level) if len(level) > 1 else 0.0
        few = self._s.link_jitter_s * 1e6 / (1 + sum(b.count for b in recent))
        self._std_us = math.hypot(self._s.link_delay_std_s * 1e6, spread / len(level), few)
        self._apply_round_trips(now_us)

    def _estimate_drift(self) -> float:
        """Slope of the least delays over the last minute (full buckets only), within what crystals can do."""
        full = [b for b in list(self._buckets)[:-1] if b.count > 1]
        if len(full) < DRIFT_FROM_BUCKETS:
            return 0.0
        mean_t = sum(b.at_us for b in full) / len(full)
        mean_d = sum(b.least_us for b in full) / len(full)
        above = sum((b.at_us - mean_t) * (b.least_us - mean_d) for b in full)
        below = sum((b.at_us - mean_t) ** 2 for b in full)
        limit = self._s.drift_max_ppm * 1e-6
        return max(-limit, min(limit, above / below)) if below > 0 else 0.0

    def _apply_round_trips(self, now_us: int) -> None:
        """Where round trips leave less doubt than the arrivals, the shortest of them gives the offset."""
        if not self._trips:
            return
        boot_us, offset, trip_us = min(self._trips, key=lambda trip: trip[2])
        offset += self._drift * (now_us - boot_us)
        std_us = max(self._s.timesync_std_floor_s * 1e6, trip_us / 4)
        # Nothing arrives before it was sent, and messages wait little longer than the answer to a round trip did.
        late_us = self._offset_us - offset
        if std_us < self._std_us and -trip_us / 2 <= late_us <= trip_us + self._s.link_jitter_s * 1e6:
            self._offset_us = min(offset, self._offset_us)
            self._std_us = std_us
