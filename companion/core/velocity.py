"""The vehicle's velocity at an exposure: LOCAL_POSITION_NED, carried on from message to message by the accelerometer.

A velocity message is 20 to 100 ms from the next, and a vehicle that is jolted by gusts or brakes does not go
straight from one to the other. The accelerometer measures the change. Its samples have passed the autopilot's
low-pass filter, one of Butterworth's of second order, which delays what is slow by d = sqrt(2) / (2 pi cutoff) and is
undone by a = f + d f' + d^2 / 2 f'': the integral of a is that of the samples f, plus d f, plus d^2 / 2 f'. So only
the sample next behind an exposure is waited for. The delay is found on the way.
"""

import math
from bisect import bisect_left, bisect_right
from collections import deque

import numpy as np
from numpy.typing import NDArray

from companion.core.attitude import AttitudeBuffer
from companion.settings.settings import SyncSettings
from drivers.samples import GRAVITY, Vector3

KEPT = 128
"""Messages kept of each kind: a second of samples at 100 Hz, which is more than anything here looks back."""

EXTRAPOLATED_US = 20_000
"""The last acceleration is taken to go on for so long."""

AGE_US = 2_000
"""How old a sample is when it is stamped, with what the difference of two samples is late by against their slope."""

JUMP_M_S = 0.25
"""A step of the velocity without an acceleration is a reset of the autopilot's filter: what was before is void."""

MEMORY_S = 5.0
"""Time constant of the errors by which the two ways to a velocity are compared."""

BIAS_S = 2.0
"""Time constant of the accelerometer's bias, which is constant in the body and not in the world."""

DELAY_MEMORY_S = 120.0
STEP_US = 100_000
"""Changes of the velocity over so long are held against the accelerometer's."""

FEWEST = 10
"""Messages after which the accelerometer may be trusted."""

DELAY_PRIOR = 0.15
"""Weight of the delay that is set against what is found: (3 mm/s of noise over 8 ms of doubt), squared."""


