"""The simulated autopilot against real peers: MAVSDK, MAVProxy and a station over UDP."""

import json
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from places import TOOLS
from ports import free_udp_port
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from simulated_autopilot_support import Station

from drivers.errors import DriverError
from drivers.simulated.vehicle.autopilot import LinkFaults, SimulatedAutopilot
from drivers.simulated.vehicle.sensors import SensorErrors
from drivers.simulated.vehicle.vehicle import Multirotor, Wind

LAND = mavlink.MAV_CMD_NAV_LAND


def test_mavsdk_takes_off_goes_and_lands() -> None:
    port = free_udp_port()
    with SimulatedAutopilot(
        f"udpout:127.0.0.1:{port}", Multirotor(wind=Wind(2, 1, 0.5)), speed=3
    ) as autopilot:
        script = subprocess.run(
            [sys.executable, TOOLS / "mavsdk_flight.py", f"udpin://127.0.0.1:{port}"],
            capture_output=True,
            text=True,
            timeout=3600,
        )
    assert script.returncode == 0, script.stderr
    said: dict[str, float] = {}
    for line in script.stdout.splitlines():
        if line.startswith("{"):
            said.update(json.loads(line))
    assert said["north_m"] == pytest.approx(12, abs=0.8)
    assert said["yaw_deg"] == pytest.approx(90, abs=3)
    assert said["landed_height_m"] == pytest.approx(0, abs=0.05)
    # it was not standing still yet: LAND goes on to the stopping point
    assert autopilot.vehicle.position[0] == pytest.approx(12, abs=2.5)
    assert autopilot.vehicle.on_ground
    assert not autopilot.controller.armed
    assert len(autopilot.vehicle.touch_downs) == 1
    assert "MAV_CMD_NAV_LAND" in [c.name for c in autopilot.commands]


def test_mavproxy_connects_and_arms(tmp_path: Path) -> None:
    script = Path(sys.executable).with_name("mavproxy.py")
    program = str(script) if script.exists() else shutil.which("mavproxy.py")
    if program is None:
        pytest.skip("mavproxy.py is missing: pip install --no-deps MAVProxy")
    with SimulatedAutopilot("tcp:127.0.0.1:0") as autopilot:
        proxy = subprocess.Popen(
            [
                sys.executable,
                program,
                f"--master=tcp:127.0.0.1:{autopilot.port}",
                "--non-interactive",
                "--default-modules=arm,link",
                f"--state-basedir={tmp_path}",
                "--cmd=arm throttle",
            ],
            cwd=tmp_path,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        end = time.monotonic() + 120
        while not autopilot.controller.armed and time.monotonic() < end:
            time.sleep(0.05)
        proxy.terminate()
        output = proxy.communicate(timeout=600)[0]
    assert autopilot.controller.armed, output
    arming = [c for c in autopilot.commands if c.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM]
    assert arming
    assert arming[0].source_system == 255


@pytest.mark.parametrize(
    ("answer", "results", "lands"),
    [
        ("normal", [0], True),
        ("accepted", [0], False),
        ("denied", [2], False),
        ("temporarily_rejected", [1], False),
        ("unsupported", [3], False),
        ("failed", [4], False),
        ("in_progress_then_accepted", [5, 0], True),
        ("in_progress_then_silence", [5], False),
        ("no_answer", [], False),
        ("answer_lost", [], True),
    ],
)
def test_answers_to_land(
    station: Callable[..., Station], answer: str, results: list[int], lands: bool
) -> None:
    s = station()
    s.autopilot.set_answer(LAND, answer)  # type: ignore[arg-type]
    s.command(LAND)
    s.run(1.0)
    assert [m.result for m in s.all("COMMAND_ACK")] == results
    assert (s.autopilot.controller.mode == "LAND") is lands
    assert [c.command for c in s.autopilot.commands] == [LAND]
    if lands:
        s.run(9.0)
        assert s.autopilot.vehicle.on_ground
        assert not s.autopilot.controller.armed
        assert [m.landed_state for m in s.all("EXTENDED_SYS_STATE")][-1] == 1


def test_an_unknown_way_to_answer_is_refused(station: Callable[..., Station]) -> None:
    with pytest.raises(DriverError, match="perhaps"):
        station().autopilot.set_answer(LAND, "perhaps")  # type: ignore[arg-type]


def test_commands_to_others_are_not_taken(station: Callable[..., Station]) -> None:
    s = station()
    s.send(mavlink.MAVLink_command_long_message(2, 1, LAND, 0, 0, 0, 0, 0, 0, 0, 0))
    s.send(mavlink.MAVLink_command_long_message(1, 154, LAND, 0, 0, 0, 0, 0, 0, 0, 0))
    s.run(0.5)
    assert not s.autopilot.commands
    assert not s.all("COMMAND_ACK")


def test_message_interval_sets_the_rate(station: Callable[..., Station]) -> None:
    s = station()
    s.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_ATTITUDE, 10_000)
    s.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_RAW_IMU, -1)
    s.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 11030, 10_000)
    s.run(0.1)
    assert sorted(m.result for m in s.all("COMMAND_ACK")) == [0, 0, 4]
    s.messages.clear()
    s.run(2.0)
    assert len(s.all("ATTITUDE")) == pytest.approx(200, abs=2)
    assert not s.all("RAW_IMU")


