"""The MAVLink link over real sockets: whom it believes, what it asks for, what it lets out."""

import socket
import threading
import time

import pytest
from ports import free_udp_port
from pymavlink.dialects.v20 import ardupilotmega as dialect
from vehicle_support import PATIENCE_S, TestVehicle, attitude, link_bench, wait_for

from drivers.errors import DriverError
from drivers.events import DriverEvent
from drivers.mavlink.framing import FrameSplitter, WireFrame
from drivers.mavlink.link import Link, LinkOptions
from drivers.mavlink.signing import Signer, read_key
from drivers.samples import Attitude, ClockOffset, Heartbeat, Refusal, Sample

bench = link_bench


def test_garbage_is_counted_and_costs_no_message(bench) -> None:
    b = bench()
    with TestVehicle(b.port) as vehicle:
        wait_for(b.link.vehicle_found.is_set, "vehicle")
        vehicle.send_bytes(bytes(range(200, 250)) + b"\xfd\xff\x00")
        for i in range(200):
            vehicle.send(attitude(i * 10))
            time.sleep(0.001)
        wait_for(lambda: len(b.of(Attitude)) == 200, "attitudes")
        assert b.link.counters["garbage bytes"] == 53
        assert b.refusals("garbage") or b.refusals("bad_checksum")


