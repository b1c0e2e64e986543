"""The daemon's life: a flight that arrives live, answers, a hung pipeline, its end, a second one, a bus that goes."""

import socket
import threading
import time
from dataclasses import replace

import flight_edits as edits
import pytest
import vehicle_support as vs
from daemon_support import PATIENCE_S, DaemonBench, wait_for
from flight_edits import During
from ports import free_tcp_port

from companion.doctor.running import running
from companion.live.inputs import Inputs
from drivers.bus import Endpoints, Subscription, open_session
from drivers.errors import DriverError
from drivers.system.single_instance import health_path


def test_lands_once_on_fit_ground_and_follows_the_command(tmp_path) -> None:
    with DaemonBench(tmp_path, (0.0, 5.5)) as bench:
        bench.play_to_end()
        assert len(bench.vehicle.land_commands()) == 1
        events = [e["event"] for e in bench.of("event") if e["event"].startswith("landing_")]
        assert events[:4] == ["landing_enabled", "landing_requested", "landing_accepted", "landing_started"]
        health = bench.of("health")[-1]
        assert bench.wrong_now() == [], health["problems"]
        assert health["pipeline_ms"] > 0
        service = running(bench.daemon.settings)
        assert service is not None
        assert service.health is not None, "the doctor reads it beside the lock"
        assert service.health.inputs.keys() == health["inputs"].keys()
    assert running(bench.daemon.settings) is None
    assert not health_path(service.lock).exists()


@pytest.mark.parametrize(
    ("answer", "event", "word"),
    [
        (vs.TEMPORARILY_REJECTED, "landing_refused", "temporarily rejected"),
        (vs.SILENCE, "landing_failed", "no answer"),
    ],
)
def test_a_refused_or_unanswered_command_is_reported_and_not_repeated(tmp_path, answer, event, word) -> None:
    with DaemonBench(tmp_path, (0.0, 6.5), answer=answer, speed=1.0) as bench:
        bench.play_to_end()
        (ended,) = bench.events(event)
        assert word in ended["text"]
        texts = [m.text for m in bench.vehicle.received if m.get_type() == "STATUSTEXT"]
        assert len([t for t in texts if word in t]) == 1
        commands = [t for t, c in bench.vehicle.commands if c.command == 21]
        assert commands[-1] - commands[0] < 2.0, "only MAVSDK's own repetitions"
        assert bench.of("decision")[-1]["command"].endswith(word)


def test_a_request_that_hung_is_not_sent(tmp_path, monkeypatch) -> None:
    with DaemonBench(tmp_path, (0.0, 6.0)) as bench:
        request = bench.daemon._request
        late = lambda r: request(replace(r, time_unix_us=r.time_unix_us - 1_500_000))  # noqa: E731
        monkeypatch.setattr(bench.daemon, "_request", late)
        bench.play()
        wait_for(lambda: bench.events("landing_failed"), "end of the command")
        (failed,) = bench.events("landing_failed")
        assert "too late" in failed["text"]
        assert not bench.vehicle.land_commands()


def test_stopping_lets_a_command_get_its_answer(tmp_path) -> None:
    answer = ((0.0, vs.dialect.MAV_RESULT_IN_PROGRESS), (1.5, vs.dialect.MAV_RESULT_ACCEPTED))
    with DaemonBench(tmp_path, (0.0, 6.5), answer=answer) as bench:
        bench.play()
        wait_for(bench.vehicle.land_commands, "command")
        bench.daemon.stop()
        wait_for(lambda: bench.events("landing_accepted"), "answer")
        assert bench.vehicle.mode == vs.COPTER_LAND, "and it is not taken back"


def test_it_stops_and_is_no_longer_alive_on_the_bus(tmp_path) -> None:
    with DaemonBench(tmp_path, (0.0, 3.0), settings=("landing.enabled=false",)) as bench:
        bench.play()
        wait_for(lambda: bench.of("estimate"), "estimate")
        bench.daemon.stop()
        bench.join(PATIENCE_S)
        wait_for(lambda: not bench.alive, "end of the liveliness token")


def test_a_hung_pipeline_stops_heartbeats_and_watchdog(tmp_path, monkeypatch) -> None:
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    listener.bind(str(tmp_path / "notify"))
    listener.settimeout(0.05)
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    monkeypatch.setenv("WATCHDOG_USEC", "300000")
    reported: list[str] = []
    done = threading.Event()

    def listen() -> None:
        while True:
            try:
                text = listener.recv(4096).decode()
            except TimeoutError:
                if done.is_set():
                    return  # everything that was sent has been read
                continue
            reported.append(text)

    thread = threading.Thread(target=listen)
    thread.start()
    settings = ("landing.enabled=false", "mavlink.heartbeat_max_age_s=0.5")
    try:
        with DaemonBench(tmp_path, (0.0, 14.0), settings=settings, speed=1.0) as bench:
            bench.play()
            wait_for(lambda: bench.vehicle.beats, "heartbeat")
            feed = bench.daemon.pipeline.feed
            hung, goes_on = threading.Event(), threading.Event()

            def hang(samples) -> None:
                monkeypatch.setattr(bench.daemon.pipeline, "feed", feed)
                hung.set()
                goes_on.wait(PATIENCE_S)

            def withheld(count: int) -> None:
                """Wait for so many more heartbeats of MAVSDK, one a second, that the link holds back."""
                until = bench.daemon._link.counters["heartbeats withheld"] + count
                wait_for(
                    lambda: bench.daemon._link.counters["heartbeats withheld"] >= until, "withheld heartbeat"
                )

            def heard() -> tuple[int, int]:
                return len(bench.vehicle.beats), sum("WATCHDOG" in text for text in reported)

            monkeypatch.setattr(bench.daemon.pipeline, "feed", hang)
            assert hung.wait(PATIENCE_S)
            withheld(2)
            while_hung = heard()
            withheld(2)
            assert heard() == while_hung
            goes_on.set()
            wait_for(lambda: heard()[0] > while_hung[0], "heartbeats when it goes on")
            wait_for(lambda: heard()[1] > while_hung[1], "watchdog message")
    finally:
        done.set()
        thread.join()
        listener.close()
    assert reported[0] == "READY=1"
    assert "STOPPING=1" in reported


