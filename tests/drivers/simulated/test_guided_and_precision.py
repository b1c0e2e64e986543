"""What the simulated autopilots make of setpoints, of their end, and of LANDING_TARGET."""

import struct
from collections.abc import Callable

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from simulated_autopilot_support import Station

from drivers.simulated.vehicle.firmware import Firmware


def px4(s: Station, mode: str, **parameters: float) -> Station:
    """The station's autopilot as PX4, in a flight mode."""
    c = s.autopilot.controller
    c.firmware = Firmware("px4")
    c.mode = mode
    c.parameters.values.update(parameters)
    return s


def velocity(north: float) -> object:
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, mavlink.MAV_FRAME_LOCAL_NED, 0b100111000111, 0, 0, 0, north, 0, 0, 0, 0, 0, 0, 0
    )


def test_px4_takes_offboard_only_while_setpoints_come(station: Callable[..., Station]) -> None:
    s = px4(station(), "BRAKE")
    s.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6, 0)
    s.run(0.1)
    assert [m.result for m in s.all("COMMAND_ACK")] == [mavlink.MAV_RESULT_TEMPORARILY_REJECTED]
    s.send(velocity(0.0))
    s.run(0.1)
    s.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6, 0)
    s.run(0.1)
    assert s.all("COMMAND_ACK")[-1].result == mavlink.MAV_RESULT_ACCEPTED
    assert s.autopilot.controller.mode == "GUIDED"


@pytest.mark.parametrize(
    ("act", "mode"), [(0, "LOITER"), (1, "ALT_HOLD"), (3, "RTL"), (4, "LAND"), (5, "BRAKE")]
)
def test_px4_without_setpoints_does_what_com_obl_rc_act_says(station, act: int, mode: str) -> None:
    s = px4(station(), "BRAKE", COM_OBL_RC_ACT=act, COM_OF_LOSS_T=0.5)
    for _ in range(20):
        s.send(velocity(0.5))
        s.run(0.05)
        s.autopilot.controller.set_mode("GUIDED")
    assert s.autopilot.vehicle.velocity[0] > 0.3
    s.run(0.4)
    assert s.autopilot.controller.mode == "GUIDED"
    s.run(0.3)
    assert s.autopilot.controller.mode == mode
    assert s.all("HEARTBEAT")[-1].system_status != mavlink.MAV_STATE_CRITICAL
    s.run(1.1)
    assert s.all("HEARTBEAT")[-1].system_status == mavlink.MAV_STATE_CRITICAL


def test_px4s_modes_of_the_sticks_are_refused_without_sticks(station: Callable[..., Station]) -> None:
    s = px4(station(), "BRAKE")
    s.autopilot.controller.firmware.radio = "lost"
    assert not s.autopilot.set_mode("LOITER")
    assert s.autopilot.set_mode("RTL")


def test_ardupilot_tells_a_change_of_mode_at_once(station: Callable[..., Station]) -> None:
    s = station()
    s.run(0.3)
    s.messages.clear()
    s.autopilot.set_mode("LOITER")
    s.run(0.05)
    assert [m.custom_mode for m in s.all("HEARTBEAT")] == [5]


def target(x: float, y: float, z: float, frame: int) -> object:
    distance = (x * x + y * y + z * z) ** 0.5
    return mavlink.MAVLink_landing_target_message(
        0, 0, frame, 0, 0, distance, 0, 0, x, y, z, (1, 0, 0, 0), 2, 1
    )


def test_ardupilot_uses_a_target_after_two_seconds_and_loses_it_after_two(
    station: Callable[..., Station],
) -> None:
    s = station()
    s.autopilot.controller.parameters.values.update(PLND_ENABLED=1, PLND_TYPE=1)
    s.send(target(1, 0, 3, mavlink.MAV_FRAME_LOCAL_NED))
    for _ in range(50):
        v = s.autopilot.vehicle.position
        s.send(target(1.0 - v[0], -v[1], -v[2], mavlink.MAV_FRAME_BODY_FRD))
        s.run(0.05)
    s.run(2.2)
    s.autopilot.set_mode("LAND")
    s.run(0.3)
    texts = [m.text for m in s.all("STATUSTEXT")]
    assert texts[0].startswith("Plnd: Frame not supported")
    assert [t for t in texts if "PrecLand" in t] == [
        "PrecLand: Target Found",
        "PrecLand: Init Complete",
        "PrecLand: Target Lost",
        "PrecLand: Failsafe Measures",
    ]


def test_px4_without_a_target_climbs_to_look_for_it(station: Callable[..., Station]) -> None:
    s = px4(station(), "LOITER")
    assert s.autopilot.set_mode("PRECLAND")
    s.run(8.0)
    assert s.autopilot.vehicle.height_above_ground > 8.0, "above SEARCH_ALT's way"


def test_px4_sends_an_integers_bytes_as_a_float(station: Callable[..., Station]) -> None:
    s = px4(station(), "LOITER", COM_OBL_RC_ACT=5)
    s.send(mavlink.MAVLink_param_request_read_message(1, 1, b"COM_OBL_RC_ACT", -1))
    s.send(mavlink.MAVLink_param_request_read_message(1, 1, b"GUID_TIMEOUT", -1))
    s.run(0.1)
    (value,) = s.all("PARAM_VALUE")
    assert struct.unpack("<i", struct.pack("<f", value.param_value)) == (5,)
    assert value.param_type == mavlink.MAV_PARAM_TYPE_INT32