def test_a_stream_that_a_bridge_cuts_into_datagrams_loses_no_frame(bench) -> None:
    """Serial bridges send what came so far: frames begin in one datagram and end in another."""
    b = bench()
    with TestVehicle(b.port) as vehicle:
        wait_for(b.link.vehicle_found.is_set, "vehicle")
        codec, refused_before = dialect.MAVLink(None, 1, 1), len(b.of(Refusal))
        with vehicle._lock:  # its heartbeats go on behind these frames, in the same series of numbers
            stream = b""
            for i in range(240):
                codec.seq = vehicle._sequence = (vehicle._sequence + 1) % 256
                stream += bytes(attitude(i * 10).pack(codec))
            vehicle._sequence = (vehicle._sequence + 1) % 256
            for at in range(0, len(stream), 53):
                vehicle.send_bytes(stream[at : at + 53])
                time.sleep(0.001)
        wait_for(lambda: len(b.of(Attitude)) == 240, "attitudes")
        assert [a.boot_us // 1000 for a in b.of(Attitude)] == [i * 10 for i in range(240)]
        assert b.link.counters["garbage bytes"] == 0
        assert len(b.of(Refusal)) == refused_before


def test_a_wrong_checksum_is_refused(bench) -> None:
    b = bench()
    with TestVehicle(b.port) as vehicle:
        wait_for(b.link.vehicle_found.is_set, "vehicle")
        good = bytes(attitude(5).pack(dialect.MAVLink(None, 1, 1)))
        vehicle.send_bytes(good[:-1] + bytes((good[-1] ^ 1,)))
        wait_for(lambda: b.refusals("bad_checksum"), "refusal")
        assert not b.of(Attitude)


def test_second_sender_with_the_vehicles_ids_is_refused_and_reported_once(bench) -> None:
    b = bench()
    with TestVehicle(b.port) as vehicle:
        wait_for(b.link.vehicle_found.is_set, "vehicle")
        with TestVehicle(b.port) as impostor:
            for i in range(20):
                vehicle.send(attitude(i * 10))
                impostor.send(attitude(i * 10, roll=1.0))
                time.sleep(0.01)
            wait_for(lambda: len(b.of(Attitude)) == 20, "attitudes")
        assert all(a.roll == 0 for a in b.of(Attitude))
        wait_for(lambda: len(b.refusals("second_sender")) >= 20, "refusals")
        assert b.event_names().count("mavlink_refused") == 1


def test_a_second_line_of_sequence_numbers_on_one_wire_is_refused(bench) -> None:
    b = bench()
    with TestVehicle(b.port) as vehicle:
        wait_for(b.link.vehicle_found.is_set, "vehicle")
        forger = dialect.MAVLink(None, 1, 1)
        forger.seq = 200
        for i in range(20):
            vehicle.send(attitude(i * 10))
            vehicle.send_bytes(bytes(attitude(i * 10, roll=1.0).pack(forger)))
            forger.seq = (forger.seq + 1) % 256
        wait_for(lambda: len(b.of(Attitude)) == 20, "attitudes")
        # the last forged one comes after the last true one
        wait_for(lambda: len(b.refusals("sequence")) >= 20, "refusals")
        assert all(a.roll == 0 for a in b.of(Attitude))
        assert len(b.of(Attitude)) == len(b.refusals("sequence")) == 20


def test_vehicle_that_moves_to_another_port_is_taken_after_silence(bench) -> None:
    b = bench()
    with TestVehicle(b.port):
        wait_for(b.link.vehicle_found.is_set, "vehicle")
    with TestVehicle(b.port):
        count = len(b.of(Heartbeat))
        wait_for(lambda: len(b.of(Heartbeat)) > count, "heartbeat from the new address")
        assert b.refusals("second_sender")


def test_two_vehicles_without_a_system_id_are_ambiguous(bench) -> None:
    b = bench(system_id=0)
    with TestVehicle(b.port, system=3):
        wait_for(b.link.vehicle_found.is_set, "vehicle")
        assert b.link.system_id == 3
        assert not b.link.ambiguous
        with TestVehicle(b.port, system=4):
            wait_for(lambda: b.link.ambiguous, "ambiguity")
        assert any("set vehicle.system_id" in e.text for e in b.events)


def test_foreign_vehicle_is_refused_and_counted(bench) -> None:
    b = bench(system_id=1)
    with TestVehicle(b.port, system=1), TestVehicle(b.port, system=7) as foreign:
        wait_for(b.link.vehicle_found.is_set, "vehicle")
        foreign.send(attitude(10))
        wait_for(lambda: b.refusals("foreign_system"), "refusal")
        assert not b.link.ambiguous
        assert not b.of(Attitude)


def test_telemetry_before_the_first_heartbeat_is_counted_and_nobodys_fault(bench) -> None:
    b = bench(system_id=0)
    vehicle = TestVehicle(b.port)
    vehicle.autopilot = dialect.MAV_AUTOPILOT_INVALID
    with vehicle:
        wait_for(lambda: b.link.is_open, "open port")
        vehicle.send(attitude(10))
        wait_for(lambda: b.link.counters["frames before a heartbeat"], "count")
        assert not b.of(Attitude)
        vehicle.autopilot = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
        wait_for(b.link.vehicle_found.is_set, "vehicle")
        vehicle.send(attitude(20))
        wait_for(lambda: b.of(Attitude), "attitude")
        assert not b.of(Refusal)
        assert "mavlink_refused" not in b.event_names()


def test_rates_are_asked_for_and_asked_again_after_a_reboot(bench) -> None:
    b = bench(rates_hz={"ATTITUDE": 50.0, "IMU": 50.0})
    with TestVehicle(b.port) as vehicle:

        def asked() -> list[int]:
            return [int(c.param1) for _, c in list(vehicle.commands) if c.command == 511]

        wait_for(lambda: {30, 27} <= set(asked()), "request for ATTITUDE and RAW_IMU")
        assert 105 not in asked()  # HIGHRES_IMU is PX4's
        for i in range(5):
            vehicle.send(attitude(600_000 + i))
        before = len(asked())
        vehicle.send(attitude(100))
        wait_for(lambda: b.link.counters["reboots"] == 1, "reboot")
        wait_for(lambda: len(asked()) >= before + 2, "second request")


def test_px4_is_asked_for_its_own_gyro_message(bench) -> None:
    b = bench(rates_hz={"IMU": 50.0})
    vehicle = TestVehicle(b.port)
    vehicle.autopilot = dialect.MAV_AUTOPILOT_PX4
    with vehicle:
        wait_for(lambda: vehicle.commands, "request")
        assert {int(c.param1) for _, c in vehicle.commands if c.command == 511} == {105}


def test_a_rate_that_does_not_come_is_reported(bench) -> None:
    b = bench(rates_hz={"ATTITUDE": 50.0})
    with TestVehicle(b.port) as vehicle:
        wait_for(lambda: vehicle.commands, "request")
        vehicle.send(attitude(600_000))  # one that never comes is missing, not slow
        wait_for(lambda: "rate_too_low" in b.event_names(), "event")


def test_timesync_trips_become_offsets_and_those_of_others_do_not(bench) -> None:
    b = bench()
    with TestVehicle(b.port) as vehicle:
        wait_for(lambda: len(b.of(ClockOffset)) >= 3, "offsets")
        from drivers.system.host_clock import now_us

        # the smallest delay between the two readings comes closest
        true_offset = max(now_us() - vehicle.boot_us() for _ in range(50))
        wait_for(
            lambda: any(abs(o.offset_us - true_offset) < 20_000 for o in b.of(ClockOffset)), "right offset"
        )
        count = b.link.counters["answers to others"]
        vehicle.send(dialect.MAVLink_timesync_message(5, 12345))
        wait_for(lambda: b.link.counters["answers to others"] > count, "count")


def test_the_autopilots_own_timesync_request_is_answered_in_the_companions_time(bench) -> None:
    b = bench()
    with TestVehicle(b.port) as vehicle:
        wait_for(b.link.vehicle_found.is_set, "vehicle")
        from drivers.system.host_clock import now_us

        before_us = now_us()
        vehicle.send(dialect.MAVLink_timesync_message(0, 777))
        answers = []

        def answered() -> bool:
            answers[:] = [m for m in list(vehicle.received) if m.get_type() == "TIMESYNC" and m.ts1 == 777]
            return bool(answers)

        wait_for(answered, "answer")
        assert before_us <= answers[0].tc1 // 1000 <= now_us()


def test_heartbeats_of_mavsdk_are_withheld_and_numbered_with_our_own(bench) -> None:
    b = bench()
    mavsdk = dialect.MAVLink(None, 1, 191)
    with TestVehicle(b.port) as vehicle:
        wait_for(b.link.vehicle_found.is_set, "vehicle")
        beat = dialect.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3).pack(mavsdk)
        b.link.may_beat = lambda: False
        b.link.send_raw(bytes(beat))
        b.link.may_beat = lambda: True
        b.link.send_raw(bytes(beat))
        wait_for(lambda: [m for m in list(vehicle.received) if m.get_type() == "HEARTBEAT"], "heartbeat")
        time.sleep(0.3)
        assert len([m for m in vehicle.received if m.get_type() == "HEARTBEAT"]) == 1
        assert b.link.counters["heartbeats withheld"] == 1
        numbers = [m.get_seq() for m in vehicle.received]
        assert numbers == [(numbers[0] + i) % 256 for i in range(len(numbers))]


