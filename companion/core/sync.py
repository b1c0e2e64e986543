"""Frames and telemetry brought together: each frame leaves with the attitude at the middle of its exposure."""

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from companion.clocks.clock import Arrival, AutopilotClock, ClockChange
from companion.clocks.copies import Copies
from companion.clocks.frame_time import Correction, FrameTimeline
from companion.clocks.link_watch import LinkWatch
from companion.core.attitude import AttitudeBuffer, BodyAttitude
from companion.core.estimator_doubt import NO_DOUBT, Doubt, EstimatorDoubt
from companion.core.rangefinder import Rangefinder
from companion.core.velocity import VelocityBuffer
from companion.settings.settings import Settings
from drivers.refusals import RefusalCode
from drivers.samples import Attitude, ClockOffset, Distance, EstimatorReport, Frame, Imu, Sample, Velocity

MILLISECOND_US = 1000
MICROSECOND_SOURCES = ("RAW_IMU", "HIGHRES_IMU")
"""IMU messages stamped in microseconds; all other boot times are cut off to milliseconds."""

TelemetrySample = Attitude | Imu | Velocity


@dataclass(frozen=True, slots=True)
class ReadyFrame:
    """A frame with what is known of the vehicle at mid-exposure.

    ``exposure_us``: mid-exposure on the companion's clock as stamped; ``time_us`` rises from frame to frame;
    ``boot_us``: mid-exposure in boot time, None without a relation. ``attitude`` is the reason where there is none.
    ``velocity_age_s``: from the exposure to the sample of the velocity; ``velocity_noise`` m/s. ``late_s``: lateness
    found along the way, which ``boot_us`` allows for. ``doubt``: of the autopilot's estimator about itself.
    ``range_m``: the rangefinder's distance and one sigma of it.
    """

    frame: Frame
    exposure_us: int
    time_us: int
    boot_us: int | None
    attitude: BodyAttitude | str
    velocity_ned: NDArray[np.float64] | None
    velocity_age_s: float
    velocity_noise: float
    late_s: float
    doubt: Doubt = NO_DOUBT
    range_m: tuple[float, float] | None = None

    @property
    def delay_s(self) -> float:
        """From the exposure to the frame's stamp: what is set and what was found."""
        return (self.frame.stamp_us - self.exposure_us) * 1e-6 + self.late_s


@dataclass(frozen=True, slots=True)
class Notice:
    """Something about the clocks: a name of companion.messages.events and its details."""

    name: str
    details: dict[str, float]


@dataclass(frozen=True, slots=True)
class _Waiting:
    frame: Frame
    steady_us: int
    exposure_us: int
    time_us: int


