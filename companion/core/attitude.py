"""The vehicle's attitude at any moment between two messages: interpolated, never extrapolated."""

import math
from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from companion.clocks.attitude_wander import AttitudeWander
from companion.clocks.rate_delay import RateDelay
from companion.settings.settings import SyncSettings
from drivers.samples import Attitude, Vector3
from landing.rotations import exp_so3, log_so3, matrix_from_euler

KEEP_US = 4_000_000
"""How much of the past is kept; frames wait far shorter than this."""

RATE_SPAN_US = 40_000
"""Span of the attitudes around a moment that its rate of turn is taken from."""

ATTITUDE_WITNESSES = 3
"""Frames in a row without an attitude (or with one again) before it counts."""

SWING_S = 0.5
"""Time constant of the turn rate's mean and variance."""

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class BodyAttitude:
    """``ned_from_body`` (3, 3) at a moment and ``turn_rate`` (3,) rad/s about the body's axes.

    ``rotation_std``, ``tilt_std`` in rad per axis: see AttitudeBuffer.at. ``wander`` (3,) rad per root second about the
    body's axes, beyond the usual; None for none.
    """

    ned_from_body: NDArray[np.float64]
    rotation_std: float
    tilt_std: float
    turn_rate: Vector
    wander: Vector | None = None


class FramesAttitude:
    """Whether the frames have an attitude: ``missing`` is why they have none, in words; empty while they have one."""

    def __init__(self) -> None:
        self.missing = ""
        self._known: bool | None = None
        self._streak = 0

    def step(self, attitude: BodyAttitude | str) -> str:
        """Take a frame's attitude or why there is none; the name of the event where that has changed for good."""
        reason = attitude if isinstance(attitude, str) else ""
        known = not reason
        if reason and self.missing:
            self.missing = reason.replace("_", " ")
        if known == self._known or reason == "no_telemetry":
            self._streak = 0
            return ""
        self._streak += 1
        first = self._known is None and known
        if not first and self._streak < ATTITUDE_WITNESSES:
            return ""
        self._known, self._streak = known, 0
        self.missing = reason.replace("_", " ")
        return "" if first else "attitude_back" if known else "attitude_lost"