def test_signed_link_drops_unsigned_forged_and_replayed_frames(bench) -> None:
    key = bytes(range(32))
    b = bench(signing_key=key)
    signer = Signer(key, link_id=3)
    with TestVehicle(b.port, seal=signer.sign) as vehicle:
        wait_for(b.link.vehicle_found.is_set, "vehicle")
        mav = dialect.MAVLink(None, 1, 1)
        vehicle.send_bytes(bytes(attitude(1).pack(mav)))
        vehicle.send_bytes(Signer(bytes(32), link_id=3).sign(bytes(attitude(1).pack(mav))))
        wait_for(lambda: b.refusals("unsigned") and b.refusals("wrong_signature"), "refusals")
        old = signer.sign(bytes(attitude(1).pack(mav)))
        beats = len(b.of(Heartbeat))
        wait_for(lambda: len(b.of(Heartbeat)) > beats, "newer heartbeat")
        vehicle.send_bytes(old)
        wait_for(lambda: b.refusals("replayed"), "refusal")
        vehicle.send(attitude(7))
        wait_for(lambda: b.of(Attitude), "signed attitude")
        assert len(b.of(Attitude)) == 1
        wait_for(lambda: vehicle.received_raw, "what we send")
        splitter = FrameSplitter()
        sent = [f for raw in vehicle.received_raw for f in splitter.feed(raw) if isinstance(f, WireFrame)]
        checker = Signer(key)
        assert sent
        assert all(checker.refusal(f) is None for f in sent)


