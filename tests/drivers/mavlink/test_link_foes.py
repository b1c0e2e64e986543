"""Foes on the link: floods of foreign frames, replayed signed frames, programs that speak in our name."""

import json
import socket
import time

import pytest
from ports import free_udp_port
from pymavlink.dialects.v20 import ardupilotmega as dialect
from vehicle_support import PATIENCE_S, LinkBench, TestVehicle, attitude, link_bench, wait_for

from companion.errors import LandslopeError
from companion.settings.link_options import link_options
from companion.settings.settings import Settings
from companion.settings.settings_file import load
from drivers.errors import DriverError
from drivers.mavlink.framing import FrameSplitter, WireFrame
from drivers.mavlink.ports import is_local, parse_port
from drivers.mavlink.sender_splitters import MOST_SENDERS, SenderSplitters
from drivers.mavlink.signing import MAX_AGE, Signer, read_key
from drivers.mavlink.signing_memory import SigningMemory

bench = link_bench
KEY = bytes(range(32))
MINUTE = MAX_AGE


def wire(boot_ms: int = 1, system: int = 1, component: int = 1) -> bytes:
    return bytes(attitude(boot_ms).pack(dialect.MAVLink(None, system, component)))


def frame_of(data: bytes) -> WireFrame:
    (frame,) = FrameSplitter().feed(data)
    assert isinstance(frame, WireFrame)
    return frame


class Clock:
    def __init__(self, now: int = 10**12) -> None:
        self.now = now

    def __call__(self) -> int:
        return self.now


def test_a_recorded_frame_of_another_link_id_is_refused_while_the_true_stream_runs():
    clock = Clock()
    vehicle, other_link, ours = (Signer(KEY, link, clock) for link in (1, 2, 0))
    recorded = other_link.sign(wire())
    clock.now += MINUTE // 60  # a second later, within the minute that a new stream may lag
    assert ours.refusal(frame_of(vehicle.sign(wire()))) is None
    assert ours.refusal(frame_of(recorded)) == "replayed"
    clock.now += 1000
    assert ours.refusal(frame_of(other_link.sign(wire()))) is None, "a second link that lives is taken"
    assert ours.refusal(frame_of(vehicle.sign(wire()))) is None


def test_another_sender_that_was_never_heard_may_lag_a_minute():
    clock = Clock()
    station, ours = Signer(KEY, 1, clock), Signer(KEY, 0, clock)
    late, later = station.sign(wire(system=255)), station.sign(wire(system=254))
    clock.now += MINUTE // 2
    assert Signer(KEY, 0, clock).refusal(frame_of(late)) is None
    clock.now += MINUTE
    ours = Signer(KEY, 0, clock)
    assert ours.refusal(frame_of(later)) == "replayed"


def test_after_a_restart_without_a_clock_old_frames_stay_refused(tmp_path):
    clock, memory = Clock(), SigningMemory(tmp_path / "state" / "signing.json")
    vehicle = Signer(KEY, 1, clock)
    before = Signer(KEY, 0, clock, memory)
    old = vehicle.sign(wire())
    clock.now += 24 * 60 * MINUTE
    newest = vehicle.sign(wire())
    assert before.refusal(frame_of(newest)) is None
    before.save()
    after = Signer(KEY, 0, Clock(0), SigningMemory(tmp_path / "state" / "signing.json"))
    assert after.refusal(frame_of(old)) == "replayed"
    assert after.refusal(frame_of(newest)) == "replayed"
    assert after.refusal(frame_of(vehicle.sign(wire()))) is None
    sent = frame_of(after.sign(wire(component=191)))
    assert Signer(KEY, 3, clock).refusal(sent) is None, "our own frames carry the time that was kept"
    forgetful = Signer(KEY, 0, Clock(0))
    assert forgetful.refusal(frame_of(old)) is None, "which this test is about"


@pytest.mark.parametrize(
    "content",
    ["", "[]", '{"time": "x", "streams": []}', '{"time": 1, "streams": [[1]]}', "[" * 50_000, "\udcff"],
)
def test_a_broken_file_of_the_time_is_no_end(tmp_path, content):
    path = tmp_path / "signing.json"
    path.write_text(content, errors="surrogateescape")
    signer = Signer(KEY, 0, Clock(), SigningMemory(path))
    assert signer.refusal(frame_of(Signer(KEY, 1, Clock()).sign(wire()))) is None
    signer.save()
    assert json.loads(path.read_text())["streams"] == [[1, 1, 1, 10**12 + 1]]


def test_a_place_that_cannot_be_written_costs_the_memory_alone(tmp_path, caplog):
    (tmp_path / "state").write_text("a file")
    signer = Signer(KEY, 0, Clock(), SigningMemory(tmp_path / "state" / "signing.json"))
    for _ in range(3):
        signer.sign(wire())
        signer.save()
    assert len([r for r in caplog.records if "restart" in r.message]) == 1


def test_a_running_link_keeps_its_time_on_disk(bench, tmp_path):
    path = tmp_path / "signing.json"
    b: LinkBench = bench(signing_key=KEY, signing_memory=path)
    with TestVehicle(b.port, seal=Signer(KEY, link_id=3).sign):
        wait_for(b.link.vehicle_found.is_set, "vehicle")
    b.link.close()
    kept = json.loads(path.read_text())
    assert [3, 1, 1] in [stream[:3] for stream in kept["streams"]]


