"""The daemon on the bench: a recorded flight arrives live."""

from daemon_support import DaemonBench


def test_lands_once_on_fit_ground_and_follows_the_command(tmp_path) -> None:
    with DaemonBench(tmp_path, (0.0, 5.5)) as bench:
        bench.play_to_end()
        assert len(bench.vehicle.land_commands()) == 1
        events = [e["event"] for e in bench.of("event") if e["event"].startswith("landing_")]
        assert events[:4] == ["landing_enabled", "landing_requested", "landing_accepted", "landing_started"]
        health = bench.of("health")[-1]
        assert bench.wrong_now() == [], health["problems"]
        assert health["pipeline_ms"] > 0