def test_signature_is_the_one_pymavlink_computes() -> None:
    key = bytes(range(32))
    mav = dialect.MAVLink(None, 1, 191)
    mav.signing.secret_key, mav.signing.sign_outgoing = key, True
    mav.signing.link_id, mav.signing.timestamp = 5, 10**12 + 1
    theirs = bytes(attitude(9).pack(mav))
    plain = bytes(attitude(9).pack(dialect.MAVLink(None, 1, 191)))
    assert Signer(key, 5, now=lambda: 10**12).sign(plain) == theirs


@pytest.mark.parametrize("text", ["", "zz", "00" * 31, "00" * 33])
def test_key_file_of_another_length_is_refused(tmp_path, text) -> None:
    path = tmp_path / "key"
    path.write_text(text)
    with pytest.raises(DriverError, match="64 hexadecimal digits"):
        read_key(str(path))


def test_forward_endpoints_get_every_byte_both_ways(bench) -> None:
    port = free_udp_port()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", port))
        station.settimeout(PATIENCE_S)
        b = bench(forward=(f"udpout:127.0.0.1:{port}",))
        with TestVehicle(b.port) as vehicle:
            wait_for(b.link.vehicle_found.is_set, "vehicle")
            seen, peer = station.recvfrom(65536)  # its endpoint is open: from here on all must come
            mav = dialect.MAVLink(None, 1, 1)
            sent = [b"not a frame", *(bytes(attitude(i).pack(mav)) for i in range(50))]
            for piece in sent:
                vehicle.send_bytes(piece)
            while sent[-1] not in seen:
                seen += station.recv(65536)
            places = [seen.find(piece) for piece in sent]
            assert places == sorted(places)
            assert places[0] >= 0
            ping = bytes(dialect.MAVLink_ping_message(1, 2, 1, 1).pack(dialect.MAVLink(None, 255, 190)))
            station.sendto(ping, peer)
            wait_for(lambda: ping in list(vehicle.received_raw), "ping at the vehicle")


def test_tcp_link_comes_up_late_and_comes_back() -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    events: list[DriverEvent] = []
    samples: list[Sample] = []
    link = Link(LinkOptions(f"tcp:127.0.0.1:{port}", system_id=1), samples.extend, events.append)
    link.start()
    mav = dialect.MAVLink(None, 1, 1)
    try:
        wait_for(lambda: [e for e in events if e.event == "link_closed"], "word that nobody is there")
        for _ in range(2):
            with socket.create_server(("127.0.0.1", port)) as server:
                server.settimeout(PATIENCE_S)
                connection, _ = server.accept()
                with connection:
                    count = len(samples)
                    beat = bytes(dialect.MAVLink_heartbeat_message(2, 3, 209, 4, 4, 3).pack(mav))
                    mav.seq += 1
                    connection.sendall(beat[:7])
                    time.sleep(0.05)
                    connection.sendall(beat[7:])
                    wait_for(lambda count=count: len(samples) > count, "heartbeat")
        assert len([e for e in events if e.event == "link_open"]) == 2
    finally:
        link.close()


@pytest.mark.parametrize(
    "name", ["", "udpin:14550", "udpin:0.0.0.0:99999", "tcp:host", "/dev/x:fast", "usb:1"]
)
def test_connection_that_is_none_is_refused_with_the_forms(name) -> None:
    with pytest.raises(DriverError, match="udpin:HOST:PORT"):
        Link(LinkOptions(name), lambda samples: None)


def test_closing_ends_every_thread(bench) -> None:
    before = threading.active_count()
    b = bench(forward=(f"udpout:127.0.0.1:{free_udp_port()}",))
    b.link.close()
    assert threading.active_count() == before
