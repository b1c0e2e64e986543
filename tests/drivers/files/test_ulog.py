"""PX4's log in a flight folder: read as telemetry, in the companion's time by its round trips."""

import math
import struct
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import DriverError
from drivers.files.autopilot_log import LogInTime
from drivers.files.flight_folder import by_round_trips, log_in
from drivers.files.ulog import read_ulog
from drivers.samples import Attitude, ClockOffset, Heartbeat, Imu, Velocity

OFFSET_US = 1_700_000_000_000_000
FORMATS = {
    "vehicle_attitude": "uint64_t timestamp;uint64_t timestamp_sample;float[4] q;",
    "sensor_combined": "uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;",
    "vehicle_local_position": "uint64_t timestamp;float x;float y;float z;float vx;float vy;float vz;"
    "bool v_xy_valid;bool v_z_valid;",
    "vehicle_status": "uint64_t timestamp;uint8_t arming_state;uint8_t nav_state;uint8_t system_type;bool failsafe;",
    "timesync_status": "uint64_t timestamp;int64_t observed_offset;uint32_t round_trip_time;"
    "uint8_t source_protocol;",
}


def _message(kind: str, payload: bytes) -> bytes:
    return struct.pack("<HB", len(payload), ord(kind)) + payload


def _log(path: Path, rows: list[tuple[str, bytes]]) -> Path:
    """A ULog file of rows (topic, packed data)."""
    data = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1)
    names = list(FORMATS)
    data += b"".join(_message("F", f"{name}:{fields}".encode()) for name, fields in FORMATS.items())
    data += b"".join(_message("A", struct.pack("<BH", 0, k) + n.encode()) for k, n in enumerate(names))
    data += b"".join(_message("D", struct.pack("<H", names.index(name)) + row) for name, row in rows)
    path.write_bytes(data)
    return path


def _rows(seconds: int = 5, timesync: bool = True) -> list[tuple[str, bytes]]:
    half = math.radians(10) / 2
    rows = []
    for ms in range(1000, 1000 + 1000 * seconds, 20):
        us = ms * 1000
        # the estimator publishes 3 ms after the sample
        rows.append(
            ("vehicle_attitude", struct.pack("<QQ4f", us + 3000, us, math.cos(half), math.sin(half), 0, 0))
        )
        rows.append(("sensor_combined", struct.pack("<Q6f", us, 0.1, -0.2, 0.3, 0, 0, -9.8)))
        valid = ms < 3000
        rows.append(("vehicle_local_position", struct.pack("<Q6f??", us, 1, 2, -3, 0.5, 0, 0, valid, True)))
        if ms % 1000 == 0 and timesync:
            late_us = 40_000 if ms == 3000 else 0  # one round trip is held up on one way
            trip = struct.pack("<QqIB", us, -OFFSET_US - late_us // 2, 800 + late_us, 1)
            rows.append(("timesync_status", trip))
    rows.append(("vehicle_status", struct.pack("<QBBB?", 1_000_000, 1, 2, 2, False)))
    rows.append(("vehicle_status", struct.pack("<QBBB?", 3_500_000, 2, 18, 2, True)))
    return rows


def _folder(path: Path, timesync: bool = True, start_us: int = OFFSET_US + 1_500_000) -> Path:
    path.mkdir(exist_ok=True)
    _log(path / "vehicle.ulg", _rows(timesync=timesync))
    lines = ["frame,host_time_us", *(f"{k},{start_us + 50_000 * k}" for k in range(40))]
    (path / "frames.csv").write_text("\n".join(lines))
    return path


def _in_time(folder: Path) -> LogInTime | None:
    log = log_in(folder)
    assert log is not None
    return by_round_trips(log, folder)


def test_a_log_is_read_as_samples(tmp_path):
    log = read_ulog(_log(tmp_path / "vehicle.ulg", _rows()))
    first = log.attitudes[0]
    assert first.boot_us == 1_000_000  # the sensor's moment, not the publication's
    assert math.degrees(first.roll) == pytest.approx(10, abs=1e-4)
    assert (first.rollspeed, first.pitchspeed) == pytest.approx((0.1, -0.2))
    imu = next(s for s in log.recorded if isinstance(s, Imu))
    assert imu.rate == pytest.approx((0.1, -0.2, 0.3))
    assert imu.force == pytest.approx((0, 0, -9.8))
    beats = [s for s in log.recorded if isinstance(s, Heartbeat)]
    assert [(b.armed, b.mode, b.system_status) for b in (beats[0], beats[-1])] == [
        (False, "POSCTL", 3),
        (True, "LAND", 5),
    ]
    assert all(np.diff([b.arrival_us for b in beats]) <= 1_000_000)


def test_a_velocity_that_the_estimator_does_not_call_valid_is_no_velocity(tmp_path):
    log = read_ulog(_log(tmp_path / "vehicle.ulg", _rows()))
    velocities = [s for s in log.recorded if isinstance(s, Velocity)]
    assert velocities
    assert max(v.boot_us for v in velocities) < 3_000_000


def test_round_trips_give_the_companions_time_and_a_held_up_one_moves_nothing(tmp_path):
    log = _in_time(_folder(tmp_path))
    assert log is not None
    samples = list(log.samples())
    attitudes = [s for s in samples if isinstance(s, Attitude)]
    assert {s.arrival_us - s.boot_us for s in attitudes} == {OFFSET_US}
    offsets = [s for s in samples if isinstance(s, ClockOffset)]
    assert [(s.offset_us, s.round_trip_us) for s in offsets[:2]] == [(OFFSET_US, 800)] * 2
    assert offsets[2].round_trip_us == 40_800
    arrivals = [s.arrival_us for s in samples]
    assert arrivals == sorted(arrivals)
    assert log.survey().attitude_hz == pytest.approx(50)


@pytest.mark.parametrize("edit", [{"timesync": False}, {"start_us": OFFSET_US + 3_600_000_000}])
def test_round_trips_with_another_clock_or_none_are_not_taken(tmp_path, edit):
    assert _in_time(_folder(tmp_path, **edit)) is None


def test_a_tlog_goes_before_the_log(tmp_path):
    folder = _folder(tmp_path)
    (folder / "vehicle.tlog").write_bytes(b"")
    assert log_in(folder) is None


def test_what_is_no_log_is_reported_in_one_line(tmp_path):
    (tmp_path / "vehicle.ulg").write_bytes(b"nothing of the kind" * 10)
    with pytest.raises(DriverError, match=r"no ULog that can be read|no attitude"):
        read_ulog(tmp_path / "vehicle.ulg")
