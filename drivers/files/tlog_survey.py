"""A first look over a whole tlog, by headers and boot times: which vehicles speak, and where the clock was set."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.files.tlog import bytes_of, decode_record, records
from drivers.mavlink.telemetry import MESSAGE_IDS

_BOOT_TIMED = {30, 31, 32}
"""ATTITUDE, ATTITUDE_QUATERNION, LOCAL_POSITION_NED: time_boot_ms is the first field on the wire."""

_ATTITUDES = {30, 31}

STEP_US = 500_000
"""A smaller step of the recording clock is left to the relation of the clocks: it cannot disturb the order."""

WITNESS = 50
"""Messages on either side of a step that must agree on it; a stalled link catches up, a clock does not."""


@dataclass(frozen=True, slots=True)
class ClockStep:
    """The recording clock was set by ``size_us`` between two stamps of the tlog."""

    before_us: int
    after_us: int
    size_us: int


@dataclass(frozen=True, slots=True)
class Survey:
    """``vehicles``: system ids of the autopilots; ``first_us``, ``last_us``: first and last stamp (0: none)."""

    vehicles: tuple[int, ...]
    steps: tuple[ClockStep, ...]
    first_us: int
    last_us: int
    attitude_hz: float = 0.0
    """Median rate of the first vehicle's attitudes by their boot times; 0: fewer than three."""


def survey_tlog(path: Path, component_id: int = 1) -> Survey:
    """Look over a tlog; DriverError if it cannot be read."""
    data = bytes_of(path)
    vehicles: dict[int, bool] = {}
    times: dict[int, list[tuple[int, int]]] = {}
    attitudes: dict[int, list[int]] = {}
    first_us = last_us = 0
    for record in records(data):
        if record.message_id not in MESSAGE_IDS:
            continue
        first_us, last_us = first_us or record.stamp_us, record.stamp_us
        if record.component != component_id:
            continue
        if not vehicles.get(record.system):
            vehicles[record.system] = decode_record(data, record) is not None
        if record.message_id in _BOOT_TIMED:
            boot_ms = int.from_bytes(data[record.payload : record.payload + 4], "little")
            times.setdefault(record.system, []).append((record.stamp_us, boot_ms * 1000))
            if record.message_id in _ATTITUDES:
                attitudes.setdefault(record.system, []).append(boot_ms)
    heard = tuple(sorted(system for system, intact in vehicles.items() if intact))
    steps = _steps(np.array(times[heard[0]], np.int64)) if heard and heard[0] in times else ()
    rate_hz = _rate_hz(attitudes.get(heard[0], [])) if heard else 0.0
    return Survey(heard, steps, first_us, last_us, rate_hz)


def _rate_hz(boots_ms: list[int]) -> float:
    """Median rate of messages by their boot times; both kinds of attitude often share one moment."""
    intervals = np.diff(np.unique(np.array(boots_ms, np.int64)))
    return 1000.0 / float(np.median(intervals)) if len(intervals) > 1 else 0.0


def _steps(times: np.ndarray) -> tuple[ClockStep, ...]:
    """Where stamps (n, 2: stamp, boot time, both in microseconds) step while the boot time runs on."""
    stamps, boots = times[:, 0], times[:, 1]
    delay = stamps - boots
    candidates = np.flatnonzero((np.abs(np.diff(delay)) > STEP_US) & (np.diff(boots) >= 0)) + 1
    found = []
    for k in candidates:
        size = int(delay[k : k + WITNESS].min() - delay[max(0, k - WITNESS) : k].min())
        if abs(size) > STEP_US:
            found.append(ClockStep(int(stamps[k - 1]), int(stamps[k]), size))
    return tuple(found)
