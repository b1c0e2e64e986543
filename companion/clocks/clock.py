"""The relation between the autopilot's boot time and the companion's time, estimated from the arrivals of messages.

In: for each message its boot time and its arrival time, both in microseconds; TIMESYNC round trips where there are any.
Out: the boot time of any companion time, with its standard deviation; frames need it to find their attitude.

A message stamped at boot time ``b`` arrives at companion time ``a = b + offset + delay``. The delay is never shorter
than the link's least delay, and can be longer by any amount: a congested radio or a busy processor makes messages late
for seconds. The offset is therefore the lower envelope of ``a - b``, which late messages do not move. TIMESYNC round
trips give the offset without the delay. Three events change the relation:

- boot time wraps after 49.7 days;
- boot time falls back at a reboot;
- somebody sets the companion's clock. Arrivals then step, but arrivals also step when the link stalls. A step counts as
  a clock that was set when the frames' stamps step by the same amount, and is taken back when later arrivals show that
  the messages were only late.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum

from companion.clocks.envelope import Envelope
from companion.clocks.round_trips import RoundTrips
from companion.settings.settings import SyncSettings

WRAP_US = 2**32 * 1000
"""Boot times in milliseconds are 32 bits wide: they start anew after 49.7 days."""

REBOOT_WITNESSES = 5
JUMP_WITNESSES = 10
"""Consecutive messages that must agree before a reboot or a jump is accepted."""

LATEST_US = 2_000_000
"""Assumption: no link delays messages by more than this at a constant delay, or delivers them out of order by more."""

Witness = Callable[[float, int], bool]
"""(step, arrival) in microseconds -> whether the stamps of the frames step by as much around that arrival."""


class ClockChange(Enum):
    """What the clock noticed on an arrival."""

    REBOOTED = "autopilot_rebooted"
    WRAPPED = "boot_time_wrapped"
    JUMPED = "clock_jumped"
    TAKEN_BACK = "clock_jump_taken_back"
    CORRECTED = "clock_corrected"


@dataclass(frozen=True, slots=True)
class Arrival:
    """The result of one arrival.

    ``boot_us``: boot time without wraps; None while a reboot is suspected, and the sample must not be used.
    ``steady_us``: arrival minus the jumps of the companion's clock; None when it does not fit the relation.
    ``jump_us``: with JUMPED, by how much the companion's clock was set; with TAKEN_BACK, the jump that is cancelled;
    with CORRECTED, by how much the relation was late. ``witnessed``: the stamps of the frames stepped too.
    """

    boot_us: int | None
    steady_us: int | None
    change: ClockChange | None = None
    jump_us: int = 0
    witnessed: bool = False


@dataclass(slots=True)
class _Suspects:
    """Consecutive arrivals that do not fit: raw boot times, arrivals, delays against the relation, all in us."""

    raw_us: list[int] = field(default_factory=list)
    arrival_us: list[int] = field(default_factory=list)
    late_us: list[float] = field(default_factory=list)

    def steady_within_us(self) -> float:
        """Difference between the least delays of both halves, us: large while a backlog drains."""
        half = len(self.late_us) // 2
        return abs(min(self.late_us[:half]) - min(self.late_us[half:]))


def _no_witness(_jump_us: float, _arrival_us: int) -> bool:
    return False


class AutopilotClock:
    """``feed`` takes every arrival with a boot time; ``boot_us`` answers with the boot time of a companion time.

    All times are microseconds. "Steady" is the companion's time without its jumps; ``shift_us`` is their sum
    (raw = steady + shift). ``witness`` says whether the stamps of the frames stepped. Without a witness, a step that a
    link's delay could explain (up to LATEST_US) never counts as a set clock. With ``monotonic`` no step does, because
    that clock cannot be set.
    """

    def __init__(
        self, settings: SyncSettings, witness: Witness = _no_witness, monotonic: bool = False
    ) -> None:
        self._s = settings
        self._witness = _no_witness if monotonic else witness
        self._latest_us = math.inf if monotonic else LATEST_US
        self.shift_us = 0
        self.wraps = 0
        self._restart()
        self._newest_us = 0

    def _restart(self) -> None:
        self._envelope = Envelope(self._s)
        self._trips = RoundTrips(self._s)
        self._suspects = _Suspects()
        self._ambiguous = False
        self._claimed: Arrival | None = None
        self._base_us: int | None = None
        self._wrap_us = 0

    @property
    def settled(self) -> bool:
        """Whether the relation may be used: enough arrivals, no backlog, no series of arrivals against it."""
        known = self._envelope.count >= self._s.clock_min_messages
        return known and not self._ambiguous and not self._envelope.draining(self._newest_us)

    @property
    def std_s(self) -> float:
        """One standard deviation of the relation; it grows while arrivals contradict it."""
        e = self._envelope
        if e.count == 0:
            return math.inf
        std_us = math.hypot(e.std_us, e.doubt_us(self._newest_us))
        trip = self._trips.best(self._newest_us, e.drift)
        if trip is not None and trip.std_us < std_us:
            std_us = trip.std_us
        return math.hypot(std_us, self._trips.contradiction_us(self._newest_us, e)) * 1e-6

    @property
    def late_s(self) -> float:
        """By how much even the least delayed messages of the last second are late, s; 0 for a link in order."""
        return self._envelope.late_us() * 1e-6

    @property
    def drift(self) -> float:
        """How much faster the companion's clock runs than the autopilot's (1e-6: one ppm)."""
        return self._envelope.drift

    def offset_us(self, boot_us: int) -> float:
        """Steady companion time minus boot time, at a boot time."""
        e = self._envelope
        offset_us = e.offset_us(boot_us)
        trip = self._trips.best(self._newest_us, e.drift)
        if trip is not None and trip.std_us < math.hypot(e.std_us, e.doubt_us(self._newest_us)):
            offset_us = min(offset_us, trip.offset_us + e.drift * (boot_us - self._newest_us))
        return offset_us

    def boot_us(self, steady_us: int) -> int:
        """Boot time (without wraps) of a steady companion time."""
        near_us = round(steady_us - self.offset_us(self._newest_us))
        return round(steady_us - self.offset_us(near_us))

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
        if self._envelope.count >= self._s.clock_min_messages and not self._fits(boot_us, delay_us):
            return self._suspect(raw_boot_us, boot_us, arrival_us, delay_us)
        self._suspects, self._ambiguous = _Suspects(), False
        self._newest_us = max(self._newest_us, boot_us)
        if self._claimed is not None and not self._claimed.witnessed:
            early_us = min(0, round(delay_us - self._envelope.offset_us(boot_us)))
            if early_us:
                return self._less_late(boot_us, steady_us, early_us)
        self._envelope.add(boot_us, delay_us)
        if wrapped:
            return Arrival(boot_us, steady_us, ClockChange.WRAPPED)
        by_us = round(self._envelope.correction_us(boot_us))
        return Arrival(boot_us, steady_us, ClockChange.CORRECTED if by_us else None, -by_us)

    def _less_late(self, boot_us: int, steady_us: int, early_us: int) -> Arrival:
        """Earlier than an unwitnessed jump allows: the jump was too large or none, and the relation stays."""
        claimed = self._claimed
        assert claimed is not None
        left_us = claimed.jump_us + early_us
        self.shift_us += early_us
        if claimed.jump_us > 0 and left_us < self._latest_us:
            self.shift_us -= left_us
            self._claimed = None
            return Arrival(boot_us, None, ClockChange.TAKEN_BACK, -claimed.jump_us)
        self._claimed = replace(claimed, jump_us=left_us)
        return Arrival(boot_us, steady_us - early_us)

    def feed_round_trip(self, raw_boot_us: int, arrival_us: int, offset_us: int, round_trip_us: int) -> None:
        """Take one TIMESYNC round trip: companion minus autopilot clock, good to half the trip's length."""
        if self._base_us is None or round_trip_us < 0:
            return
        boot_us, _ = self._unwrap(raw_boot_us, arrival_us - self.shift_us)
        offset = offset_us + raw_boot_us - boot_us - self.shift_us
        self._trips.add(boot_us, offset, round_trip_us, self._envelope)

    def _unwrap(self, raw_boot_us: int, steady_us: int) -> tuple[int, bool]:
        """Boot time nearest to the newest one among those that look the same in 32 bits, and whether that wraps."""
        folded = raw_boot_us % WRAP_US
        wraps = round((self._newest_us - folded) / WRAP_US)
        boot_us = folded + wraps * WRAP_US
        if (
            boot_us // WRAP_US > self._wrap_us
            and self._envelope.count
            and self._fits(boot_us, steady_us - boot_us)
        ):
            self._wrap_us = boot_us // WRAP_US
            self.wraps += 1
            return boot_us, True
        return boot_us, False

    def _fits(self, boot_us: int, delay_us: float) -> bool:
        """Whether an arrival is neither impossibly early nor much later than the relation says."""
        if boot_us < self._newest_us - self._s.jump_min_s * 1e6:
            return False
        return abs(delay_us - self._envelope.offset_us(boot_us)) <= self._s.jump_min_s * 1e6

    def _suspect(self, raw_us: int, boot_us: int, arrival_us: int, delay_us: float) -> Arrival:
        """An arrival that does not fit: it is late, or the first one after a reboot or a jump."""
        min_us = self._s.jump_min_s * 1e6
        late_us = delay_us - self._envelope.offset_us(boot_us)
        fell_us = self._newest_us - boot_us
        if min_us < fell_us < LATEST_US and late_us < LATEST_US:
            return Arrival(
                boot_us, None
            )  # out of order: after a reboot it would be later by the whole uptime
        s = self._suspects
        other_side = bool(s.late_us) and (s.late_us[-1] < 0) != (late_us < 0)
        if s.raw_us and (raw_us < s.raw_us[-1] - min_us or other_side):
            self._suspects = s = _Suspects()  # they do not agree among themselves
        s.raw_us.append(raw_us)
        s.arrival_us.append(arrival_us)
        s.late_us.append(late_us)
        few = len(s.raw_us) < REBOOT_WITNESSES
        if fell_us > min_us:
            self._ambiguous = not few
            return Arrival(None, None) if few else self._reboot(raw_us, arrival_us)
        least_us = min(s.late_us)
        witnessed = self._witness(least_us, s.arrival_us[0])
        self._ambiguous = not few and (late_us < 0 or witnessed)
        if len(s.raw_us) < JUMP_WITNESSES or s.raw_us[-1] - s.raw_us[0] < self._s.jump_confirm_s * 1e6:
            return self._late(boot_us, delay_us)
        if s.steady_within_us() > min_us / 5:
            del s.raw_us[0], s.arrival_us[0], s.late_us[0]
            return self._late(boot_us, delay_us)
        return self._decide(boot_us, arrival_us, round(least_us), witnessed)

    def _late(self, boot_us: int, delay_us: float) -> Arrival:
        """Later than jitter explains: the sample is valid at its boot time, but its arrival is not used as a time."""
        if delay_us > self._envelope.offset_us(boot_us):
            self._newest_us = max(self._newest_us, boot_us)
            self._envelope.add(boot_us, delay_us)
        return Arrival(boot_us, None)

    def _decide(self, boot_us: int, arrival_us: int, by_us: int, witnessed: bool) -> Arrival:
        """Arrivals were late or early by the same amount for long enough: a clock that was set, or the link?"""
        claimed = self._claimed
        taken_back = (
            not witnessed
            and claimed is not None
            and abs(claimed.jump_us + by_us) < self._s.jump_min_s * 1e6 / 2
        )
        if not witnessed and not taken_back and 0 < by_us < self._latest_us:
            s = self._suspects
            del s.raw_us[0], s.arrival_us[0], s.late_us[0]
            return self._late(boot_us, by_us + self._envelope.offset_us(boot_us))
        self._suspects, self._ambiguous = _Suspects(), False
        self._newest_us = max(self._newest_us, boot_us)
        if not witnessed and not taken_back and -self._latest_us < by_us < 0:
            steady_us = arrival_us - self.shift_us
            self._envelope.add(boot_us, steady_us - boot_us)
            return Arrival(boot_us, steady_us, ClockChange.CORRECTED, by_us)
        if taken_back and claimed is not None:
            by_us = -claimed.jump_us
        self.shift_us += by_us
        steady_us = arrival_us - self.shift_us
        self._envelope.add(boot_us, steady_us - boot_us)
        if taken_back and claimed is not None:
            self._claimed = None
            return Arrival(boot_us, steady_us, ClockChange.TAKEN_BACK, by_us, claimed.witnessed)
        found = Arrival(boot_us, steady_us, ClockChange.JUMPED, by_us, witnessed)
        self._claimed = found
        return found

    def _reboot(self, raw_us: int, arrival_us: int) -> Arrival:
        self._restart()
        first = self.feed(raw_us, arrival_us)
        return Arrival(first.boot_us, first.steady_us, ClockChange.REBOOTED)
