"""The companion's clock: monotonic, set against the wall clock once; setting the wall clock moves nothing."""

import time

_WALL_MINUS_MONOTONIC_US = time.time_ns() // 1000 - time.monotonic_ns() // 1000


def now_us() -> int:
    """Microseconds since the Unix epoch as the wall clock stood when the process began; never jumps."""
    return time.monotonic_ns() // 1000 + _WALL_MINUS_MONOTONIC_US


def from_monotonic_us(monotonic_us: int) -> int:
    """A stamp of CLOCK_MONOTONIC (kernel buffers carry it) on the companion's clock."""
    return monotonic_us + _WALL_MINUS_MONOTONIC_US
