"""Nuisances that must not keep a daemon from its work: each is refused and counted, and the landing still comes."""

import threading
import time
from collections import Counter

import flight_edits as edits
import numpy as np
from daemon_support import PATIENCE_S, DaemonBench, recorded_frames, wait_for
from flight_edits import During
from pymavlink.dialects.v20 import ardupilotmega as dialect
from vehicle_support import TestVehicle

CLOCK_SET = ("clock_jumped", "clock_jump_taken_back", "autopilot_rebooted", "frames_jumped")


def test_every_frame_is_accounted_for(tmp_path) -> None:
    """One frame lost, a stamp twice, a stamp backward, a frame of another size."""
    seen: Counter[str] = Counter()
    stamps = [t_us for t_us, _ in recorded_frames(0.0, 5.5)]

    def edit(t: float, image: np.ndarray):
        at = round(t * 30)
        seen[f"{at}"] += 1
        if at == 14:
            return image, stamps[6] - stamps[7]  # the stamp of the frame before
        if at == 18:
            return image, -90_000
        return image[:120, :160] if at == 22 else image

    with DaemonBench(tmp_path, (0.0, 5.5), edit_frames=edit) as bench:
        bench.play_to_end(then_s=1.2)
        counters = bench.counters()
        assert counters["camera refused: backward_stamp"] == 1
        assert counters["camera refused: repeated_stamp"] + counters["camera refused: backward_stamp"] == 2
        assert counters["camera refused: size_changed"] == 1
        assert counters["camera grabbed"] == sum(
            counters[f"camera {name}"] for name in ("delivered", "skipped", "waiting")
        ) + sum(count for name, count in counters.items() if name.startswith("camera refused"))
        assert len(bench.vehicle.land_commands()) == 1


def test_junk_on_the_link_is_counted_and_changes_nothing(tmp_path) -> None:
    """Garbage, wrong checksums, foreign systems, an impostor, NaN, and answers to others' commands, all the time."""
    nan = edits.not_finite(During(1.5, 1.55))
    with DaemonBench(tmp_path, (0.0, 5.5), edit_telemetry=nan) as bench:
        stop = threading.Event()
        sent: Counter[str] = Counter()

        def pester() -> None:
            foreign = TestVehicle(bench.port, system=9)
            impostor = TestVehicle(bench.port)
            denied = dialect.MAVLink_command_ack_message(21, dialect.MAV_RESULT_ACCEPTED, 0, 0, 255, 190)
            broken = bytearray(
                dialect.MAVLink_attitude_message(1, 9, 9, 9, 9, 9, 9).pack(dialect.MAVLink(None, 1, 1))
            )
            broken[-1] ^= 0xFF
            while not stop.wait(0.05):
                bench.vehicle.send_bytes(b"\x00garbage\xfd\x09\x00")
                bench.vehicle.send_bytes(bytes(broken))
                bench.vehicle.send(denied)
                foreign.send(dialect.MAVLink_attitude_message(1, 1, 1, 1, 0, 0, 0))
                impostor.send(dialect.MAVLink_heartbeat_message(2, 3, 81, 0, 4, 3))
                sent["rounds"] += 1
            foreign.socket.close()
            impostor.socket.close()

        bench.play()
        pest = threading.Thread(target=pester)
        pest.start()
        bench.wait_for_end()
        stop.set()
        pest.join()
        bench.go_on(1.2)
        assert len(bench.vehicle.land_commands()) == 1
        counters = bench.counters()
        rounds = sent["rounds"]
        assert rounds > 20
        assert counters["link refused: foreign_system"] == rounds
        assert counters["link refused: second_sender"] == rounds
        assert counters["link answers to others"] >= rounds
        assert counters["link garbage bytes"] == rounds * (11 + len(bytes(40)))
        assert counters["refused attitude: not_finite"] >= 4
        assert len(bench.events("mavlink_refused")) == 2, "reported once each, not every time"


def test_pilot_switches_landing_on_and_off_by_radio(tmp_path) -> None:
    settings = ("landing.enabled=false", "landing.enable_rc_channel=8")
    with DaemonBench(tmp_path, (0.0, 6.5), settings=settings) as bench:
        bench.play()

        def radio(switch_us: int, until_s: float) -> None:
            while bench.vehicle.play_s < until_s:
                bench.vehicle.send(edits.rc_channels(switch_us))
                time.sleep(0.1)

        radio(1900, 1.6)  # on from the start: does not count
        assert not bench.vehicle.land_commands()
        radio(1000, 2.4)
        assert not bench.vehicle.land_commands()
        radio(1900, 3.4)
        wait_for(bench.vehicle.land_commands, "landing")
        radio(1000, 3.6)
        bench.wait_for_end()
        assert len(bench.vehicle.land_commands()) == 1
        names = [e["event"] for e in bench.of("event") if e["event"].startswith("landing_")]
        assert names.index("landing_enabled") < names.index("landing_requested")
        assert names[-1] == "landing_disabled"


def test_two_vehicles_and_none_named_means_no_landing(tmp_path) -> None:
    with DaemonBench(tmp_path, (0.0, 3.0), settings=("vehicle.system_id=0",)) as bench:
        wait_for(lambda: bench.daemon.commander_connected, "connection of MAVSDK")
        with TestVehicle(bench.port, system=2):
            bench.play_to_end()
        assert not bench.vehicle.land_commands()
        assert any("set vehicle.system_id" in e["text"] for e in bench.events("mavlink_refused"))


def test_ground_that_turns_out_unfit_is_reported_and_held_over_if_asked(tmp_path) -> None:
    """Landing begins over the platform, which ends; hold is asked for."""
    settings = ("landing.on_unfit=hold", "landing.unfit_min_height_m=0.3")
    with DaemonBench(tmp_path, (4.0, 9.5), settings=settings) as bench:
        bench.play_to_end()
        assert len(bench.vehicle.land_commands()) == 1
        assert len(bench.events("surface_unfit")) == 1
        asked = [c for _, c in bench.vehicle.commands if c.command in (176, 192)]
        assert asked, "DO_SET_MODE or DO_REPOSITION"
        assert len(bench.events("hold_accepted")) == 1


def test_a_link_that_stalls_moves_no_clock(tmp_path) -> None:
    """0.5 s of messages are held, then two come for each that is sent, over a real socket."""
    held = edits.HeldBack(2.5, 3.0, 2)
    settings = ("mavlink.timesync_rate_hz=0.1",)
    with DaemonBench(tmp_path, (0.0, 5.5), edit_telemetry=held, settings=settings) as bench:
        bench.play()
        assert bench.vehicle.played.wait(PATIENCE_S)
        count = len(bench.of("health"))
        wait_for(lambda: len(bench.of("health")) > count + 1, "health after the flight")
        # the smallest delay between the two readings comes closest
        boots = ((bench.vehicle.boot_us(), bench.clock.seconds()) for _ in range(50))
        vehicle_s = min(bench.clock.host_us(0) * 1e-6 - boot_us * 1e-6 + s for boot_us, s in boots)
        offsets = [h["clock_offset_s"] for h in bench.of("health") if h["clock_offset_s"] is not None]
        assert offsets, "the clocks were never related"
        assert abs(offsets[-1] - vehicle_s) < 0.010
        assert [e["event"] for e in bench.of("event") if e["event"] in CLOCK_SET] == []
