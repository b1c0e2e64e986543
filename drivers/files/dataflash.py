"""ArduPilot's log (DataFlash ``.bin``) to samples: attitude, gyro and accelerometer, velocity, mode, arming, radio.

ArduPilot logs no relation of its clock to the companion's: its TSYN has a round trip's length alone.
"""

from bisect import bisect_right
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import DriverError
from drivers.files.autopilot_log import AutopilotLog, log_of, with_rates
from drivers.mavlink.flight_modes import mode_name, vehicle_type
from drivers.quaternions import euler_of
from drivers.samples import (
    Attitude,
    EstimatorReport,
    Heartbeat,
    Imu,
    LandedState,
    RcChannels,
    Sample,
    Velocity,
)

ARDUPILOT = 3
"""MAV_AUTOPILOT_ARDUPILOTMEGA."""
STANDBY, ACTIVE, CRITICAL = 3, 4, 5
"""Of MAV_STATE: what ArduCopter's HEARTBEAT says of the status."""
ARMED, AUTO_ARMED, DISARMED, LANDED, NOT_LANDED = 10, 15, 11, 18, 28
"""Of EV (LogEvent)."""
ARMING = "Arming motors"
"""MSG of a vehicle that is armed: a log that begins with the arming has no EV of it."""
RADIO = 5
FAILSAFES = (RADIO, 6, 8, 17, 20, 23, 31)
"""Of ERR (LogErrorSubsystem): radio, battery, ground station, EKF, ADSB, terrain, dead reckoning."""
ATTITUDE_GOOD, VELOCITY_GOOD, HELD = 0b1, 0b110, 0b1000_0000
"""Of XKF4.SS (nav_filter_status): attitude; horizontal and vertical velocity; a constant position is assumed."""
STATE_US = 500_000
"""From one heartbeat and landed state to the next: the log has changes alone."""
REPORT_US = 500_000
TYPES = [
    "MSG", "VER", "ATT", "IMU", "XKF1", "XKF4", "XKQ", "NKF1", "NKF4", "NKQ", "MODE", "ARM", "EV", "ERR", "RCIN"
]  # fmt: skip


def read_dataflash(path: Path) -> AutopilotLog:
    """Read a log; DriverError if it cannot be read or lacks what a replay needs."""
    from pymavlink.DFReader import DFReader_binary

    rows: dict[str, list[Any]] = {kind: [] for kind in TYPES}
    try:
        with DFReader_binary(str(path)) as log:
            while (row := log.recv_match(type=TYPES)) is not None:
                rows[row.get_type()].append(row)
            kind = int(log.mav_type)
    except OSError as error:
        raise DriverError(f"{path}: cannot be read ({error.strerror}); check its rights") from None
    except Exception as error:  # noqa: BLE001 - DFReader raises whatever a damaged file leads to
        raise DriverError(
            f"{path}: no DataFlash log that can be read: {error}; copy it anew from the autopilot"
        ) from None
    ekf = "XK" if rows["XKF1"] else "NK"
    primary = _primary(rows[ekf + "F4"])
    samples: list[Sample] = [*_attitudes(rows["ATT"], rows[ekf + "Q"], primary), *_imus(rows["IMU"])]
    states = [(_us(row), int(row.SS)) for row in _of(rows[ekf + "F4"], primary)]
    samples += _reports(states)
    samples += _velocities(rows[ekf + "F1"], primary, states)
    samples += _channels(rows["RCIN"], rows["ERR"])
    if samples:
        last_us = max(sample.arrival_us for sample in samples)
        samples += _states(rows, kind, last_us)
    return log_of(str(path), with_rates(samples))


def _us(row: Any) -> int:
    return int(row.TimeUS)


def _primary(rows: list[Any]) -> int:
    """The estimator's core that flew: the one that was primary in most rows."""
    cores = [int(row.PI) for row in rows if getattr(row, "PI", None) is not None]
    return max(set(cores), key=cores.count) if cores else 0


def _of(rows: list[Any], core: int) -> Iterator[Any]:
    return (row for row in rows if int(getattr(row, "C", core)) == core)


def _attitudes(rows: list[Any], quaternions: list[Any], core: int) -> Iterator[Sample]:
    """ATT in degrees; the estimator's own quaternions where it was not logged."""
    for row in rows:
        angles = np.radians([row.Roll, row.Pitch, (row.Yaw + 180.0) % 360.0 - 180.0])
        if np.isfinite(angles).all():
            roll, pitch, yaw = map(float, angles)
            yield Attitude(_us(row), _us(row), roll, pitch, yaw)
    for row in _of(quaternions, core) if not rows else ():
        found = euler_of(float(row.Q1), float(row.Q2), float(row.Q3), float(row.Q4))
        if found is not None:
            yield Attitude(_us(row), _us(row), *found)


