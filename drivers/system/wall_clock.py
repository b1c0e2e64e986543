"""The wall clock: how far it is from the companion's clock, and whether anything speaks for its date."""

import ctypes
import os
import time
from dataclasses import dataclass
from pathlib import Path

from drivers.system import host_clock

DEVICE_TREE = Path("/sys/firmware/devicetree/base")
"""Boards have one; many of them start with the date at which they were switched off."""
HARDWARE_CLOCKS = Path("/sys/class/rtc")
TIMESYNCD = Path("/run/systemd/timesync/synchronized")
"""systemd-timesyncd touches this file when it has the time from the network."""
SET_US = 1_000_000
"""A wall clock that moved this far against the monotonic one was set by somebody."""
HARDWARE_AGREES_S = 5.0
"""A hardware clock counts whole seconds and drifts while the network's time is away."""
UNSYNCHRONISED = 0x0040
"""STA_UNSYNC of adjtimex(2)."""
TIMEX_BYTES = 512
"""More than the 208 bytes of struct timex on 64 bits."""
STATUS_OFFSET = 40
"""Of ``int status`` behind ``int modes`` and four longs."""


@dataclass(frozen=True, slots=True)
class WallClock:
    """Wall clock minus companion clock, and what speaks for its date.

    ``source``: "network", "set" (while the process ran), "hardware" (a clock with a battery), "system" (a computer
    that is no board), "simulated", or "" where nothing does.
    """

    offset_us: int
    source: str


def wall_clock() -> WallClock:
    """The wall clock now."""
    if host_clock.is_driven():
        return WallClock(0, "simulated")
    offset_us = time.time_ns() // 1000 - host_clock.now_us()
    return WallClock(offset_us, _source(offset_us))


def _source(offset_us: int) -> str:
    if time.time() < host_clock.EARLIEST_UNIX_S:
        return ""
    if TIMESYNCD.exists() or _kernel_synchronised():
        return "network"
    if host_clock.began_with_date() and not DEVICE_TREE.exists():
        return "system"
    if abs(offset_us) > SET_US:
        return "set"
    return "hardware" if _hardware_clock_agrees() else ""


def _kernel_synchronised() -> bool:
    """What adjtimex(2) says; reading needs no rights."""
    buffer = ctypes.create_string_buffer(TIMEX_BYTES)
    try:
        state = ctypes.CDLL(None, use_errno=True).adjtimex(buffer)
    except (OSError, AttributeError):
        return False
    status = int.from_bytes(buffer.raw[STATUS_OFFSET : STATUS_OFFSET + 4], "little")
    return state >= 0 and not status & UNSYNCHRONISED


def _hardware_clock_agrees() -> bool:
    """Whether a hardware clock shows the same time: one without a battery starts in 1970."""
    try:
        names = os.listdir(HARDWARE_CLOCKS)
        times = [int((HARDWARE_CLOCKS / name / "since_epoch").read_text()) for name in names]
    except (OSError, ValueError):
        return False
    return any(abs(at_s - time.time()) < HARDWARE_AGREES_S for at_s in times)