class Synchroniser:
    """Feed it frames, attitudes, IMU samples, velocities and round trips; take ready frames and notices.

    ``now_us`` is the steady companion time of the newest sample. Frames leave in order, each as soon as an attitude
    behind its exposure and the accelerometer's sample there have come, or after ``sync.attitude_wait_s`` of sample
    time without.
    """

    def __init__(self, settings: Settings, telemetry: bool, monotonic: bool = False) -> None:
        """``monotonic``: arrivals are stamped by a clock that nobody sets, as those of a live vehicle are."""
        self._s = settings.sync
        self.offset_us = round(settings.camera.time_offset_s * 1e6)
        self._telemetry = telemetry
        self.frame_time = FrameTimeline(round(settings.sync.jump_min_s * 1e6))
        self.clock = AutopilotClock(settings.sync, self.frame_time.stepped, monotonic)
        self._link = LinkWatch(settings.sync.jump_min_s)
        self.doubt = EstimatorDoubt()
        self._rangefinder = Rangefinder() if settings.vehicle.rangefinder else None
        self._copies = Copies()
        self._late_s, self._late_std_s = 0.0, settings.estimator.time_offset_std_s
        self._attitudes = AttitudeBuffer(settings.sync)
        self._velocities = VelocityBuffer(settings.sync, self._attitudes)
        self._waiting: deque[_Waiting] = deque()
        self._settled = False
        self.now_us = 0
        self._refused: list[tuple[str, RefusalCode]] = []

    def feed(self, sample: Sample) -> tuple[list[ReadyFrame], list[Notice]]:
        """Take one sample."""
        notices: list[Notice] = []
        ready: list[ReadyFrame] = []
        if isinstance(sample, Frame):
            self._take_frame(sample, notices)
        elif isinstance(sample, TelemetrySample):
            self._take_telemetry(sample, ready, notices)
        elif isinstance(sample, EstimatorReport):
            self.doubt.feed(sample, self.now_us)
        elif isinstance(sample, Distance):
            if self._rangefinder is not None:
                self._rangefinder.feed(sample)
        elif isinstance(sample, ClockOffset):
            s = sample
            self.clock.feed_round_trip(s.boot_us, s.arrival_us, s.offset_us, s.round_trip_us)
        elif not self._telemetry or self.clock.settled:
            self._advance(sample.arrival_us - self.clock.shift_us)
        if self._waiting:
            ready += self._ready()
        return ready, notices

    @property
    def waiting(self) -> bool:
        """Whether a frame waits for an attitude."""
        return bool(self._waiting)

    def allow_for(self, late_s: float, std_s: float) -> None:
        """Frames are later by so much, one sigma, than ``camera.time_offset_s`` says."""
        self._late_s, self._late_std_s = late_s, std_s

    def tick(self, now_us: int) -> list[ReadyFrame]:
        """The companion's time went on to ``now_us`` without a sample."""
        self._advance(now_us - self.clock.shift_us)
        return self._ready()

    def flush(self, reason: str) -> list[ReadyFrame]:
        """All frames still waiting; those without an attitude behind them leave for ``reason``."""
        ready = []
        while self._waiting:
            ready.append(self._leave(self._waiting.popleft(), reason))
        return ready

    def refusals(self) -> list[tuple[str, RefusalCode]]:
        """(input, reason) of the samples refused here since the last call."""
        refused, self._refused = self._refused, []
        return refused

    def raw_us(self) -> int:
        """The newest moment on the companion's clock as it is stamped."""
        return self.now_us + self.frame_time.shift_us

    def _advance(self, steady_us: int) -> None:
        self.now_us = max(self.now_us, steady_us)

    def _take_frame(self, frame: Frame, notices: list[Notice]) -> None:
        times = self.frame_time.feed(frame.stamp_us)
        if isinstance(times, RefusalCode):
            self._refused.append(("frames", times))
            return
        if times.jump_us:
            notices.append(Notice("frames_jumped", {"jump_s": round(times.jump_us * 1e-6, 6)}))
        self._advance(frame.arrival_us - self.frame_time.shift_us)
        exposure_us = frame.stamp_us - self.offset_us
        self._waiting.append(_Waiting(frame, times.steady_us, exposure_us, times.time_us))

    def _take_telemetry(
        self, sample: TelemetrySample, ready: list[ReadyFrame], notices: list[Notice]
    ) -> None:
        if self._copies.is_copy(sample):
            self._refused.append((_INPUT[type(sample)], RefusalCode.REPEATED_MESSAGE))
            return
        exact = isinstance(sample, Imu) and sample.source in MICROSECOND_SOURCES
        arrival = self.clock.feed(sample.boot_us, sample.arrival_us, 0 if exact else MILLISECOND_US)
        if arrival.change is ClockChange.REBOOTED:
            ready += self.flush("autopilot_rebooted")
            self._attitudes.clear()
            self._velocities.clear()
            self.doubt.forget()
            if self._rangefinder is not None:
                self._rangefinder.forget()
            notices.append(Notice("autopilot_rebooted", {}))
            self._settled = False
        elif arrival.change in (ClockChange.JUMPED, ClockChange.TAKEN_BACK):
            notices.append(self._clock_set(arrival))
        elif arrival.change is ClockChange.CORRECTED:
            notices.append(Notice("clock_corrected", {"by_s": round(arrival.jump_us * 1e-6, 6)}))
        elif arrival.change is ClockChange.WRAPPED:
            notices.append(Notice("boot_time_wrapped", {}))
        if arrival.steady_us is not None:
            self._advance(arrival.steady_us)
        if self.clock.settled and not self._settled:
            self._settled = (
                True  # once a boot: a clock that settles again and again is in health, not in events
            )
            notices.append(Notice("clock_settled", {"std_s": round(self.clock.std_s, 6)}))
        if arrival.boot_us is not None:
            self._watch_link(sample.arrival_us - self.clock.shift_us, arrival.boot_us, notices)
            self._keep(sample, arrival.boot_us)
        else:
            self._refused.append((_INPUT[type(sample)], RefusalCode.BOOT_TIME_FELL))

    def _watch_link(self, steady_us: int, boot_us: int, notices: list[Notice]) -> None:
        if self.clock.settled:
            details = self._link.feed(steady_us - boot_us - self.clock.offset_us(boot_us), steady_us)
            if details is not None:
                notices.append(Notice("link_late", details))

    def _clock_set(self, arrival: Arrival) -> Notice:
        """The companion's clock was set, or what was taken for it is undone; the frames follow where they stepped."""
        taken_back = arrival.change is ClockChange.TAKEN_BACK
        correction = None
        if taken_back and arrival.witnessed:
            correction = self.frame_time.jump_taken_back()
        elif arrival.witnessed:
            correction = self.frame_time.telemetry_jumped(arrival.jump_us)
        if correction is not None:
            self._correct_waiting(correction)
        self.now_us = arrival.steady_us or self.now_us  # it may have run ahead with frames that jumped
        name = "clock_jump_taken_back" if taken_back else "clock_jumped"
        jump_s = round(arrival.jump_us * 1e-6, 6)
        return Notice(name, {"jump_s": jump_s, "frames_too": correction is not None})

    def _correct_waiting(self, correction: Correction) -> None:
        """Frames that came between a jump and its discovery move to where they belong."""
        self._waiting = deque(
            replace(w, steady_us=w.steady_us - correction.by_us)
            if w.frame.stamp_us >= correction.from_stamp_us
            else w
            for w in self._waiting
        )

    def _keep(self, sample: TelemetrySample, boot_us: int) -> None:
        if isinstance(sample, Attitude):
            taken = self._attitudes.add_attitude(boot_us, sample)
        elif isinstance(sample, Imu):
            taken = self._attitudes.add_rate(boot_us, sample.rate)
            if sample.force is not None:
                self._velocities.add_force(boot_us, sample.force)
        else:
            taken = self._velocities.add_velocity(boot_us, sample.velocity_ned)
        if not taken:
            self._refused.append((_INPUT[type(sample)], RefusalCode.OUT_OF_ORDER))

    def _ready(self) -> list[ReadyFrame]:
        ready = []
        while self._waiting:
            head = self._waiting[0]
            if self._telemetry and not self._velocity_due(head):
                # A frame that jumped with the clock waits at most as long as it takes to see that.
                waited_us = abs(self.now_us - head.steady_us)
                if waited_us <= self._s.attitude_wait_s * 1e6:
                    break
            ready.append(self._leave(self._waiting.popleft(), "attitude_late"))
        return ready

    def _velocity_due(self, waiting: _Waiting) -> bool:
        """Whether all samples around an exposure have arrived."""
        newest_us = self._attitudes.newest_us
        if newest_us is None or not self.clock.settled:
            return False
        boot_us = self._boot_us(waiting)
        return newest_us >= boot_us and self._velocities.complete(boot_us)

    def _boot_us(self, waiting: _Waiting) -> int:
        return self.clock.boot_us(waiting.steady_us - self.offset_us - round(self._late_s * 1e6))

    def _leave(self, waiting: _Waiting, reason: str) -> ReadyFrame:
        attitude: BodyAttitude | str = "no_telemetry"
        boot_us = velocity = range_m = None
        doubt = NO_DOUBT
        age_s = noise = 0.0
        if self._telemetry:
            attitude = "no_attitude" if self._attitudes.newest_us is None else "clock_unsettled"
            if self.clock.settled:
                boot_us = self._boot_us(waiting)
                attitude = self._attitudes.at(boot_us, math.hypot(self.clock.std_s, self._late_std_s))
                found = self._velocities.at(boot_us)
                range_m = None if self._rangefinder is None else self._rangefinder.at(boot_us)
                doubt = self.doubt.at(self.now_us)
                if found is not None and doubt.velocity_known:
                    velocity, age_s, noise = found
            if attitude == "attitude_not_yet":
                attitude = reason
        return ReadyFrame(
            waiting.frame,
            waiting.exposure_us,
            waiting.time_us,
            boot_us,
            attitude,
            velocity,
            age_s,
            noise,
            self._late_s,
            doubt,
            range_m,
        )


_INPUT = {Attitude: "attitude", Imu: "gyro", Velocity: "velocity"}
