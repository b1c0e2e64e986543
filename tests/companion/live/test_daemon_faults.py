"""Faults in mid-flight, each a named edit of the recording: no landing in doubt, health says why, then it recovers."""

from collections.abc import Callable

import flight_edits as edits
import pytest
from daemon_support import DaemonBench, wait_for
from flight_edits import During

FAULT = During(0.3, 2.2)
CUT = (0.0, 6.5)

CAMERA = {
    "unplugged": (edits.unplugged(FAULT), "frames"),
    "frozen": (edits.frozen(FAULT), "frames"),
    "another size": (edits.half_size(FAULT), "camera: pictures are"),
}
TELEMETRY = {
    "attitude gap": (edits.without(FAULT, edits.ATTITUDE, edits.ATTITUDE_QUATERNION), "attitude"),
    "attitude not finite": (edits.not_finite(FAULT), "attitude"),
    "rate too low": (
        edits.thinned(FAULT, 90, edits.ATTITUDE, edits.ATTITUDE_QUATERNION, edits.RAW_IMU),
        "attitude",
    ),
    "landed state gap": (edits.without(During(-1.0, 2.2), edits.EXTENDED_SYS_STATE), "landed state"),
}


def check(bench: DaemonBench, problem: str, record: Callable[[str, object], None]) -> None:
    commands = [t for t, c in bench.vehicle.commands if c.command == 21]
    assert len(commands) == 1, "exactly one landing, after the fault"
    assert commands[0] >= FAULT.end_s
    record("recovery_s", round(commands[0] - FAULT.end_s, 2))
    assert any(p.startswith(problem) for p in bench.problems()), bench.problems()
    assert bench.wrong_now() == [], bench.of("health")[-1]["problems"]


@pytest.mark.parametrize("fault", CAMERA)
def test_camera(tmp_path, fault, record_property) -> None:
    edit, problem = CAMERA[fault]
    with DaemonBench(tmp_path, CUT, edit_frames=edit) as bench:
        bench.play_to_end()
        check(bench, problem, record_property)
        counters = bench.counters()
        assert counters["camera grabbed"] == sum(
            count
            for name, count in counters.items()
            if name in ("camera delivered", "camera skipped", "camera waiting")
            or name.startswith("camera refused")
        )


@pytest.mark.parametrize("fault", TELEMETRY)
def test_telemetry(tmp_path, fault, record_property) -> None:
    edit, problem = TELEMETRY[fault]
    with DaemonBench(tmp_path, CUT, edit_telemetry=edit) as bench:
        bench.play_to_end()
        check(bench, problem, record_property)


def test_heartbeats_stop_while_no_frames_come_and_come_back(tmp_path) -> None:
    gone = During(1.0, 4.0)
    settings = ("landing.enabled=false", "mavlink.heartbeat_max_age_s=0.5")
    with DaemonBench(
        tmp_path, (0.0, 8.0), edit_frames=edits.unplugged(gone), settings=settings, speed=1.0
    ) as bench:
        bench.play()
        wait_for(lambda: bench.vehicle.play_s > gone.end_s, "end of the fault")
        assert not [t for t in list(bench.vehicle.beats_s) if gone.start_s + 0.7 < t < gone.end_s]
        count = len(bench.vehicle.beats)
        wait_for(lambda: len(bench.vehicle.beats) > count, "heartbeat after the fault")


def test_frozen_camera_with_noise_is_noticed_when_the_vehicle_turns(tmp_path) -> None:
    """No two pictures are the same, but they stand still while the attitude changes."""
    when = During(0.3, 4.0)
    with DaemonBench(tmp_path, (0.5, 9.0), edit_frames=edits.frozen(when, noise=1.0)) as bench:
        bench.play_to_end()
        (frozen,) = bench.events("camera_frozen")
        (moves,) = bench.events("camera_moves")
        assert bench.at_s(frozen) < 2.5
        assert when.end_s <= bench.at_s(moves) < when.end_s + 1.0
        assert "camera: the picture stands still while the vehicle turns" in bench.problems()
        assert all(t > when.end_s for t, c in bench.vehicle.commands if c.command == 21)


def test_link_lost_and_back(tmp_path, record_property) -> None:
    with DaemonBench(tmp_path, CUT) as bench:
        bench.play()
        wait_for(lambda: bench.vehicle.play_s >= FAULT.start_s, "start of the fault")
        bench.vehicle.muted = True
        wait_for(lambda: bench.vehicle.play_s >= FAULT.end_s, "end of the fault")
        bench.vehicle.muted = False
        bench.wait_for_end()
        check(bench, "attitude", record_property)


def test_autopilot_reboot(tmp_path) -> None:
    with DaemonBench(tmp_path, (0.0, 7.0), edit_telemetry=edits.rebooted(0.6, 0.8)) as bench:
        bench.play_to_end()
        assert len(bench.events("autopilot_rebooted")) == 1
        commands = [t for t, c in bench.vehicle.commands if c.command == 21]
        assert len(commands) == 1
        assert commands[0] > 1.4
        asked = [c for t, c in bench.vehicle.commands if c.command == 511 and t > 1.4]
        assert {30, 27} <= {int(c.param1) for c in asked}, "rates are asked for again"
