"""A live link that stalls and drains: the daemon's relation of the clocks stays, and no event claims a set clock."""

from daemon_support import DaemonBench, wait_for
from late_links import HeldBack

SET = ("clock_jumped", "clock_jump_taken_back", "autopilot_rebooted", "frames_jumped")


def test_a_link_that_stalls_moves_no_clock(tmp_path) -> None:
    """0.5 s of messages are held, then two come for each that is sent, over a real socket."""
    held = HeldBack(2.5, 3.0, 2)
    settings = ("mavlink.timesync_rate_hz=0.1",)
    with DaemonBench(tmp_path, (0.0, 5.5), edit_telemetry=held, settings=settings) as bench:
        bench.play()
        assert bench.vehicle.played.wait(60)
        count = len(bench.of("health"))
        wait_for(lambda: len(bench.of("health")) > count + 1, "health after the flight")
        # as the bench plays: the vehicle begins a little after the camera
        begun_us = (bench.vehicle._play_from - bench.clock._start) * 1e6
        true_s = (bench.clock.host_us(0) + begun_us - bench.vehicle._boot_us_at_start) * 1e-6
        offsets = [h["clock_offset_s"] for h in bench.of("health") if h["clock_offset_s"] is not None]
        assert offsets, "the clocks were never related"
        assert abs(offsets[-1] - true_s) < 0.010
        assert [e["event"] for e in bench.of("event") if e["event"] in SET] == []
