"""PX4's log (ULog) to samples: attitude, gyro and accelerometer, velocity, status, radio and TIMESYNC."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import DriverError
from drivers.files.autopilot_log import AutopilotLog, RoundTrip, log_of, with_rates
from drivers.mavlink.flight_modes import px4_mode_of_state, vehicle_type
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

TOPICS = [
    "vehicle_attitude",
    "sensor_combined",
    "vehicle_local_position",
    "vehicle_status",
    "vehicle_land_detected",
    "input_rc",
    "timesync_status",
]
ARMED = 2
"""vehicle_status.arming_state (1 is disarmed)."""
STANDBY, ACTIVE, CRITICAL = 3, 4, 5
"""Of MAV_STATE: what PX4's HEARTBEAT says of the status."""
QUADROTOR = 2
"""MAV_TYPE of logs that do not name it."""
HEARTBEAT_US = 1_000_000
REPORT_US = 500_000
MAVLINK = 1
"""timesync_status.source_protocol (0 was not known, 2 is DDS): DDS answers with another program's clock."""
CHANNELS = 18


def read_ulog(path: Path) -> AutopilotLog:
    """Read a log; DriverError if it cannot be read or lacks what a replay needs."""
    try:
        from pyulog import ULog
    except ImportError:
        raise DriverError(
            f"{path}: PX4's logs are read by pyulog, which is not installed: pip install 'landslope[logs]'"
        ) from None
    try:
        log = ULog(str(path), TOPICS, True)
    except OSError as error:
        raise DriverError(f"{path}: cannot be read ({error.strerror}); check its rights") from None
    except Exception as error:  # noqa: BLE001 - pyulog raises whatever a damaged file leads to
        raise DriverError(
            f"{path}: no ULog that can be read: {error}; copy it anew from the autopilot"
        ) from None
    samples: list[Sample] = []
    for topic, take in _TAKERS.items():
        chosen = [data for data in log.data_list if data.name == topic and data.multi_id == 0]
        for data in chosen:
            samples += take(data.data)
    sources = [list(_round_trips(data.data)) for data in log.data_list if data.name == "timesync_status"]
    return log_of(str(path), with_rates(samples), sources)


def _times(data: dict[str, Any]) -> list[int]:
    """When each was measured: by the sensor's stamp where there is one, else by the topic's."""
    stamps = data["timestamp"]
    measured = data.get("timestamp_sample")
    return [int(t) for t in (stamps if measured is None or not np.all(measured) else measured)]


def _attitudes(data: dict[str, Any]) -> Iterator[Sample]:
    for boot_us, *quaternion in zip(_times(data), *(data[f"q[{k}]"] for k in range(4)), strict=True):
        angles = euler_of(*map(float, quaternion))
        if angles is not None:
            yield Attitude(boot_us, boot_us, *angles)


def _imus(data: dict[str, Any]) -> Iterator[Sample]:
    rates = np.stack([data[f"gyro_rad[{k}]"] for k in range(3)], axis=1)
    forces = np.stack([data[f"accelerometer_m_s2[{k}]"] for k in range(3)], axis=1)
    for stamp, rate, force in zip(data["timestamp"], rates, forces, strict=True):
        if np.isfinite(rate).all():
            there = bool(np.isfinite(force).all() and force.any())
            x, y, z = map(float, force)
            yield Imu(
                int(stamp),
                int(stamp),
                (float(rate[0]), float(rate[1]), float(rate[2])),
                (x, y, z) if there else None,
                "HIGHRES_IMU",
            )


def _velocities(data: dict[str, Any]) -> Iterator[Sample]:
    """Those that the estimator calls valid, and what it says of their errors."""
    names = ("x", "y", "z", "vx", "vy", "vz")
    valid = np.asarray(data.get("v_xy_valid", True)) & np.asarray(data.get("v_z_valid", True))
    ok = np.broadcast_to(valid.astype(bool), len(data["timestamp"]))
    yield from _reports(data, ok)
    for boot_us, good, *values in zip(_times(data), ok, *(data[n] for n in names), strict=True):
        if good and np.isfinite(values).all():
            x, y, z, vx, vy, vz = map(float, values)
            yield Velocity(boot_us, boot_us, (x, y, z), (vx, vy, vz))


def _reports(data: dict[str, Any], valid: Any) -> Iterator[Sample]:
    """``evh`` and ``evv`` are standard deviations of the velocity, horizontal and vertical."""
    if "evh" not in data or "v_xy_valid" not in data:
        return
    next_us = 0
    for boot_us, good, *errors in zip(_times(data), valid, data["evh"], data["evv"], strict=True):
        if boot_us >= next_us:
            next_us = boot_us + REPORT_US
            largest = float(max(errors))
            std = largest if np.isfinite(errors).all() and largest >= 0 else None
            yield EstimatorReport(boot_us, "vehicle_local_position", bool(good), velocity_std=std)


def _heartbeats(data: dict[str, Any]) -> Iterator[Sample]:
    """One a second and one at every change, as the state was."""
    stamps = [int(t) for t in data["timestamp"]]
    kinds = data.get("system_type", np.full(len(stamps), QUADROTOR))
    failsafes = data.get("failsafe", np.zeros(len(stamps)))
    next_us = 0
    before: tuple[Any, ...] | None = None
    for k, (stamp, state, arming, kind, failsafe) in enumerate(
        zip(stamps, data["nav_state"], data["arming_state"], kinds, failsafes, strict=True)
    ):
        armed = int(arming) == ARMED
        status = CRITICAL if failsafe else ACTIVE if armed else STANDBY
        said = (armed, px4_mode_of_state(int(state)), "px4", status, vehicle_type(int(kind) or QUADROTOR))
        if said != before or stamp >= next_us:
            yield Heartbeat(stamp, *said)
            before, next_us = said, stamp + HEARTBEAT_US
        until = stamps[k + 1] if k + 1 < len(stamps) else stamp
        while next_us < until:  # the log has changes alone
            yield Heartbeat(next_us, *said)
            next_us += HEARTBEAT_US


def _landed(data: dict[str, Any]) -> Iterator[Sample]:
    for stamp, landed in zip(data["timestamp"], data["landed"], strict=True):
        yield LandedState(int(stamp), "on_ground" if landed else "in_air")


def _channels(data: dict[str, Any]) -> Iterator[Sample]:
    """What the receiver heard; nothing while it is lost, as nothing is known then."""
    lost = data.get("rc_lost", np.zeros(len(data["timestamp"])))
    values = np.stack([data[f"values[{k}]"] for k in range(CHANNELS)], axis=1)
    for stamp, gone, row, count in zip(data["timestamp"], lost, values, data["channel_count"], strict=True):
        if not gone:
            yield RcChannels(int(stamp), tuple(int(pulse) for pulse in row[: int(count)]))


def _round_trips(data: dict[str, Any]) -> Iterator[RoundTrip]:
    """PX4's ``observed_offset`` is its own time minus the companion's."""
    stamps = data["timestamp"]
    protocols = data.get("source_protocol", np.full(len(stamps), MAVLINK))
    for stamp, offset, trip, protocol in zip(
        stamps, data["observed_offset"], data["round_trip_time"], protocols, strict=True
    ):
        if protocol <= MAVLINK:
            yield RoundTrip(int(stamp), -int(offset), int(trip))


_TAKERS = {
    "vehicle_attitude": _attitudes,
    "sensor_combined": _imus,
    "vehicle_local_position": _velocities,
    "vehicle_status": _heartbeats,
    "vehicle_land_detected": _landed,
    "input_rc": _channels,
}
