"""The companion's clock: monotonic, set against the wall clock once; setting the wall clock moves nothing."""

import time

_WALL_MINUS_MONOTONIC_US = time.time_ns() // 1000 - time.monotonic_ns() // 1000
_speed = 1.0
_origin_us = 0


def now_us() -> int:
    """Microseconds since the Unix epoch as the wall clock stood when the process began; never jumps."""
    real_us = time.monotonic_ns() // 1000 + _WALL_MINUS_MONOTONIC_US
    return real_us if _speed == 1.0 else _origin_us + round((real_us - _origin_us) * _speed)


def run_at(speed: float) -> None:
    """Let the companion's clock run ``speed`` times as fast from now on: for simulations only, in a process of its own.

    Going back to 1 lets it fall back to the true time.
    """
    global _speed, _origin_us
    _origin_us = time.monotonic_ns() // 1000 + _WALL_MINUS_MONOTONIC_US
    _speed = speed


def from_monotonic_us(monotonic_us: int) -> int:
    """A stamp of CLOCK_MONOTONIC (kernel buffers carry it) on the companion's clock."""
    return monotonic_us + _WALL_MINUS_MONOTONIC_US
