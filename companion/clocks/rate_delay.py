"""How late an autopilot's rates of turn are: measured against the turns of its own attitudes.

An autopilot low-passes the rates of its ATTITUDE messages; its angles are not delayed by that. So over a short span
the angles turn by more than the integral of the rates, by delay times the change of the rate:

    turned - integral(rate) = delay (rate_end - rate_start)

One number, the same for all axes and for the whole flight: least squares over all spans, from a first belief.
"""

import math

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

FIRST_S, FIRST_STD_S = 0.008, 0.006
"""The first belief: a second-order filter of 20 Hz (ArduPilot's default) delays by 11 ms, one of 40 Hz by 6 ms."""
_MOST_S = 0.05
"""A longer delay is believed of no filter in flight."""
_MEMORY_S = 60.0
"""Time after which what was measured counts 1/e."""


class RateDelay:
    """The delay of the rates, s, one sigma ``noise_rad`` of a turn between two attitudes."""

    def __init__(self, noise_rad: float) -> None:
        self._first = 2 * (noise_rad / FIRST_STD_S) ** 2
        self._changes = self._products = 0.0
        """Sums of the squares of the rates' changes, and of their products with what the angles turned more."""
        self._last_us: int | None = None

    @property
    def s(self) -> float:
        """The delay believed now, s."""
        delay = (self._first * FIRST_S + self._products) / (self._first + self._changes)
        return min(max(delay, 0.0), _MOST_S)

    def saw(self, boot_us: int, turned_more: Vector, change: Vector) -> None:
        """A span about a moment: the turn (3,) rad less the integral of the rates, and the rates' change (3,) rad/s.

        Yaw is left out, since the compass corrects it. Spans that go back in time are left out, and what is no number.
        """
        if not (np.isfinite(turned_more).all() and np.isfinite(change).all()):
            return
        if self._last_us is not None:
            if boot_us <= self._last_us:
                return
            kept = math.exp((self._last_us - boot_us) * 1e-6 / _MEMORY_S)
            self._changes *= kept
            self._products *= kept
        self._last_us = boot_us
        self._changes += float(change[:2] @ change[:2])
        self._products += float(change[:2] @ turned_more[:2])
