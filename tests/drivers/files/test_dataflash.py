"""ArduPilot's log read as samples: attitude, gyro, velocity, mode, arming, failsafe, landed state and radio."""

import math
from itertools import pairwise
from pathlib import Path

import pytest
from dataflash_support import GOOD, HELD, Row, write_log

from drivers.errors import DriverError
from drivers.files.dataflash import read_dataflash
from drivers.samples import Attitude, EstimatorReport, Heartbeat, Imu, LandedState, RcChannels, Velocity

GUIDED, LAND = 4, 9


def _rows() -> list[Row]:
    rows: list[Row] = [
        ("VER", (1_000_000, 2, 4, 2, 7, 0, 0)),
        ("MODE", (1_000_000, GUIDED, GUIDED, 2)),
        ("MSG", (1_000_000, b"Arming motors")),
        ("EV", (1_500_000, 28)),
        ("MODE", (3_000_000, LAND, LAND, 2)),
        ("ERR", (3_200_000, 5, 1)),
        ("ERR", (4_200_000, 5, 0)),
        ("EV", (5_000_000, 18)),
        ("EV", (5_500_000, 11)),
    ]
    for us in range(1_000_000, 6_000_000, 20_000):
        rows.append(("ATT", (us, 0, 10.0, 0, -5.0, 0, 350.0)))
        rows.append(("IMU", (us, 0, 0.1, -0.2, 0.3, 0, 0, -9.8)))
        rows.append(("IMU", (us, 1, 9, 9, 9, 9, 9, 9)))
        for core in (0, 1):
            rows.append(("XKF1", (us, core, 0, 0, 0, 0.5 + core, 0, 0.1, 1, 2, -3)))
            rows.append(("XKF4", (us, core, GOOD if us < 3_000_000 else HELD, 1)))
        if us % 100_000 == 0:
            rows.append(("RCIN", (us, *[1500] * 7, 2000, *[0] * 6)))
            rows.append(("TSYN", (us, 1, 900)))
    return sorted(rows, key=lambda row: row[1][0])


@pytest.fixture
def recorded(tmp_path: Path) -> tuple[object, ...]:
    return read_dataflash(write_log(tmp_path / "vehicle.bin", _rows())).recorded


def test_attitude_and_gyro_are_in_radians_and_of_the_first_sensor(recorded):
    first = next(s for s in recorded if isinstance(s, Attitude))
    assert [math.degrees(a) for a in (first.roll, first.pitch, first.yaw)] == pytest.approx(
        (10, -5, -10), abs=1e-4
    )
    assert (first.boot_us, first.rollspeed, first.pitchspeed) == pytest.approx((1_000_000, 0.1, -0.2))
    imus = [s for s in recorded if isinstance(s, Imu)]
    assert len(imus) == 250
    assert imus[0].rate == pytest.approx((0.1, -0.2, 0.3))
    assert imus[0].force == pytest.approx((0, 0, -9.8))


def test_velocities_are_the_primary_cores_and_end_where_it_holds_a_position(recorded):
    velocities = [s for s in recorded if isinstance(s, Velocity)]
    assert {v.velocity_ned[:2] for v in velocities} == {(1.5, 0.0)}
    assert max(v.boot_us for v in velocities) < 3_000_000
    reports = [s for s in recorded if isinstance(s, EstimatorReport)]
    assert [(r.velocity_known, r.attitude_known) for r in (reports[0], reports[-1])] == [
        (True, True),
        (False, True),
    ]


def test_mode_arming_failsafe_and_landing_come_at_every_change_and_twice_a_second(recorded):
    beats = [s for s in recorded if isinstance(s, Heartbeat)]
    assert {(b.autopilot, b.vehicle_type) for b in beats} == {("ardupilot", "quadrotor")}
    story = [(b.arrival_us, b.armed, b.mode, b.system_status) for b in beats]
    changes = [
        now
        for before, now in zip([None, *story[:-1]], story, strict=True)
        if before is None or before[1:] != now[1:]
    ]
    assert changes == [
        (1_000_000, True, "GUIDED", 4),
        (3_000_000, True, "LAND", 4),
        (3_200_000, True, "LAND", 5),
        (4_200_000, True, "LAND", 4),
        (5_500_000, False, "LAND", 3),
    ]
    assert max(b[0] - a[0] for a, b in pairwise(story)) <= 500_000
    landed = [(s.arrival_us, s.state) for s in recorded if isinstance(s, LandedState)]
    assert (landed[0], landed[-1][1]) == ((1_500_000, "in_air"), "on_ground")
    assert {at_us for at_us, state in landed if state == "on_ground"} >= {5_000_000}


def test_pulses_that_are_held_in_a_radio_failsafe_are_not_taken(recorded):
    times = [s.arrival_us for s in recorded if isinstance(s, RcChannels)]
    assert not [t for t in times if 3_200_000 <= t < 4_200_000]
    assert len(times) == 40


@pytest.mark.parametrize("content", [b"", b"nothing of the kind" * 100, bytes(5000)])
def test_what_is_no_log_is_reported_in_one_line(tmp_path, content):
    path = tmp_path / "vehicle.bin"
    path.write_bytes(content)
    with pytest.raises(DriverError, match=r"no DataFlash log that can be read|no attitude"):
        read_dataflash(path)