def test_a_second_daemon_for_the_same_vehicle_says_so(tmp_path) -> None:
    with DaemonBench(tmp_path) as bench, pytest.raises(DriverError, match="already runs for vehicle"):
        Inputs(bench.settings, bench.camera)


def test_camera_and_autopilot_may_come_in_any_order(tmp_path) -> None:
    camera_late = edits.unplugged(During(-9.0, 0.5))  # later, the vehicle is at a constant velocity already
    with DaemonBench(tmp_path, (0.0, 5.5), edit_frames=camera_late) as bench:
        bench.play_to_end()
        assert len(bench.vehicle.land_commands()) == 1
        first = min(bench.at_s(e) for e in bench.of("estimate") if e["status"] != "starting")
        assert first < 0.5 + 2.0


def test_router_absent_at_the_start_gone_and_back(tmp_path) -> None:
    port = free_tcp_port()
    settings = (
        "landing.enabled=false",
        f"zenoh.connect=tcp/127.0.0.1:{port}",
        "zenoh.listen=",
        "zenoh.mode=client",
    )

    def router() -> object:
        return open_session(Endpoints(mode="router", listen=(f"tcp/127.0.0.1:{port}",)))

    with DaemonBench(tmp_path, (0.0, 16.0), settings=settings, listen=False, speed=1.0) as bench:
        bench.play()
        for _ in range(2):
            time.sleep(0.5)
            session = router()
            with Subscription(
                Endpoints("client", (f"tcp/127.0.0.1:{port}",)), bench.settings.vehicle.name
            ) as watcher:
                deadline = time.monotonic() + PATIENCE_S
                while True:
                    delivery = watcher.receive(0.2)
                    if delivery is not None and delivery.topic == "estimate":
                        break
                    assert time.monotonic() < deadline, "no estimate through the router"
            session.close()
        assert bench.daemon_thread.is_alive()


def test_a_subscriber_that_never_reads_holds_nothing_up(tmp_path) -> None:
    with DaemonBench(tmp_path, (0.0, 5.5)) as bench:
        blocked = threading.Event()
        session = open_session(bench.endpoints)
        session.declare_subscriber("landslope/**", lambda sample: blocked.wait(60))
        bench.play_to_end()
        blocked.set()
        session.close()
        assert len(bench.vehicle.land_commands()) == 1
        assert len(bench.of("estimate")) > 60


def test_setting_the_wall_clock_changes_nothing(tmp_path, monkeypatch) -> None:
    true_time, true_time_ns = time.time, time.time_ns
    with DaemonBench(tmp_path, (0.0, 25.0), driven=False) as bench:
        bench.play()
        wait_for(lambda: bench.of("estimate"), "estimate")
        monkeypatch.setattr(time, "time", lambda: true_time() - 86400)
        monkeypatch.setattr(time, "time_ns", lambda: true_time_ns() - 86400 * 10**9)
        seen = len(bench.of("estimate"))
        wait_for(lambda: len(bench.of("estimate")) > seen + 60, "estimates")
        assert not bench.events("clock_jumped")
        assert not bench.events("frames_jumped")


def test_recording_that_cannot_be_written_costs_no_flight(tmp_path) -> None:
    settings = (f"record.directory={tmp_path}", "record.when=always", "record.min_free_mb=1000000")
    with DaemonBench(tmp_path, (0.0, 6.0), settings=settings) as bench:
        bench.play()
        wait_for(bench.vehicle.land_commands, "landing")
        assert bench.events("recording_refused")


def test_recorded_flight_can_be_replayed(tmp_path) -> None:
    from companion.replay.replay import ReplayJob, replay

    settings = (f"record.directory={tmp_path}", "record.when=armed")
    with DaemonBench(tmp_path, (0.0, 3.0), settings=settings) as bench:
        bench.play_to_end()
        live = len([e for e in bench.of("estimate") if e["status"] == "ok"])
    (folder,) = [p for p in tmp_path.iterdir() if p.is_dir() and (p / "vehicle.tlog").exists()]
    text = replay(ReplayJob("flight", folder)).text
    assert "estimates" in text
    assert live > 20


def test_a_camera_that_is_stuck_ends_the_daemon_with_a_reason_to_start_it_anew(tmp_path, monkeypatch) -> None:
    with DaemonBench(tmp_path, (0.0, 3.0), settings=("landing.enabled=false",)) as bench:
        status = bench.daemon._camera.status
        monkeypatch.setattr(bench.daemon._camera, "status", lambda: replace(status(), stuck=True))
        bench.join(PATIENCE_S)
        assert "camera" in bench.daemon.failed
        assert bench.events("camera_stuck")