class VelocityBuffer:
    """Velocities and accelerations of the last second, by boot time without wraps (microseconds)."""

    def __init__(self, settings: SyncSettings, attitudes: AttitudeBuffer) -> None:
        self._max_age_us = round(settings.velocity_max_age_s * 1e6)
        self._max_gap_us = settings.gyro_max_gap_s * 1e6
        self._span_us = round(settings.velocity_span_s * 1e6)
        self._age_us = round(settings.velocity_delay_s * 1e6)
        self._first_delay_s = settings.accelerometer_delay_s
        self._attitudes = attitudes
        self.clear()

    def clear(self) -> None:
        """Forget everything, as after a reboot."""
        self._samples: deque[tuple[int, Vector3]] = deque(maxlen=KEPT)
        self._times: deque[int] = deque(maxlen=KEPT)
        self._filtered: deque[Vector3] = deque(maxlen=KEPT)
        """Accelerations (m/s^2, NED) as the filter lets them through."""
        self._summed: Vector3 = (0.0, 0.0, 0.0)
        self._gained: deque[Vector3] = deque(maxlen=KEPT)
        """What the accelerometer adds up to, the filter undone: the velocity but for a constant and a drift."""
        self._extrapolated: Vector3 = (0.0, 0.0, 0.0)
        self._bias: Vector3 = (0.0, 0.0, 0.0)
        self._seen = self._compared = 0
        self._straight2 = self._carried2 = 0.0
        """Mean squared errors (m/s)^2, all axes, of a velocity predicted from its neighbours, by the accelerometer."""
        self._delay_ss = self._delay_sr = 0.0

    @property
    def delay_s(self) -> float:
        """How late the accelerometer's samples are against the velocities, beyond their age."""
        found = (self._delay_sr + DELAY_PRIOR * self._first_delay_s) / (self._delay_ss + DELAY_PRIOR)
        return min(max(found, 0.0), 0.05)

    @property
    def carried(self) -> bool:
        """Whether the accelerometer predicts better than a straight line from message to message."""
        return self._span_us > 0 and self._compared >= FEWEST and self._carried2 < self._straight2

    def add_velocity(self, boot_us: int, velocity: Vector3) -> bool:
        """Take one velocity (m/s, NED); False if it does not come after the newest one."""
        samples, boot_us = self._samples, boot_us - self._age_us
        if samples and boot_us <= samples[-1][0]:
            return False
        if samples and self.carried and self._jumped(boot_us, velocity):
            samples.clear()
        samples.append((boot_us, velocity))
        self._compare()
        return True

    def add_force(self, boot_us: int, force: Vector3) -> bool:
        """Take one specific force (m/s^2, body); False if it is not newer than the last."""
        times = self._times
        if times and boot_us <= times[-1]:
            return False
        delay_s = self.delay_s
        turned = self._attitudes.to_ned(boot_us - round(delay_s * 1e6), force)
        if turned is None:
            return True
        filtered = (turned[0], turned[1], turned[2] + GRAVITY)
        change: Vector3 = (0.0, 0.0, 0.0)
        if not times or boot_us - times[-1] > self._max_gap_us:
            times.clear()
            self._filtered.clear()
            self._gained.clear()
        else:
            before, step_s = self._filtered[-1], (boot_us - times[-1]) * 1e-6
            self._summed = _sum(self._summed, _sum(filtered, before), 0.5 * step_s)
            change = _sum(filtered, before, -1.0)
            change = (change[0] / step_s, change[1] / step_s, change[2] / step_s)
        times.append(boot_us)
        self._filtered.append(filtered)
        self._extrapolated = _sum(filtered, change, delay_s)
        self._gained.append(_sum(_sum(self._summed, filtered, delay_s), change, delay_s * delay_s / 2))
        return True

    def complete(self, boot_us: int) -> bool:
        """Whether no further sample would improve the velocity at ``boot_us``."""
        if not self.carried or not self._times or self._times[-1] >= boot_us + AGE_US:
            return True
        newest_us = self._attitudes.newest_us
        # silent while attitudes go on: it will not come
        return newest_us is None or newest_us - self._times[-1] > EXTRAPOLATED_US

    def at(self, boot_us: int) -> tuple[NDArray[np.float64], float, float] | None:
        """Velocity (3,) NED at an exposure, the age in s of its sample, and its noise, one sigma of an axis.

        The mean of the velocities of the last ``sync.velocity_span_s``, each carried on by the accelerometer; where
        that has no sample, on the straight line between two messages. None without a message that is near enough.
        """
        if self.carried:
            found = self._carry(boot_us, len(self._samples))
            if found is not None:
                return np.array(found), 0.0, math.sqrt(self._carried2 / 3)
        straight = self._straight(boot_us)
        return None if straight is None else (*straight, math.sqrt(self._straight2 / 3))

    def _jumped(self, boot_us: int, velocity: Vector3) -> bool:
        before_us, before = self._samples[-1]
        gain = self._gain(before_us, boot_us)
        return gain is not None and math.dist(velocity, _sum(before, gain)) > JUMP_M_S

    def _gain(self, from_us: int, to_us: int) -> Vector3 | None:
        """Change of the velocity between two moments by the accelerometer; None where it has no samples."""
        start, end = self._gained_at(from_us + AGE_US), self._gained_at(to_us + AGE_US)
        if start is None or end is None:
            return None
        return _sum(_sum(end, start, -1.0), self._bias, (to_us - from_us) * 1e-6)

    def _gained_at(self, boot_us: int) -> Vector3 | None:
        times, gained = self._times, self._gained
        if not times or boot_us < times[0] or boot_us > times[-1] + EXTRAPOLATED_US:
            return None
        k = bisect_right(times, boot_us)
        if k == len(times):
            return _sum(gained[-1], self._extrapolated, (boot_us - times[-1]) * 1e-6)
        share = (boot_us - times[k - 1]) / (times[k] - times[k - 1])
        return _sum(gained[k - 1], _sum(gained[k], gained[k - 1], -1.0), share)

    def _carry(self, boot_us: int, end: int) -> Vector3 | None:
        """The mean of the velocities before number ``end``, carried to a moment behind them or a little before."""
        samples, total, count = self._samples, (0.0, 0.0, 0.0), 0
        for k in range(end - 1, -1, -1):
            at_us, velocity = samples[k]
            if at_us < boot_us - self._span_us and count:
                break
            if at_us < boot_us - self._max_age_us or at_us > boot_us + self._max_age_us:
                continue
            gain = self._gain(at_us, boot_us)
            if gain is None:
                break
            total, count = _sum(_sum(total, velocity), gain), count + 1
        return (total[0] / count, total[1] / count, total[2] / count) if count else None

    def _straight(self, boot_us: int) -> tuple[NDArray[np.float64], float] | None:
        """Interpolated between two messages; just behind the last one it goes on as it changed before."""
        samples, max_age_us = self._samples, self._max_age_us
        k = next((k for k in range(len(samples) - 1, -1, -1) if samples[k][0] <= boot_us), -1)
        near = [
            samples[i]
            for i in (k, k + 1)
            if 0 <= i < len(samples) and abs(samples[i][0] - boot_us) <= max_age_us
        ]
        if not near:
            return None
        age_s = min(abs(at_us - boot_us) for at_us, _ in near) * 1e-6
        first = k if k + 1 < len(samples) else k - 1
        if first >= 0:
            (from_us, before), (to_us, after) = samples[first], samples[first + 1]
            interval_us = to_us - from_us
            if interval_us <= max_age_us and boot_us - to_us <= interval_us:
                share = (boot_us - from_us) / interval_us
                return (1 - share) * np.array(before) + share * np.array(after), age_s
        return np.array(near[0][1]), age_s

    def _compare(self) -> None:
        """Hold the last message but one, behind which all accelerometer samples are there, against both predictions."""
        samples = self._samples
        if len(samples) < 3:
            return
        (before_us, before), (at_us, velocity), (after_us, after) = (samples[k] for k in (-3, -2, -1))
        if after_us - before_us > 2 * self._max_age_us:
            return
        interval_s = (after_us - at_us) * 1e-6
        share = (at_us - before_us) / (after_us - before_us)
        straight = _sum(before, _sum(after, before, -1.0), share)
        weight = max(1 / (self._seen + 1), -math.expm1(-interval_s / MEMORY_S))
        self._seen += 1
        self._straight2 += weight * (math.dist(straight, velocity) ** 2 - self._straight2)
        carried = self._carry(at_us, len(samples) - 2)
        if carried is None:
            self._compared, self._carried2 = 0, 0.0
            return
        weight = max(1 / (self._compared + 1), weight)
        self._compared += 1
        self._carried2 += weight * (math.dist(carried, velocity) ** 2 - self._carried2)
        self._learn(at_us, velocity, interval_s)

    def _learn(self, at_us: int, velocity: Vector3, interval_s: float) -> None:
        """The accelerometer's bias and delay, from what it says of a change of the velocity."""
        k = next(
            (k for k in range(len(self._samples) - 1, -1, -1) if self._samples[k][0] <= at_us - STEP_US), None
        )
        if k is None:
            return
        from_us, before = self._samples[k]
        gain = self._gain(from_us, at_us)
        filtered = self._filtered_at(from_us), self._filtered_at(at_us)
        if gain is None or filtered[0] is None or filtered[1] is None:
            return
        span_s = (at_us - from_us) * 1e-6
        wrong = _sum(_sum(velocity, before, -1.0), gain, -1.0)
        # the vertical alone: errors of the attitude, which come late as well, do not reach it
        slope = filtered[1] - filtered[0]
        keep = math.exp(-interval_s / DELAY_MEMORY_S)
        self._delay_sr = keep * self._delay_sr + slope * (wrong[2] + slope * self.delay_s)
        self._delay_ss = keep * self._delay_ss + slope * slope
        self._bias = _sum(self._bias, wrong, -math.expm1(-interval_s / BIAS_S) / span_s)

    def _filtered_at(self, boot_us: int) -> float | None:
        """The sample of the acceleration downwards next behind a moment."""
        k = bisect_left(self._times, boot_us)
        return self._filtered[k][2] if 0 < k < len(self._times) else None


def _sum(a: Vector3, b: Vector3, factor: float = 1.0) -> Vector3:
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]
