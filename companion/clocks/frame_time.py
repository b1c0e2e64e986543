"""The frames' own time line: stamps that repeat or fall back are refused, a clock that was set is followed."""

from collections import deque
from dataclasses import dataclass

from drivers.refusals import RefusalCode

WITNESSES = 3
"""Frames in a row that fell back and rise among themselves: the clock was set, they are not out of order."""

START_PERIOD_US = 33_333
PERIOD_WEIGHT = 0.1
"""Weight of the newest interval in the usual one."""

STEPS_KEPT_US = 5_000_000
"""How long a step in the stamps waits for the telemetry to show the same."""

SAME_MOMENT_US = 250_000
"""A clock that is set steps the stamps of frames and the arrivals of messages within so much."""


@dataclass(frozen=True, slots=True)
class FrameTime:
    """``steady_us``: the stamp with jumps of the companion's clock taken out; ``time_us`` rises with every frame."""

    steady_us: int
    time_us: int
    jump_us: int = 0


@dataclass(frozen=True, slots=True)
class _Step:
    excess_us: int
    stamp_us: int
    steady_us: int
    applied_us: int


@dataclass(frozen=True, slots=True)
class Correction:
    """Frames stamped from ``from_stamp_us`` on were ``by_us`` too late on the steady time line."""

    from_stamp_us: int
    by_us: int


class FrameTimeline:
    """Feed it every stamp. ``step_min_us``: a gap that is longer than usual by this may be a jump of the clock."""

    def __init__(self, step_min_us: int) -> None:
        self.shift_us = 0
        self._step_min_us = step_min_us
        self._period_us = float(START_PERIOD_US)
        self._last_us: int | None = None
        self._time_us = 0
        self._lead_us = 0
        self._fallen: list[int] = []
        self._steps: deque[_Step] = deque(maxlen=8)
        self._taken_out: Correction | None = None

    def feed(self, stamp_us: int) -> FrameTime | RefusalCode:
        """The times of a frame, or why it is refused: REPEATED_STAMP, BACKWARD_STAMP."""
        if self._last_us is None:
            self._last_us = self._time_us = stamp_us
            return FrameTime(stamp_us, stamp_us)
        delta_us = stamp_us - self._last_us
        if delta_us == 0:
            return RefusalCode.REPEATED_STAMP
        jump_us = 0
        if delta_us < 0:
            self._fallen = (
                [*self._fallen, stamp_us] if not self._fallen or stamp_us > self._fallen[-1] else [stamp_us]
            )
            if len(self._fallen) < WITNESSES:
                return RefusalCode.BACKWARD_STAMP
            jump_us = round(self._fallen[0] - self._last_us - self._period_us)
            self.shift_us += jump_us
            self._steps.append(_Step(jump_us, self._fallen[0], stamp_us - self.shift_us, jump_us))
        elif delta_us - self._period_us > self._step_min_us:
            excess_us = round(delta_us - self._period_us)
            self._steps.append(_Step(excess_us, stamp_us, stamp_us - self.shift_us, 0))
        else:
            self._period_us += PERIOD_WEIGHT * (delta_us - self._period_us)
        self._fallen = []
        self._last_us = stamp_us
        steady_us = stamp_us - self.shift_us
        if steady_us + self._lead_us <= self._time_us:
            self._lead_us = round(self._time_us + self._period_us) - steady_us
        self._time_us = steady_us + self._lead_us
        return FrameTime(steady_us, self._time_us, jump_us)

    def stepped(self, jump_us: float, arrival_us: int) -> bool:
        """Whether the stamps step by about ``jump_us`` around an arrival, as after a clock that was set."""
        return self._step_like(jump_us, arrival_us) is not None

    def telemetry_jumped(self, jump_us: int, arrival_us: int | None = None) -> Correction | None:
        """The telemetry's arrivals jumped: take the same step of the frames' stamps out, if they made it."""
        step = self._step_like(jump_us, arrival_us)
        if step is None:
            return None
        by_us = jump_us - step.applied_us
        self.shift_us += by_us
        self._steps.remove(step)
        self._taken_out = Correction(step.stamp_us, by_us)
        return self._taken_out

    def jump_taken_back(self) -> Correction | None:
        """The clock was not set after all: the last step that was taken out is put back."""
        out, self._taken_out = self._taken_out, None
        if out is None:
            return None
        self.shift_us -= out.by_us
        return Correction(out.from_stamp_us, -out.by_us)

    def _step_like(self, jump_us: float, arrival_us: int | None) -> _Step | None:
        if self._last_us is None:
            return None
        newest_us = self._last_us - self.shift_us
        near_us = max(self._step_min_us / 2, 1.5 * self._period_us)
        for step in reversed(self._steps):
            same = abs(step.excess_us - jump_us) < near_us and newest_us - step.steady_us < STEPS_KEPT_US
            if same and (
                arrival_us is None or abs(step.stamp_us - arrival_us) < SAME_MOMENT_US + self._period_us
            ):
                return step
        return None