def test_a_key_is_a_key_and_a_file_is_a_file_and_the_log_says_which(tmp_path, caplog):
    caplog.set_level("INFO")
    assert read_key(KEY.hex()) == KEY
    assert "is the value of mavlink.signing_key" in caplog.messages[-1]
    path = tmp_path / "key"
    path.write_bytes(KEY)
    assert read_key(str(path)) == KEY
    assert str(path) in caplog.messages[-1]
    assert KEY.hex() not in caplog.text
    settings = load(None, [f"mavlink.signing_key={KEY.hex()}"]).settings
    assert settings.mavlink.signing_key == KEY.hex()
    assert link_options(settings, "udpin:127.0.0.1:1").signing_key == KEY
    with pytest.raises(DriverError) as refusal:
        read_key(KEY.hex() + "00")
    assert KEY.hex() not in str(refusal.value)


@pytest.mark.parametrize(
    ("endpoint", "local"),
    [
        ("udpin:127.0.0.1:14560", True),
        ("udpout:127.0.0.1:14560", True),
        ("udpout:localhost:14560", True),
        ("tcp:::1:5760", True),
        ("/dev/ttyUSB0:57600", True),
        ("udpin:0.0.0.0:14560", False),
        ("udpin::::14560", False),
        ("udpout:192.168.1.20:14550", False),
        ("tcp:ground.station:5760", False),
    ],
)
def test_forward_endpoints_that_others_reach_are_refused_unless_allowed(endpoint, local):
    assert is_local(parse_port(endpoint)) is local
    settings = load(None, [f'mavlink.forward=["{endpoint}"]']).settings
    if local:
        assert link_options(settings, "udpin:127.0.0.1:1").forward == (endpoint,)
    else:
        with pytest.raises(LandslopeError, match="forward_open = true"):
            link_options(settings, "udpin:127.0.0.1:1")
    allowed = load(None, [f'mavlink.forward=["{endpoint}"]', "mavlink.forward_open=true"]).settings
    assert link_options(allowed, "udpin:127.0.0.1:1").forward == (endpoint,)
    assert not Settings().mavlink.forward_open


def test_a_forwarded_program_cannot_speak_in_our_name(bench):
    port = free_udp_port()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", port))
        station.settimeout(PATIENCE_S)
        b: LinkBench = bench(forward=(f"udpout:127.0.0.1:{port}",))
        with TestVehicle(b.port) as vehicle:
            wait_for(b.link.vehicle_found.is_set, "vehicle")
            _, peer = station.recvfrom(65536)
            land = dialect.MAVLink_command_long_message(1, 1, 21, 0, 0, 0, 0, 0, 0, 0, 0)
            posed = bytes(land.pack(dialect.MAVLink(None, 1, 191)))
            honest = bytes(land.pack(dialect.MAVLink(None, 255, 190)))
            station.sendto(posed + honest, peer)
            wait_for(lambda: honest in list(vehicle.received_raw), "honest frame")
            assert posed not in list(vehicle.received_raw)
            assert b.link.counters["refused: our_name"] == 1


def test_frames_are_recorded_only_after_their_sender_was_checked(bench):
    b: LinkBench = bench(system_id=1)
    recorded: list[bytes] = []
    b.link.on_frame = lambda arrival_us, frame: recorded.append(frame)
    with TestVehicle(b.port) as vehicle, TestVehicle(b.port, system=7) as foreign:
        wait_for(b.link.vehicle_found.is_set, "vehicle")
        for i in range(500):
            foreign.send(attitude(i))
        gimbal = bytes(attitude(9).pack(dialect.MAVLink(None, 1, 154)))
        vehicle.send_bytes(gimbal)
        vehicle.send(attitude(77))
        # both again and again: of a burst a busy machine loses some
        wait_for(lambda: gimbal in recorded or vehicle.send_bytes(gimbal), "frame of the vehicle's gimbal")
        refused = lambda: b.link.counters["refused: foreign_system"] >= 400  # noqa: E731
        wait_for(lambda: refused() or foreign.send(attitude(501)), "refusals")
    came = [f for f in map(frame_of, recorded) if f.component in (1, 154)]
    assert {f.system for f in came} == {1}


def test_a_flood_of_addresses_takes_no_memory_and_cuts_no_frame_of_the_vehicle(bench):
    b: LinkBench = bench(system_id=1)
    with TestVehicle(b.port) as vehicle:
        wait_for(b.link.vehicle_found.is_set, "vehicle")
        mav = dialect.MAVLink(None, 1, 1)
        mav.seq = 100
        for i in range(200):
            frame = bytes(attitude(i).pack(mav))
            mav.seq = (mav.seq + 1) % 256
            vehicle.send_bytes(frame[:11])
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
                stranger.sendto(b"\xfd\x09\x00", ("127.0.0.1", b.port))
            vehicle.send_bytes(frame[11:])
            time.sleep(0.001)
        assert len(b.link._splitters) <= MOST_SENDERS
        assert len(b.link._port._port._peers) <= MOST_SENDERS


def test_the_splitter_to_keep_outlives_any_number_of_others():
    splitters = SenderSplitters()
    keep = ("10.0.0.1", 14550)
    mine = splitters.of(keep)
    for port in range(64_000):
        splitters.of(("10.0.0.2", port), keep=keep)
    assert len(splitters) == MOST_SENDERS
    assert splitters.of(keep) is mine
