"""MAVLink messages to samples: units, refusals, the choice among sources, modes by name."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.current_mode import CurrentModeMessage
from drivers.mavlink.flight_modes import mode_name
from drivers.mavlink.telemetry import MESSAGE_IDS, TelemetryDecoder
from drivers.samples import (
    Attitude,
    ClockOffset,
    CommandAnswer,
    CurrentMode,
    Heartbeat,
    Imu,
    LandedState,
    RcChannels,
    Refusal,
    Velocity,
)

M = mavlink


def received(message, system=1, component=1):
    """The message as a receiver decodes it."""
    return M.MAVLink(None).decode(bytearray(message.pack(M.MAVLink(None, system, component))))


def decode(decoder, message, arrival_us=10_000_000, system=1, component=1):
    return decoder.decode(received(message, system, component), arrival_us)


def attitude(ms=1000, roll=0.1):
    return M.MAVLink_attitude_message(ms, roll, -0.2, 0.3, 0.01, 0.02, 0.03)


def quaternion(ms=1000):
    # roll 0.1, pitch -0.2, yaw 0.3
    cr, sr, cp, sp = math.cos(0.05), math.sin(0.05), math.cos(-0.1), math.sin(-0.1)
    cy, sy = math.cos(0.15), math.sin(0.15)
    w = cr * cp * cy + sr * sp * sy
    x = sr * cp * cy - cr * sp * sy
    y = cr * sp * cy + sr * cp * sy
    z = cr * cp * sy - sr * sp * cy
    return M.MAVLink_attitude_quaternion_message(ms, w, x, y, z, 0.01, 0.02, 0.03)


def raw_imu(us=1_000_000):
    return M.MAVLink_raw_imu_message(us, 0, 0, 0, 100, -200, 300, 0, 0, 0)


def scaled_imu(ms=1000):
    return M.MAVLink_scaled_imu_message(ms, 0, 0, 0, 100, -200, 300, 0, 0, 0)


def highres_imu(us=1_000_000, x=0.1):
    return M.MAVLink_highres_imu_message(us, 0, 0, 0, x, -0.2, 0.3, 0, 0, 0, 0, 0, 0, 0, 63)


def heartbeat(autopilot=M.MAV_AUTOPILOT_ARDUPILOTMEGA, mode=4, base=0x81, kind=2):
    return M.MAVLink_heartbeat_message(kind, autopilot, base, mode, 4, 3)


def test_attitude_carries_the_middle_of_its_millisecond():
    (sample,) = decode(TelemetryDecoder(), attitude(ms=1234))
    assert isinstance(sample, Attitude)
    assert (sample.arrival_us, sample.boot_us) == (10_000_000, 1_234_500)
    assert (sample.roll, sample.pitch, sample.yaw) == pytest.approx((0.1, -0.2, 0.3))
    assert (sample.rollspeed, sample.pitchspeed, sample.yawspeed) == pytest.approx((0.01, 0.02, 0.03))


def test_quaternions_stand_in_only_where_no_attitude_comes():
    decoder = TelemetryDecoder()
    assert decode(decoder, quaternion(1000)) == []
    assert decode(decoder, quaternion(2900)) == []
    (sample,) = decode(decoder, quaternion(3100))
    assert (sample.roll, sample.pitch, sample.yaw) == pytest.approx((0.1, -0.2, 0.3))
    assert len(decode(decoder, attitude(3200))) == 1
    assert decode(decoder, quaternion(3300)) == []
    assert len(decode(decoder, quaternion(5300))) == 1, "ATTITUDE stopped"


@pytest.mark.parametrize("message", [raw_imu(), scaled_imu(), highres_imu()])
def test_every_gyro_gives_radians_per_second(message):
    (sample,) = decode(TelemetryDecoder(), message)
    assert isinstance(sample, Imu)
    assert sample.rate == pytest.approx((0.1, -0.2, 0.3))
    assert sample.source == message.get_type()
    assert sample.boot_us == (1_000_500 if sample.source == "SCALED_IMU" else 1_000_000)


@pytest.mark.parametrize(
    ("message", "down"),
    [
        (M.MAVLink_raw_imu_message(1000, 20, -10, -1000, 0, 0, 0, 0, 0, 0), -9.80665),
        (M.MAVLink_scaled_imu_message(1, 20, -10, -1000, 0, 0, 0, 0, 0, 0), -9.80665),
        (M.MAVLink_highres_imu_message(1000, 0.196, -0.098, -9.8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 7), -9.8),
    ],
)
def test_every_accelerometer_gives_metres_per_second_squared(message, down):
    (sample,) = decode(TelemetryDecoder(), message)
    assert sample.force == pytest.approx((0.196, -0.098, down), abs=2e-4)


@pytest.mark.parametrize("force", [(0.0, 0.0, 0.0), (0.0, math.nan, -9.8)])
def test_a_gyro_without_an_accelerometer_is_one(force):
    message = M.MAVLink_highres_imu_message(1000, *force, 0.1, -0.2, 0.3, 0, 0, 0, 0, 0, 0, 0, 0x38)
    (sample,) = decode(TelemetryDecoder(), message)
    assert sample.rate == pytest.approx((0.1, -0.2, 0.3))
    assert sample.force is None


def test_the_best_gyro_is_kept_and_a_lesser_one_steps_in_when_it_stops():
    decoder = TelemetryDecoder()
    assert len(decode(decoder, scaled_imu(1000))) == 1
    assert len(decode(decoder, raw_imu(1_010_000))) == 1
    assert decode(decoder, scaled_imu(1020)) == []
    assert len(decode(decoder, highres_imu(1_030_000))) == 1
    assert decode(decoder, raw_imu(1_040_000)) == []
    assert decoder.gyro_source == "HIGHRES_IMU"
    assert len(decode(decoder, raw_imu(2_100_000))) == 1


def test_raw_imu_of_other_autopilots_has_no_unit():
    decoder = TelemetryDecoder()
    decode(decoder, heartbeat(M.MAV_AUTOPILOT_PX4))
    assert decode(decoder, raw_imu()) == []


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    ("make", "field"),
    [
        (attitude, "roll"),
        (attitude, "yawspeed"),
        (highres_imu, "zgyro"),
        (lambda: M.MAVLink_local_position_ned_message(1000, 1, 2, 3, 4, 5, 6), "vz"),
    ],
)
def test_numbers_that_are_none_are_refused(make, field, value):
    message = make()
    setattr(message, field, value)
    (sample,) = decode(TelemetryDecoder(), message)
    assert sample == Refusal(10_000_000, message.get_type(), "not_finite")


def test_quaternion_that_is_no_rotation_is_refused():
    decoder = TelemetryDecoder()
    message = quaternion(1000)
    decode(decoder, message)
    bad = M.MAVLink_attitude_quaternion_message(4000, 0.1, 0, 0, 0, 0, 0, 0)
    assert decode(decoder, bad)[0].reason == "not_a_rotation"


def test_other_systems_and_components_are_refused_by_name():
    named = TelemetryDecoder(system_id=1)
    assert decode(named, attitude(), system=2)[0].reason == "foreign_system"
    assert decode(named, attitude(), component=154)[0].reason == "foreign_component"
    assert decode(named, heartbeat(), system=2)[0].reason == "foreign_system"
    first_come = TelemetryDecoder()
    assert isinstance(decode(first_come, attitude(), system=5)[0], Attitude)
    assert decode(first_come, attitude(), system=6)[0].reason == "second_vehicle"
    assert first_come.system_id == 5
    assert first_come.vehicles == {5, 6}


def test_a_component_that_speaks_first_does_not_become_the_vehicle():
    decoder = TelemetryDecoder()
    assert decode(decoder, attitude(), system=9, component=154)[0].reason == "foreign_system"
    assert isinstance(decode(decoder, attitude(), system=1)[0], Attitude)


def test_heartbeats_of_ground_stations_are_nothing_to_report():
    station = M.MAVLink_heartbeat_message(M.MAV_TYPE_GCS, M.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
    assert decode(TelemetryDecoder(), station, system=255, component=190) == []


def test_heartbeat_tells_mode_and_arming():
    (sample,) = decode(TelemetryDecoder(), heartbeat())
    assert sample == Heartbeat(10_000_000, True, "GUIDED", "ardupilot", 4)
    (sample,) = decode(TelemetryDecoder(), heartbeat(base=0x01))
    assert not sample.armed


@pytest.mark.parametrize(
    ("autopilot", "kind", "custom", "name"),
    [
        (3, 2, 9, "LAND"),
        (3, 2, 5, "LOITER"),
        (3, 13, 16, "POSHOLD"),
        (3, 1, 20, "QLAND"),
        (3, 2, 200, "MODE 200"),
        (12, 2, 4 << 16 | 6 << 24, "LAND"),
        (12, 2, 4 << 16 | 3 << 24, "HOLD"),
        (12, 2, 4 << 16 | 4 << 24, "MISSION"),
        (12, 2, 6 << 16, "OFFBOARD"),
        (12, 2, 3 << 16, "POSCTL"),
        (0, 2, 3, "MODE 3"),
    ],
)
def test_modes_by_name(autopilot, kind, custom, name):
    assert mode_name(autopilot, kind, custom) == name


def test_velocity_landed_state_and_radio():
    decoder = TelemetryDecoder()
    (velocity,) = decode(decoder, M.MAVLink_local_position_ned_message(1000, 1, 2, 3, 4, 5, 6))
    assert velocity == Velocity(10_000_000, 1_000_500, (1, 2, 3), (4, 5, 6))
    (landed,) = decode(decoder, M.MAVLink_extended_sys_state_message(0, 2))
    assert landed == LandedState(10_000_000, "in_air")
    channels = [1500, 1000, 65535, *[65535] * 15]
    (radio,) = decode(decoder, M.MAVLink_rc_channels_message(1000, 3, *channels, 200))
    assert radio == RcChannels(10_000_000, (1500, 1000, 0))


def test_timesync_answers_give_the_offset_and_requests_do_not():
    decoder = TelemetryDecoder()
    answer = M.MAVLink_timesync_message(5_000_000_000, 9_990_000_000)
    (sample,) = decode(decoder, answer)
    assert sample == ClockOffset(10_000_000, 5_000_000, 9_995_000 - 5_000_000, 10_000)
    assert decode(decoder, M.MAVLink_timesync_message(0, 9_990_000_000)) == []
    assert decode(decoder, M.MAVLink_timesync_message(5_000_000_000, 1_000)) == []


def test_answers_to_our_commands():
    decoder = TelemetryDecoder()
    ack = M.MAVLink_command_ack_message(21, M.MAV_RESULT_TEMPORARILY_REJECTED, 0, 0, 1, 191)
    assert decode(decoder, ack) == [CommandAnswer(10_000_000, 21, "TEMPORARILY_REJECTED")]
    others = M.MAVLink_command_ack_message(21, 0, 0, 0, 255, 190)
    assert decode(decoder, others) == []


def test_all_messages_that_samples_are_made_of_are_wanted():
    assert {0, 27, 30, 31, 32, 65, 77, 105, 111, 245} <= MESSAGE_IDS


def test_current_mode_is_decoded_though_the_dialect_lacks_it() -> None:
    codec = mavlink.MAVLink(None, 1, 1)
    decoder = TelemetryDecoder()
    beat = mavlink.MAVLink_heartbeat_message(2, mavlink.MAV_AUTOPILOT_PX4, 0, 3 << 16, 4, 3)
    for message in (beat, CurrentModeMessage(0, 4 << 16 | 3 << 24, 3 << 16)):
        (sent,) = mavlink.MAVLink(None).parse_buffer(message.pack(codec))
        samples = decoder.decode(sent, 7)
    assert samples == [CurrentMode(7, "HOLD", "POSCTL")]


@pytest.mark.parametrize(
    ("fields", "distance_m", "std_m"),
    [
        ({}, 3.21, None),
        ({"covariance": 25}, 3.21, 0.05),
        ({"covariance": 255}, 3.21, None),
        ({"current_distance": 10}, None, None),
        ({"current_distance": 4000}, None, None),
        ({"current_distance": 65535}, None, None),
        ({"current_distance": 0}, None, None),
        ({"signal_quality": 1}, None, None),
        ({"signal_quality": 100}, 3.21, None),
        ({"max_distance": 5}, None, None),
    ],
)
def test_a_rangefinder_measures_within_its_own_limits(fields, distance_m, std_m):
    of = {"current_distance": 321, "orientation": 25, "covariance": 0, "max_distance": 4000} | fields
    message = M.MAVLink_distance_sensor_message(
        1000, 10, of["max_distance"], of["current_distance"], 0, 1, of["orientation"], of["covariance"],
        signal_quality=of.get("signal_quality", 0),
    )  # fmt: skip
    (found,) = decode(TelemetryDecoder(), message)
    assert found.distance_m == (None if distance_m is None else pytest.approx(distance_m))
    assert found.std_m == (None if std_m is None else pytest.approx(std_m))
    assert (found.boot_us, found.min_m, found.max_m) == (1_000_500, 0.1, of["max_distance"] / 100)


@pytest.mark.parametrize("orientation", [0, 24, 26, 100])
def test_a_rangefinder_that_looks_elsewhere_is_none(orientation):
    message = M.MAVLink_distance_sensor_message(1000, 10, 4000, 321, 0, 1, orientation, 0)
    assert decode(TelemetryDecoder(), message) == []
