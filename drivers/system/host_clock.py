"""The companion's clock: monotonic, set against the wall clock once; setting the wall clock moves nothing."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

EARLIEST_UNIX_S = 1_767_225_600
"""1 January 2026, UTC: before the first version; no clock that shows an earlier date was ever set."""


def _base_us() -> int:
    """Wall minus monotonic clock; a board that wakes in 1970 counts from ``EARLIEST_UNIX_S``, so that its recordings
    carry stamps that readers take for stamps."""
    wall_us = max(time.time_ns() // 1000, EARLIEST_UNIX_S * 1_000_000)
    return wall_us - time.monotonic_ns() // 1000


_WALL_MINUS_MONOTONIC_US = _base_us()
_BEGAN_WITH_DATE = time.time() >= EARLIEST_UNIX_S
_drivers: list[Callable[[], int]] = []


def now_us() -> int:
    """Microseconds since the Unix epoch as the wall clock stood when the process began; never jumps."""
    if _drivers:
        return _drivers[-1]()
    return time.monotonic_ns() // 1000 + _WALL_MINUS_MONOTONIC_US


def began_with_date() -> bool:
    """Whether the wall clock could be right when the process began."""
    return _BEGAN_WITH_DATE


def is_driven() -> bool:
    """Whether a simulation's clock is the companion's."""
    return bool(_drivers)


@contextmanager
def driven(clock_us: Callable[[], int]) -> Iterator[None]:
    """Let ``clock_us`` be the companion's clock for a while: for simulations, whose time is their own.

    A reading that falls back is held at the newest one.
    """
    lock = threading.Lock()
    newest = 0

    def steady() -> int:
        nonlocal newest
        with lock:
            newest = max(newest, clock_us())
            return newest

    _drivers.append(steady)
    try:
        yield
    finally:
        _drivers.remove(steady)


def from_monotonic_us(monotonic_us: int) -> int:
    """A stamp of CLOCK_MONOTONIC (kernel buffers carry it) on the companion's clock."""
    return monotonic_us + _WALL_MINUS_MONOTONIC_US