class AttitudeBuffer:
    """Attitudes and gyro samples of the last seconds, by boot time without wraps (microseconds)."""

    def __init__(self, settings: SyncSettings) -> None:
        self._s = settings
        self._max_gap_us = settings.attitude_max_gap_s * 1e6
        self._slerp_gap_us = settings.slerp_max_gap_s * 1e6
        self._gyro_reach_us = settings.gyro_max_gap_s * 1e6
        self._gyro_delay_us = round(settings.gyro_delay_s * 1e6)
        self.clear()

    def clear(self) -> None:
        """Forget everything, as after a reboot."""
        self._times: list[int] = []
        self._attitudes: list[Attitude] = []
        self._gyro_times: list[int] = []
        self._gyro: list[Vector3] = []
        self._mean_rate = [0.0, 0.0, 0.0]
        self._rate_variance = 0.0
        self._tilt_rate2 = 0.0
        self._delay = RateDelay(self._s.attitude_noise_rad)
        self._wander = AttitudeWander()

    @property
    def newest_us(self) -> int | None:
        """Boot time of the newest attitude."""
        return self._times[-1] if self._times else None

    def add_attitude(self, boot_us: int, attitude: Attitude) -> bool:
        """Take one attitude; False if it does not come after the newest one."""
        if self._times and boot_us <= self._times[-1]:
            return False
        step_s = (boot_us - self._times[-1]) * 1e-6 if self._times else 0.0
        self._times.append(boot_us)
        self._attitudes.append(attitude)
        self._follow_swing(attitude, step_s)
        self._wander.feed(boot_us, attitude, self._delay.s)
        if self._times[-1] - self._times[0] > 2 * KEEP_US:
            old = bisect_left(self._times, boot_us - KEEP_US)
            del self._times[:old], self._attitudes[:old]
        return True

    def add_rate(self, boot_us: int, rate: Vector3) -> bool:
        """Take one gyro sample (delayed by the autopilot's filter); False if it is not newer than the last."""
        boot_us -= self._gyro_delay_us
        if self._gyro_times and boot_us <= self._gyro_times[-1]:
            return False
        self._gyro_times.append(boot_us)
        self._gyro.append(rate)
        if self._gyro_times[-1] - self._gyro_times[0] > 2 * KEEP_US:
            old = bisect_left(self._gyro_times, boot_us - KEEP_US)
            del self._gyro_times[:old], self._gyro[:old]
        return True

    def at(self, boot_us: int, moment_std_s: float = 0.0) -> BodyAttitude | str:
        """The attitude at a boot time, or the reason there is none.

        Reasons: "no_attitude" (none came yet), "attitude_too_late" (the moment lies before all of them),
        "attitude_not_yet" (behind all of them), "attitude_gap" (between two that are too far apart).

        ``rotation_std`` speaks of the rotation between two exposures, per axis, all one sigma:
        std^2 = noise^2 + (rate stamp_jitter)^2 + (swing moment_std)^2 + bow^2. ``moment_std_s`` is the doubt about
        both moments alike (clocks, the camera's lateness), so that it matters only by the swing, the deviation of the
        turn rate from its mean over half a second; stamps jitter singly. bow is what interpolation cannot see: the
        change of rate between the two neighbours times an eighth of their gap (the sagitta of a parabola), with the
        gyro's gap where it fills in.

        ``tilt_std`` speaks of roll and pitch themselves: the RMS of their rates over half a second, times that doubt
        and the doubt about the delay of the autopilot's own filter, ``attitude_delay_std_s``.
        """
        times = self._times
        if not times:
            return "no_attitude"
        if boot_us < times[0]:
            return "attitude_too_late"
        if boot_us > times[-1]:
            return "attitude_not_yet"
        k = bisect_right(times, boot_us)
        before = self._attitudes[k - 1]
        start = matrix_from_euler(before.roll, before.pitch, before.yaw)
        if times[k - 1] == boot_us:
            std = self._std(before, before, 0.0, moment_std_s)
            tilt_std, turn_rate = self._tilt_std(moment_std_s), self._turn_rate(k - 1, k - 1, boot_us)
            return BodyAttitude(start, std, tilt_std, turn_rate, self._walk())
        after = self._attitudes[k]
        gap_us = times[k] - times[k - 1]
        if gap_us > self._max_gap_us:
            return "attitude_gap"
        end = matrix_from_euler(after.roll, after.pitch, after.yaw)
        share = (boot_us - times[k - 1]) / gap_us
        turned, blind_us, rate = np.eye(3), gap_us, None
        closing = start.T @ end
        if gap_us > self._slerp_gap_us:
            rates = self._rates(times[k - 1], times[k])
            if rates is not None:
                blind_us = max(b - a for (a, _), (b, _) in pairwise(rates))
                turned, whole = _integrate(rates, boot_us)
                closing = whole.T @ closing
                rate = _interpolated(rates, boot_us) + log_so3(closing) / (gap_us * 1e-6)
        attitude = start @ turned @ exp_so3(share * log_so3(closing))
        std = self._std(before, after, blind_us * 1e-6, moment_std_s)
        if rate is None:
            rate = self._turn_rate(k - 1, k, boot_us)
        return BodyAttitude(attitude, std, self._tilt_std(moment_std_s), rate, self._walk())

    def _walk(self) -> Vector | None:
        std = self._wander.std
        return std if std.any() else None

    def _turn_rate(self, first: int, last: int, boot_us: int) -> Vector:
        """The rate of turn (3,) rad/s between attitudes ``first`` and ``last``, without the filter's delay."""
        times = self._times
        while first > 0 and boot_us - times[first] < RATE_SPAN_US / 2:
            first -= 1
        while last < len(times) - 1 and times[last] - boot_us < RATE_SPAN_US / 2:
            last += 1
        around = self._attitudes[first : last + 1]
        rates = [(time_us, _rates_of(a)) for time_us, a in zip(times[first : last + 1], around, strict=True)]
        filtered, change = _interpolated(rates, boot_us), rates[-1][1] - rates[0][1]
        span_us = times[last] - times[first]
        if not 0 < span_us <= 2 * RATE_SPAN_US:
            return filtered
        start, end = (matrix_from_euler(a.roll, a.pitch, a.yaw) for a in (around[0], around[-1]))
        integral = sum((a + b) * ((u - t) * 0.5e-6) for (t, a), (u, b) in pairwise(rates))
        self._delay.saw(boot_us, log_so3(start.T @ end) - integral, change)
        return filtered + change * (self._delay.s / (span_us * 1e-6))

    def to_ned(self, boot_us: int, vector: Vector3) -> Vector3 | None:
        """A vector of the body's axes in the world's, by the attitude then, or the newest one; None before the first.

        Euler angles are interpolated: milliradians off within a looping, exact enough for a force.
        """
        times, k = self._times, bisect_right(self._times, boot_us)
        if not k:
            return None
        a = b = self._attitudes[k - 1]
        share = 0.0
        if k < len(times):
            b = self._attitudes[k]
            share = (boot_us - times[k - 1]) / (times[k] - times[k - 1])
        roll = a.roll + share * math.remainder(b.roll - a.roll, math.tau)
        yaw = a.yaw + share * math.remainder(b.yaw - a.yaw, math.tau)
        x, y, z = (matrix_from_euler(roll, a.pitch + share * (b.pitch - a.pitch), yaw) @ vector).tolist()
        return x, y, z

    def _rates(self, start_us: int, end_us: int) -> list[tuple[int, Vector]] | None:
        """Turn rates from start to end; None where the gyro has no sample inside or does not reach near the ends.

        At the ends the rate is interpolated, or the nearest sample's where the next one is still under way; the
        error of that goes into the closing, which the attitudes themselves fix.
        """
        times = self._gyro_times
        first, last = bisect_right(times, start_us), bisect_left(times, end_us)
        if first >= last or max(times[first] - start_us, end_us - times[last - 1]) > self._gyro_reach_us:
            return None
        inner = [(times[i], np.array(self._gyro[i])) for i in range(first, last)]
        return [(start_us, self._rate_at(first, start_us)), *inner, (end_us, self._rate_at(last, end_us))]

    def _rate_at(self, k: int, boot_us: int) -> Vector:
        """Turn rate between gyro samples k - 1 and k, or that of the only one of them there is."""
        if k == 0 or k == len(self._gyro):
            return np.array(self._gyro[max(0, k - 1)])
        a, b = self._gyro_times[k - 1], self._gyro_times[k]
        share = (boot_us - a) / (b - a)
        return (1 - share) * np.array(self._gyro[k - 1]) + share * np.array(self._gyro[k])

    def _follow_swing(self, attitude: Attitude, step_s: float) -> None:
        weight = -math.expm1(-step_s / SWING_S)
        rates = (attitude.rollspeed, attitude.pitchspeed, attitude.yawspeed)
        if step_s == 0.0:
            self._mean_rate = list(rates)
            return
        deviation2 = 0.0
        for i, rate in enumerate(rates):
            deviation = rate - self._mean_rate[i]
            self._mean_rate[i] += weight * deviation
            deviation2 += deviation * deviation
        self._rate_variance += weight * (deviation2 / 3 - self._rate_variance)
        tilt_rate2 = (attitude.rollspeed**2 + attitude.pitchspeed**2) / 2
        self._tilt_rate2 += weight * (tilt_rate2 - self._tilt_rate2)

    def _std(self, before: Attitude, after: Attitude, blind_s: float, moment_std_s: float) -> float:
        rate = math.sqrt((before.rollspeed**2 + before.pitchspeed**2 + before.yawspeed**2) / 3)
        change = math.dist(
            (before.rollspeed, before.pitchspeed, before.yawspeed),
            (after.rollspeed, after.pitchspeed, after.yawspeed),
        )
        return math.hypot(
            self._s.attitude_noise_rad,
            rate * self._s.stamp_jitter_s,
            math.sqrt(self._rate_variance) * moment_std_s,
            change * blind_s / 8,
        )

    def _tilt_std(self, moment_std_s: float) -> float:
        return math.sqrt(self._tilt_rate2) * math.hypot(moment_std_s, self._s.attitude_delay_std_s)


def _rates_of(attitude: Attitude) -> Vector:
    return np.array((attitude.rollspeed, attitude.pitchspeed, attitude.yawspeed))


def _interpolated(rates: list[tuple[int, Vector]], boot_us: int) -> Vector:
    """The rate (3,) between the two samples around a moment, or the nearest one's."""
    for (a, rate_a), (b, rate_b) in pairwise(rates):
        if boot_us <= b:
            share = (boot_us - a) / (b - a)
            return (1 - share) * rate_a + share * rate_b
    return rates[-1][1]


def _integrate(rates: list[tuple[int, Vector]], boot_us: int) -> tuple[Vector, Vector]:
    """Rotations (3, 3) from the first rate's time to ``boot_us`` and to the last rate's, rates linear between."""
    turned = whole = np.eye(3)
    for (a, rate_a), (b, rate_b) in pairwise(rates):
        if a < boot_us <= b:
            share = (boot_us - a) / (b - a)
            middle = rate_a + share / 2 * (rate_b - rate_a)
            turned = whole @ exp_so3(middle * ((boot_us - a) * 1e-6))
        whole = whole @ exp_so3((rate_a + rate_b) * ((b - a) * 0.5e-6))
    return turned, whole
