"""One fault after another while the stairs are below and landing is enabled: only the floor is landed on."""

import flight_edits as edits
import numpy as np
from daemon_support import DaemonBench, wait_for
from flight_edits import During

CUT = (8.0, 21.0)
"""Over the stairs from the start; the last step is behind the vehicle at 16.4 s of the flight."""
FLOOR_S = 16.4 - CUT[0]
UNPLUGGED, FROZEN = During(0.6, 1.6), During(2.2, 3.2)
NO_ATTITUDE, NOT_FINITE = During(3.6, 4.4), During(4.6, 5.0)
LINK_LOST, REBOOT_S, SILENT_S = During(5.2, 6.2), 6.6, 0.5


def test_no_fault_over_the_stairs_makes_a_landing(tmp_path, record_property) -> None:
    unplugged, frozen = edits.unplugged(UNPLUGGED), edits.frozen(FROZEN)
    telemetry = (
        edits.without(NO_ATTITUDE, edits.ATTITUDE, edits.ATTITUDE_QUATERNION),
        edits.not_finite(NOT_FINITE),
        edits.rebooted(REBOOT_S, SILENT_S),
    )

    def frames(t: float, image: np.ndarray):
        return unplugged(t, image) if t in UNPLUGGED else frozen(t, image)

    def messages(t: float, frame: bytes) -> list[bytes]:
        out = [frame]
        for edit in telemetry:
            out = [changed for one in out for changed in edit(t, one)]
        return out

    with DaemonBench(tmp_path, CUT, edit_frames=frames, edit_telemetry=messages) as bench:
        bench.play()
        wait_for(lambda: bench.vehicle.play_s > LINK_LOST.start_s, "loss of the link")
        bench.vehicle.muted = True
        wait_for(lambda: bench.vehicle.play_s > LINK_LOST.end_s, "return of the link")
        bench.vehicle.muted = False
        bench.wait_for_end()
        commands = [t for t, c in bench.vehicle.commands if c.command == 21]
        assert len(commands) == 1
        assert commands[0] > FLOOR_S
        record_property("landing_after_the_last_step_s", round(commands[0] - FLOOR_S, 2))
        reported = {e["event"] for e in bench.of("event")}
        assert {
            "camera_lost",
            "camera_back",
            "input_stale",
            "autopilot_rebooted",
            "landing_accepted",
        } <= reported
        assert not [d for d in bench.of("decision") if d["verdict"] == "fit" and bench.at_s(d) < FLOOR_S]
        counters = bench.counters()
        assert counters["camera refused: picture_repeated"] > 10
        assert counters["refused attitude: not_finite"] > 30
