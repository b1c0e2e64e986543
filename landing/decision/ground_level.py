"""The height over the ground below, by what measures it and by what a climb or a descent does to the view.

What the view and a velocity say of the height is noisy while the vehicle is slow, and wrong for seconds. The altitude
of an autopilot is smooth. So the level of the ground in the autopilot's axes is filtered (a Kalman filter of one
state; errors that last count as fewer measurements), and the height is what the vehicle is above it. Two sources:

- the height of each frame, with its standard deviation;
- while it sinks or climbs, the altitude against the divergence of the view (de Croon 2016, "Distance estimation with
  efference copies and optical flow maneuvers"): with the sink over height summed up to L, a descent by z has come
  down to z / (exp(L) - 1). No velocity is needed for it.
"""

import math
from collections import deque
from dataclasses import dataclass

from landing.decision.orders import Vector

LASTS_S = 2.0
"""How long an error of a measured height lasts."""
LEVEL_CHANGE = 0.03
"""Change of the level of the ground below in the square root of a second, over the height, one sigma."""
SLOPE = 0.15
"""Change of that level over a metre of way, one sigma: ground is steeper in places."""
WINDOW_S = 6.0
"""So long a descent is looked back over."""
ALTITUDE_STD_M = 0.04
"""Of a difference of altitudes."""
LEAST_RISE_M = 0.3
"""A smaller climb or descent says nothing."""
APPROACH_STD, APPROACH_DRIFT = 0.02, 0.015
"""Of the sum of sink over height, and what is added in a second."""
GATE = 3.0
"""Standard deviations by which a measurement must differ to count against the level."""
ANEW_S = 0.5
"""So long measurements must differ for the level to be another: a step, a roof, an altitude that jumped."""
KNOWN_STD = 0.35
"""Relative standard deviation above which the height is unknown."""


@dataclass(frozen=True, slots=True)
class _Passed:
    time_s: float
    local_ned: Vector
    sunk: float
    """Sum of the sink over height."""


class GroundLevel:
    """``step`` at every frame; ``height_m`` and ``std_m`` follow, NaN while unknown."""

    def __init__(self) -> None:
        self.height_m = self.std_m = math.nan
        self._passed: deque[_Passed] = deque()
        self._down, self._variance = math.nan, math.inf
        self._differs_s = math.nan

    def step(
        self, time_s: float, local_ned: Vector | None, approach: float, height_m: float, std_m: float
    ) -> None:
        """Take a frame: the autopilot's position, the sink over height by the view (1/s), what measures the height."""
        if local_ned is None or not all(map(math.isfinite, local_ned)):
            self._forget()
            return
        last = self._passed[-1] if self._passed else None
        interval_s = math.nan if last is None else time_s - last.time_s
        if last is None or not 0 < interval_s < 1:
            self._forget()
            self._passed.append(_Passed(time_s, local_ned, 0.0))
            interval_s = math.inf
        else:
            self._carry_on(last, time_s, local_ned, approach, interval_s)
        if 0 < height_m < math.inf and 0 < std_m < math.inf:
            self._measure(time_s, local_ned[2] + height_m, std_m, LASTS_S / interval_s)
        self._by_descent(interval_s)
        over_m, std_m = self._down - local_ned[2], math.sqrt(self._variance)
        known = std_m <= KNOWN_STD * over_m
        self.height_m, self.std_m = (over_m, std_m) if known else (math.nan, math.nan)

    def _carry_on(
        self, last: _Passed, time_s: float, here: Vector, approach: float, interval_s: float
    ) -> None:
        if not math.isfinite(approach):
            self._passed.clear()
        sunk = last.sunk + approach * interval_s if math.isfinite(approach) else 0.0
        self._passed.append(_Passed(time_s, here, sunk))
        while self._passed[0].time_s < time_s - WINDOW_S:
            self._passed.popleft()
        over_m = max(self._down - here[2], 0.0)
        # ground goes up and down: its level wanders with the root of the way
        way_m = math.dist(here[:2], last.local_ned[:2])
        self._variance += (LEVEL_CHANGE * over_m) ** 2 * interval_s + SLOPE**2 * way_m

    def _by_descent(self, interval_s: float) -> None:
        first, last = self._passed[0], self._passed[-1]
        down_m, sunk = last.local_ned[2] - first.local_ned[2], last.sunk - first.sunk
        if not (abs(down_m) >= LEAST_RISE_M and sunk * down_m > 0):
            return
        height_m = down_m / math.expm1(sunk)
        span_s = last.time_s - first.time_s
        aside_m = SLOPE * math.dist(first.local_ned[:2], last.local_ned[:2])
        of_sum = (APPROACH_STD + APPROACH_DRIFT * span_s) * math.exp(sunk) / abs(math.expm1(sunk))
        std_m = height_m * math.hypot(of_sum, math.hypot(ALTITUDE_STD_M, aside_m) / down_m)
        self._measure(last.time_s, last.local_ned[2] + height_m, std_m, span_s / interval_s)

    def _measure(self, time_s: float, down_m: float, std_m: float, alike: float) -> None:
        """``alike``: how many measurements share one error."""
        if not math.isfinite(self._variance):
            self._down, self._variance = down_m, std_m * std_m
            return
        innovation = down_m - self._down
        if abs(innovation) > GATE * math.sqrt(self._variance + std_m * std_m):
            if not math.isfinite(self._differs_s):
                self._differs_s = time_s
            if time_s - self._differs_s >= ANEW_S:
                self._down, self._variance, self._differs_s = down_m, std_m * std_m, math.nan
            return
        self._differs_s = math.nan
        noise = std_m * std_m * max(alike, 1.0)
        gain = self._variance / (self._variance + noise)
        self._down += gain * innovation
        self._variance *= 1 - gain

    def _forget(self) -> None:
        self.height_m = self.std_m = math.nan
        self._passed.clear()
        self._down, self._variance, self._differs_s = math.nan, math.inf, math.nan
