"""ArduPilot's JSON interface against a peer that speaks its packets exactly."""

import json
import math
import socket
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st
from ports import free_udp_port
from sitl_support import FakeSitl, servo_packet

from companion.simulation.flight_result import in_words
from companion.simulation.scenario import parse_scenario
from companion.simulation.simulation import ArduPilot, LiveOptions, fly_live
from drivers.errors import DriverError
from drivers.samples import GRAVITY
from drivers.simulated.vehicle.ardupilot_json import JsonBackend, parse_servos
from drivers.simulated.vehicle.rotors import QuadX
from drivers.simulated.vehicle.vehicle import Multirotor


@pytest.fixture
def backend() -> Iterator[JsonBackend]:
    """A backend on a free port, with a vehicle that stands on level ground."""
    backend = JsonBackend(Multirotor(), port=0)
    backend.start()
    yield backend
    backend.stop()


@pytest.fixture
def sitl() -> Iterator[socket.socket]:
    """The socket of a SITL."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sitl:
        sitl.settimeout(2)
        yield sitl


def exchange(sitl: socket.socket, backend: JsonBackend, packet: bytes) -> dict:
    """Send a packet, read the line of JSON that answers it."""
    sitl.sendto(packet, ("127.0.0.1", backend.port))
    data = sitl.recv(4096)
    assert data.startswith(b"\n")
    assert data.endswith(b"}\n")
    assert b" " not in data, "ArduCopter's parser refuses spaces"
    assert data.count(b"\n") == 2
    return json.loads(data)


def test_a_packet_is_read_as_documented() -> None:
    data = bytes.fromhex("1a48900139300000") + b"".join((1000 + i).to_bytes(2, "little") for i in range(16))
    data = (18458).to_bytes(2, "little") + data[2:]
    packet = parse_servos(data)
    assert (packet.rate_hz, packet.count) == (400, 12345)
    assert packet.pulses_us == tuple(range(1000, 1016))


@given(st.binary(max_size=80))
def test_no_bytes_are_taken_for_a_packet_unless_they_are_one(data: bytes) -> None:
    whole = len(data) == 40 and data[:2] == (18458).to_bytes(2, "little")
    whole |= len(data) == 72 and data[:2] == (29569).to_bytes(2, "little")
    try:
        packet = parse_servos(data)
    except DriverError:
        assert not whole or not 50 <= int.from_bytes(data[2:4], "little") <= 4000
    else:
        assert whole
        assert len(packet.pulses_us) == (len(data) - 8) // 2


def test_physics_moves_by_one_frame_a_packet(backend: JsonBackend, sitl: socket.socket) -> None:
    states = [exchange(sitl, backend, servo_packet(k, [1000] * 4, rate_hz=800)) for k in range(1, 9)]
    assert [s["timestamp"] for s in states] == pytest.approx([k / 800 for k in range(1, 9)])
    last = states[-1]
    assert set(last) >= {"timestamp", "imu", "position", "attitude", "velocity"}
    assert last["imu"]["accel_body"] == pytest.approx([0, 0, -GRAVITY])
    assert last["position"] == pytest.approx([0, 0, -0.12])
    assert last["rng_1"] == pytest.approx(0.12)


def test_a_packet_sent_again_gets_the_same_answer(backend: JsonBackend, sitl: socket.socket) -> None:
    first = exchange(sitl, backend, servo_packet(1, [1900] * 4))
    again = exchange(sitl, backend, servo_packet(1, [1900] * 4))
    following = exchange(sitl, backend, servo_packet(2, [1900] * 4))
    assert again == first
    assert following["timestamp"] > first["timestamp"]
    assert backend.repeated == 1


def test_garbage_is_refused_and_a_restarted_sitl_goes_on(backend: JsonBackend, sitl: socket.socket) -> None:
    exchange(sitl, backend, servo_packet(500, [1000] * 4))
    for junk in (
        b"",
        b"hello",
        servo_packet(501, [1000] * 4, magic=1),
        servo_packet(501, [1000] * 4, rate_hz=3),
    ):
        sitl.sendto(junk, ("127.0.0.1", backend.port))
    state = exchange(sitl, backend, servo_packet(1, [1000] * 4))
    assert state["timestamp"] == pytest.approx(2 / 200)
    assert (backend.refused, backend.restarts) == (4, 1)
    assert "3 Hz" in backend.problem


def test_motors_turn_the_vehicle_as_arducopters_do() -> None:
    frame = QuadX()
    hover = frame.pulse(frame.hover_share)
    level = frame.command([hover] * 4)
    assert level.thrust == pytest.approx(GRAVITY)
    assert level.spin == pytest.approx((0, 0, 0))
    more, less = hover + 50, hover - 50
    # Motors 1 front right, 2 rear left, 3 front left, 4 rear right.
    assert frame.command([less, more, more, less]).spin[0] > 1  # left side up: roll to the right
    assert frame.command([more, less, more, less]).spin[1] > 1  # front up: pitch up
    assert (
        frame.command([more, more, less, less]).spin[2] > 0.5
    )  # counterclockwise rotors turn the nose right


@given(st.floats(0, 1))
def test_the_thrust_curve_has_its_inverse(share: float) -> None:
    frame = QuadX()
    command = frame.command([frame.pulse(share)] * 4)
    assert command.thrust == pytest.approx(share * GRAVITY / frame.hover_share, abs=1e-6)


def test_a_taken_port_is_an_error(backend: JsonBackend) -> None:
    with pytest.raises(DriverError, match="another physics backend"):
        JsonBackend(Multirotor(), port=backend.port)


LEVEL = """
duration_s = 40
[camera]
width_px = 160
height_px = 120
rate_hz = 15
[start]
take_off_m = 2.0
[[surface]]
kind = "level"
material = "gravel"
[[leg]]
seconds = 10
forward_m_s = 0.8
[[leg]]
seconds = 60
forward_m_s = 0.15
[expect]
landing = "requested"
"""


@pytest.mark.slow
def test_closed_loop_on_the_physics_of_a_sitl() -> None:
    """Takeoff, flight, request and landing, with an autopilot that has nothing but JSON physics and MAVLink."""
    scenario = parse_scenario("level", LEVEL, "level.toml")
    port = free_udp_port()
    with FakeSitl(port) as sitl:
        options = LiveOptions(autopilot=ArduPilot(sitl.connection, sitl.connection, port))
        result = fly_live(scenario, options=options)
    assert result.deviations(scenario.expect) == [], in_words(result)
    assert result.touch_down is not None, in_words(result)
    assert len(result.requests) == 1
    # MAVSDK sends a command again whose answer is late
    assert "MAV_CMD_NAV_LAND" in [c.name for c in sitl.autopilot.commands]
    assert math.hypot(*result.touch_down.velocity) < 1.0