def test_guided_velocity_ends_by_itself(station: Callable[..., Station]) -> None:
    s = station()
    velocity = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, mavlink.MAV_FRAME_LOCAL_NED, 0b110111000111, 0, 0, 0, 1.5, 0, 0, 0, 0, 0, 0, 0
    )
    s.send(velocity)
    s.run(2.5)
    assert s.autopilot.vehicle.velocity[0] == pytest.approx(1.5, abs=0.1)
    s.run(6)
    assert abs(s.autopilot.vehicle.velocity[0]) < 0.1
    assert s.autopilot.vehicle.position[2] == pytest.approx(-3, abs=0.1)


def test_timesync_and_boot_time_agree_with_telemetry(station: Callable[..., Station]) -> None:
    s = station(since_boot_s=100.0)
    s.send(mavlink.MAVLink_timesync_message(0, 123456789))
    s.run(0.3)
    answer = s.all("TIMESYNC")[0]
    assert answer.ts1 == 123456789
    assert answer.tc1 == pytest.approx(100.06e9, abs=0.02e9)
    assert s.all("ATTITUDE")[-1].time_boot_ms == pytest.approx(100_300, abs=110)


def test_boot_milliseconds_wrap(station: Callable[..., Station]) -> None:
    s = station(since_boot_s=2**32 / 1000 - 1.0)
    s.run(3.0)
    stamps = [m.time_boot_ms for m in s.all("ATTITUDE")]
    assert max(stamps) > 2**32 - 300
    assert stamps[-1] < 2200


def test_reboot_goes_dark_and_counts_from_zero(station: Callable[..., Station]) -> None:
    s = station()
    s.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_ATTITUDE, 10_000)
    s.run(1.0)
    s.autopilot.reboot(down_s=1.5)
    s.messages.clear()
    s.command(LAND)
    s.run(3.5)
    assert s.times("ATTITUDE")[0] > 2.5
    stamps = [m.time_boot_ms for m in s.all("ATTITUDE")]
    assert stamps[0] < 20
    assert len(stamps) == pytest.approx(20, abs=2)  # 10 Hz again
    assert not s.autopilot.commands[1:]
    assert s.autopilot.controller.mode == "GUIDED"


def test_link_delays_within_bounds_in_order_and_loses_its_share(station: Callable[..., Station]) -> None:
    s = station(link=LinkFaults(delay_s=(0.001, 0.009), loss=0.2))
    s.autopilot.streams.set_rate(mavlink.MAVLINK_MSG_ID_ATTITUDE, 100)
    s.run(10.0, step_s=0.0025)
    late = [t - (m.time_boot_ms / 1e3 - 30) for t, m in s.messages if m.get_type() == "ATTITUDE"]
    assert min(late) >= 0.0
    assert max(late) <= 0.0135
    assert max(late) - min(late) > 0.005
    stamps = [m.time_boot_ms for m in s.all("ATTITUDE")]
    assert stamps == sorted(stamps)
    assert 700 < len(stamps) < 880
    s.autopilot.link.silent = True
    s.messages.clear()
    s.run(1.0)
    assert not s.messages[5:]  # what was under way may still arrive


def test_the_same_seed_gives_the_same_bytes(station: Callable[..., Station]) -> None:
    def flight() -> list[bytes]:
        errors = SensorErrors(0.01, 0.01, 0.01, velocity_noise=0.05)
        s = station(errors=errors, link=LinkFaults((0.001, 0.009), 0.1), seed=5)
        s.run(3.0)
        return [bytes(m.get_msgbuf()) for _, m in s.messages]

    assert flight() == flight()


def test_takeoff_needs_arming_and_guided(station: Callable[..., Station]) -> None:
    s = station(airborne=False)
    for _ in range(2):
        s.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 3)
        s.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4)
        s.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        s.run(0.1)
    assert [m.result for m in s.all("COMMAND_ACK")] == [4, 0, 0, 0, 0, 0]
    s.run(6)
    assert s.autopilot.vehicle.height_above_ground == pytest.approx(3.12, abs=0.3)
    s.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)
    s.run(0.1)
    assert s.all("COMMAND_ACK")[-1].result == 4  # not in the air


def test_parameters_and_an_empty_mission(station: Callable[..., Station]) -> None:
    s = station()
    s.send(mavlink.MAVLink_param_request_list_message(1, 1))
    s.send(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    s.send(mavlink.MAVLink_param_set_message(1, 1, b"LAND_SPEED", 30.0, 9))
    s.run(0.3)
    assert len({m.param_id for m in s.all("PARAM_VALUE")}) == len(
        s.autopilot.controller.parameters.names(px4=False)
    )
    assert s.all("MISSION_COUNT")[0].count == 0
    assert s.autopilot.protocol.parameters["LAND_SPEED"] == 30


@pytest.mark.parametrize(
    "connection", ["serial:/dev/ttyS0", "udpin:127.0.0.1", "udpin::14550", "tcp:h:99999"]
)
def test_a_wrong_connection_is_refused(connection: str) -> None:
    with pytest.raises(DriverError, match="udpout:HOST:PORT"):
        SimulatedAutopilot(connection)