def _imus(rows: list[Any]) -> Iterator[Sample]:
    """The first of the sensors, in rad/s and m/s^2."""
    first = min((int(getattr(row, "I", 0)) for row in rows), default=0)
    for row in rows:
        if int(getattr(row, "I", first)) != first:
            continue
        rate = (float(row.GyrX), float(row.GyrY), float(row.GyrZ))
        force = (float(row.AccX), float(row.AccY), float(row.AccZ))
        if np.isfinite(rate).all():
            yield Imu(_us(row), _us(row), rate, force if np.isfinite(force).all() else None, "RAW_IMU")


def _velocity_known(status: int) -> bool:
    return status & VELOCITY_GOOD == VELOCITY_GOOD and not status & HELD


def _reports(states: list[tuple[int, int]]) -> Iterator[Sample]:
    next_us = 0
    for at_us, status in states:
        if at_us >= next_us:
            next_us = at_us + REPORT_US
            yield EstimatorReport(at_us, "XKF4", _velocity_known(status), bool(status & ATTITUDE_GOOD))


def _velocities(rows: list[Any], core: int, states: list[tuple[int, int]]) -> Iterator[Sample]:
    """Those that the estimator calls good, as LOCAL_POSITION_NED is sent for those alone."""
    times = [at_us for at_us, _ in states]
    for row in _of(rows, core):
        position = (float(row.PN), float(row.PE), float(row.PD))
        velocity = (float(row.VN), float(row.VE), float(row.VD))
        k = bisect_right(times, _us(row)) - 1
        good = k < 0 or _velocity_known(states[k][1])
        if good and np.isfinite((*position, *velocity)).all():
            yield Velocity(_us(row), _us(row), position, velocity)


def _channels(rows: list[Any], errors: list[Any]) -> Iterator[Sample]:
    """What the receiver heard; nothing while the radio's failsafe lasts, as the pulses are held then."""
    changes = [(_us(row), int(row.ECode) != 0) for row in errors if int(row.Subsys) == RADIO]
    for row in rows:
        lost = [gone for at_us, gone in changes if at_us <= _us(row)]
        if not (lost and lost[-1]):
            names = [f"C{n}" for n in range(1, 15)]
            yield RcChannels(_us(row), tuple(int(getattr(row, name, 0)) for name in names))


def _states(rows: dict[str, list[Any]], kind: int, last_us: int) -> Iterator[Sample]:
    """Heartbeats and landed states: at every change, and twice a second as the state was.

    Nothing before the first MODE row: the mode is not known there. Without a row the vehicle is taken to be disarmed,
    and its landed state is not known.
    """
    changes: list[tuple[int, str, Any]] = [(_us(row), "mode", int(row.ModeNum)) for row in rows["MODE"]]
    changes += [(_us(row), "armed", bool(row.ArmState)) for row in rows["ARM"]]
    changes += [(_us(row), "armed", True) for row in rows["MSG"] if str(row.Message).startswith(ARMING)]
    for row in rows["EV"]:
        event = int(row.Id)
        if event in (ARMED, AUTO_ARMED, DISARMED):
            changes.append((_us(row), "armed", event != DISARMED))
        elif event in (LANDED, NOT_LANDED):
            changes.append((_us(row), "landed", "on_ground" if event == LANDED else "in_air"))
    for row in rows["ERR"]:
        if int(row.Subsys) in FAILSAFES:
            changes.append((_us(row), f"failsafe {row.Subsys}", int(row.ECode) != 0))
    changes.sort(key=lambda change: change[0])
    now: dict[str, Any] = {}
    for k, (at_us, what, value) in enumerate(changes):
        now[what] = value
        until_us = changes[k + 1][0] if k + 1 < len(changes) else max(last_us, at_us + 1)
        yield from _said(now, kind, range(at_us, until_us, STATE_US))


def _said(now: dict[str, Any], kind: int, times: range) -> Iterator[Sample]:
    failsafe = any(value for what, value in now.items() if what.startswith("failsafe"))
    armed = now.get("armed", False)
    status = CRITICAL if failsafe else ACTIVE if armed else STANDBY
    for at_us in times:
        if "mode" in now:
            mode = mode_name(ARDUPILOT, kind, now["mode"])
            yield Heartbeat(at_us, armed, mode, "ardupilot", status, vehicle_type(kind))
        if "landed" in now:
            yield LandedState(at_us, now["landed"])
