"""An autopilot's own log in the place of a tlog: its samples by boot time, and the companion's time where it is known.

A log is stamped with the autopilot's boot time alone. The companion's time is boot time plus an offset: PX4 logs what
its TIMESYNC requests to the companion found, once a second. Otherwise the offset is found from pictures and attitudes.
"""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.errors import DriverError
from drivers.files.tlog_survey import Survey
from drivers.samples import Attitude, ClockOffset, Imu, Sample

SMOOTHED = 11
"""Round trips whose median is the offset at a moment: one that was held up moves nothing."""

SURE_SIGMAS = 3
"""An offset lies within half a round trip: so many sigmas of one that was found otherwise."""
EVERY_US = 1_000_000

SYSTEM = 1
"""The system id of a log's only vehicle, where it names none."""


@dataclass(frozen=True, slots=True)
class RoundTrip:
    """One TIMESYNC round trip of the autopilot's: companion's time minus boot time, and the trip's length."""

    boot_us: int
    offset_us: int
    round_trip_us: int


@dataclass(frozen=True)
class AutopilotLog:
    """The samples of a log in order of boot time, which their ``arrival_us`` is until the clocks are related.

    ``sources``: what its round trips were made with, one row of them for each program that answered the autopilot.
    """

    name: str
    recorded: tuple[Sample, ...]
    sources: tuple[tuple[RoundTrip, ...], ...] = ()
    system_id: int = SYSTEM

    @property
    def attitudes(self) -> list[Attitude]:
        """The attitudes, by boot time."""
        return [sample for sample in self.recorded if isinstance(sample, Attitude)]

    def by_round_trips(self, first_us: int, last_us: int) -> "LogInTime | None":
        """The log in the time of the companion that answered during the frames; None where none did."""
        start, end = self.recorded[0].arrival_us, self.recorded[-1].arrival_us
        for trips in self.sources:
            offsets = [trip.offset_us for trip in trips]
            if trips and start + min(offsets) <= last_us and end + max(offsets) >= first_us:
                return LogInTime(self, trips)
        return None

    def by_offset(self, offset_us: int, std_s: float) -> "LogInTime":
        """The log with one offset throughout, of one sigma ``std_s``, as if it were of a round trip a second."""
        start, end = self.recorded[0].arrival_us, self.recorded[-1].arrival_us
        trip_us = round(2 * SURE_SIGMAS * std_s * 1e6)
        times = range(start, max(end, start + 1), EVERY_US)
        return LogInTime(self, [RoundTrip(boot_us, offset_us, trip_us) for boot_us in times])


class LogInTime:
    """A log with its clock related to the companion's, as a flight folder takes it."""

    def __init__(self, log: AutopilotLog, trips: Sequence[RoundTrip]) -> None:
        self._log = log
        self._trips = sorted(trips, key=lambda trip: trip.boot_us)
        boots = np.array([trip.boot_us for trip in self._trips], np.float64)
        offsets = np.array([trip.offset_us for trip in self._trips], np.int64)
        self._base = int(offsets[0])
        half = min(SMOOTHED, len(offsets)) // 2
        smooth = [
            np.median(offsets[max(0, k - half) : k + half + 1] - self._base) for k in range(len(offsets))
        ]
        self._boots, self._smooth = boots, np.array(smooth)

    def companion_us(self, boot_us: int) -> int:
        """The companion's time of a boot time, both in microseconds."""
        return boot_us + self._base + round(float(np.interp(boot_us, self._boots, self._smooth)))

    def survey(self) -> Survey:
        """As of a tlog; the companion's clock is taken not to have been set."""
        first, last = self._log.recorded[0].arrival_us, self._log.recorded[-1].arrival_us
        boots = np.array([attitude.boot_us for attitude in self._log.attitudes])
        rate_hz = 1e6 / float(np.median(np.diff(boots))) if len(boots) > 2 else 0.0
        return Survey((self._log.system_id,), (), self.companion_us(first), self.companion_us(last), rate_hz)

    def samples(self) -> Iterator[Sample]:
        """The samples, each arrived when it was logged, and the round trips as of our own TIMESYNC requests."""
        trips = iter(self._trips)
        trip = next(trips, None)
        for sample in self._log.recorded:
            while trip is not None and trip.boot_us <= sample.arrival_us:
                at_us = self.companion_us(trip.boot_us)
                yield ClockOffset(at_us, trip.boot_us, trip.offset_us, trip.round_trip_us)
                trip = next(trips, None)
            yield replace(sample, arrival_us=self.companion_us(sample.arrival_us))


def log_of(
    name: str, samples: list[Sample], sources: Sequence[Sequence[RoundTrip]] = (), system_id: int = SYSTEM
) -> AutopilotLog:
    """A log from samples in any order; DriverError where it lacks what a replay cannot go without."""
    missing = [
        what
        for what, kind in (("attitude", Attitude), ("gyro", Imu))
        if not any(isinstance(sample, kind) for sample in samples)
    ]
    if missing:
        raise DriverError(
            f"{name}: there is no {' and no '.join(missing)} in it; log the flight with its defaults"
        )
    samples.sort(key=lambda sample: sample.arrival_us)
    kept = sorted((tuple(trips) for trips in sources if trips), key=len, reverse=True)
    return AutopilotLog(name, tuple(samples), tuple(kept), system_id)


def with_rates(samples: list[Sample]) -> list[Sample]:
    """The samples with each attitude's rates of turn taken from the gyro sample next before it."""
    imus = sorted((s for s in samples if isinstance(s, Imu)), key=lambda s: s.boot_us)
    times = [imu.boot_us for imu in imus]
    found: list[Sample] = []
    for sample in samples:
        k = bisect_right(times, sample.boot_us) - 1 if isinstance(sample, Attitude) else -1
        if isinstance(sample, Attitude) and k >= 0:
            x, y, z = imus[k].rate
            sample = replace(sample, rollspeed=x, pitchspeed=y, yawspeed=z)
        found.append(sample)
    return found
