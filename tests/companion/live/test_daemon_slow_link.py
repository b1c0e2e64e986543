"""A live link that stalls and drains: the daemon's relation of the clocks stays, and no event claims a set clock."""

from daemon_support import DaemonBench, wait_for
from flight_edits import HeldBack

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
        # the smallest delay between the two readings comes closest
        boots = ((bench.vehicle.boot_us(), bench.clock.seconds()) for _ in range(50))
        vehicle_s = min(bench.clock.host_us(0) * 1e-6 - boot_us * 1e-6 + s for boot_us, s in boots)
        offsets = [h["clock_offset_s"] for h in bench.of("health") if h["clock_offset_s"] is not None]
        assert offsets, "the clocks were never related"
        assert abs(offsets[-1] - vehicle_s) < 0.010
        assert [e["event"] for e in bench.of("event") if e["event"] in SET] == []
