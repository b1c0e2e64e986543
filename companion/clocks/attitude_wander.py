"""How far an autopilot's attitude wanders: turns of its angles that its own rates of turn do not show.

An estimator corrects its angles by compass, accelerometer and GPS: a heading that converges after takeoff, an
alignment in flight, a rough gyro. The vehicle has not turned then, and a camera does not see it. What the angles turn
over a quarter of a second, less the integral of the rates of the same messages, is that correction. It is followed
as a random walk, by axis.
"""

import math

import numpy as np
from numpy.typing import NDArray

from drivers.samples import Attitude
from landing.rotations import log_so3, matrix_from_euler

Vector = NDArray[np.float64]

SPAN_US = 250_000
EVERY_US = 50_000
LONGEST_GAP_US = 30_000
"""Between two messages: of a slower stream, the integral of the rates says nothing."""
MEMORY_S = 3.0
USUAL = 2e-3
"""What a sound estimator's attitude wanders, with the noise of the comparison, rad per root second; not counted.

Measured on ArduPilot: 0.2 to 0.8 in roll and pitch, to 2.3 in yaw under agile flight, 1e-3 rad per root second."""


class AttitudeWander:
    """Feed it every attitude in order; ``std`` is one sigma of the walk beyond the usual, body axes."""

    def __init__(self) -> None:
        self._times: list[int] = []
        self._attitudes: list[Attitude] = []
        self._turned = np.zeros(3)
        """The integral of the rates over the kept attitudes, rad."""
        self._steps: list[Vector] = []
        self._mean = np.zeros(3)
        self._last_us: int | None = None

    @property
    def std(self) -> Vector:
        """One sigma (3,) rad per root second, body axes; 0 for what is usual."""
        excess: Vector = np.sqrt(np.maximum(self._mean - USUAL**2, 0.0))
        return excess

    def feed(self, boot_us: int, attitude: Attitude, delay_s: float) -> None:
        """Take an attitude; its rates are ``delay_s`` late."""
        if self._times:
            gap_us = boot_us - self._times[-1]
            if not 0 < gap_us <= LONGEST_GAP_US:
                self._times.clear()
                self._attitudes.clear()
                self._steps.clear()
                self._turned = np.zeros(3)
            else:
                step = (_rates(attitude) + _rates(self._attitudes[-1])) * (gap_us * 0.5e-6)
                self._steps.append(step)
                self._turned = self._turned + step
        self._times.append(boot_us)
        self._attitudes.append(attitude)
        while len(self._times) > 1 and boot_us - self._times[1] >= SPAN_US:
            self._turned = self._turned - self._steps.pop(0)
            del self._times[0], self._attitudes[0]
        if boot_us - self._times[0] >= SPAN_US and (
            self._last_us is None or boot_us - self._last_us >= EVERY_US or boot_us < self._last_us
        ):
            self._compare(boot_us, delay_s)

    def _compare(self, boot_us: int, delay_s: float) -> None:
        old, new = self._attitudes[0], self._attitudes[-1]
        start, end = (matrix_from_euler(a.roll, a.pitch, a.yaw) for a in (old, new))
        more = log_so3(start.T @ end) - self._turned - delay_s * (_rates(new) - _rates(old))
        passed_s = EVERY_US * 1e-6 if self._last_us is None else (boot_us - self._last_us) * 1e-6
        self._last_us = boot_us
        if not np.isfinite(more).all():
            return
        square = more * more / ((boot_us - self._times[0]) * 1e-6)
        share = -math.expm1(-max(passed_s, 0.0) / MEMORY_S)
        self._mean = self._mean + share * (square - self._mean)


def _rates(attitude: Attitude) -> Vector:
    return np.array((attitude.rollspeed, attitude.pitchspeed, attitude.yawspeed))
