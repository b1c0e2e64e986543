"""What the landing procedure would have done, in summary, plot, picture and report."""

import msgspec
import numpy as np
import pytest

from companion.messages.messages import Decision, Estimate, ProcedureState, estimate_message
from companion.replay.history import History
from companion.replay.overlay import SPOT, Scene, draw
from companion.replay.plot import plot
from companion.replay.procedure_spans import procedure_lines, procedure_spans
from companion.replay.report.data import report_data
from companion.replay.report.recorder import ReportRecorder
from companion.replay.summary import Pace, summary
from landing.estimate import SurfaceEstimate
from landing.options import DecisionOptions
from landing.vision.camera import CameraModel


def estimate(frame: int) -> Estimate:
    return estimate_message(SurfaceEstimate(frame, 0.0, "ok", "map"), frame * 50_000, None, True)


def decision(frame: int) -> Decision:
    return Decision(
        frame=frame, time_unix_us=0, verdict="unknown", reasons=(), since_unix_us=0, permitted=True,
        withheld=(), requested=False, command="none",
    )  # fmt: skip


def history(messages: list[Estimate | Decision]) -> History:
    kept = History()
    for message in messages:
        kept.add(message)
    return kept


def words(kept: History) -> str:
    return summary("f", kept, DecisionOptions(), Pace(2.0, 1.0))


def steered(
    frame: int, state: str, code: str, text: str, spot: tuple[float, float] | None = None
) -> Decision:
    procedure = ProcedureState(
        kind="offboard", state=state, code=code, text=text, order="velocity",
        spot_north_m=None if spot is None else spot[0], spot_east_m=None if spot is None else spot[1],
    )  # fmt: skip
    return msgspec.structs.replace(decision(frame), procedure=procedure)


def flown() -> History:
    steps = {
        0: steered(0, "idle", "no_permission", "waits for the permission"),
        20: steered(20, "look", "no_metres", "moves sideways: the height is not known yet"),
        40: steered(40, "look", "ground_unknown", "moves sideways: the ground is not known yet"),
        60: steered(60, "go", "on_the_way", "flies to the place", (1.5, -0.5)),
        100: steered(100, "give_back", "mode_left", "gave back: the flight mode was changed"),
    }
    messages = []
    for frame in range(121):
        messages.append(estimate(frame))
        if frame in steps:
            messages.append(steps[frame])
    return history(messages)


def test_stretches_of_one_state_with_their_first_reason_and_the_place():
    spans = procedure_spans(flown())
    assert [(s.state, round(s.start_s, 3), round(s.end_s, 3)) for s in spans][:3] == [
        ("idle", 0.0, 1.0), ("look", 1.0, 3.0), ("go", 3.0, 5.0),
    ]  # fmt: skip
    assert spans[1].text == "moves sideways: the height is not known yet"
    assert spans[2].spot_m == (1.5, -0.5)
    assert spans[3].end_s > 6.0
    assert procedure_spans(history([estimate(0), decision(0)])) == []


def test_the_summary_leaves_out_the_wait_unless_there_was_nothing_else():
    assert "procedure    1.0 to   3.0 s  look: moves sideways: the height" in words(flown())
    assert "waits for the permission" not in words(flown())
    waited = history([estimate(0), steered(0, "idle", "no_permission", "waits for the permission")])
    assert procedure_lines(waited)[0].endswith("idle: waits for the permission")
    assert "procedure" not in words(history([estimate(0), decision(0)]))


def test_it_is_drawn_over_the_time_and_on_the_picture(tmp_path):
    plot("f", flown(), DecisionOptions(), tmp_path / "with.png")
    assert (tmp_path / "with.png").stat().st_size > 10_000
    camera = CameraModel(
        320, 240, np.array([[200.0, 0, 160], [0, 200.0, 120], [0, 0, 1]]), np.zeros(5), np.eye(3)
    )
    grey = np.full((240, 320), 90, np.uint8)
    seen = SurfaceEstimate(1, 0.0, "motion_too_small", "map")
    shown = steered(1, "go", "on_the_way", "flies to the place", (1.5, -0.5))
    plain, drawn = (draw(grey, seen, camera, Scene(d, 1.0)) for d in (decision(1), shown))
    rows = np.flatnonzero((plain != drawn).any(axis=(1, 2)))
    height = plain.shape[0]
    assert rows.min() >= height // 11
    assert rows.max() < 0.2 * height


def test_the_disc_of_the_place_is_drawn_where_it_lies():
    camera = CameraModel.from_focal(320, 240, 200.0)
    grey = np.full((240, 320), 90, np.uint8)
    level = SurfaceEstimate(
        1, 0.0, "ok", "map", slope_x_deg=0.0, slope_y_deg=0.0, roll_deg=0.0, pitch_deg=0.0, height_m=4.0
    )
    decided = steered(1, "go", "on_the_way", "flies to the place", (1.5, -0.5))
    ahead = msgspec.structs.replace(decided.procedure, spot_ahead_m=-0.8, spot_right_m=1.2)
    shown = msgspec.structs.replace(decided, procedure=ahead)
    picture = draw(grey, level, camera, Scene(shown, 1.0, radius_m=0.4))
    rows, columns = (picture == SPOT).all(axis=2).nonzero()
    scale = picture.shape[1] / 320
    assert columns.mean() / scale == pytest.approx(160 + 60, abs=3)
    assert rows.mean() / scale == pytest.approx(120 + 40, abs=3)
    without = draw(grey, level, camera, Scene(decided, 1.0, radius_m=0.4))
    assert not (without == SPOT).all(axis=2).any()


def test_the_report_has_the_places_in_the_axes_of_the_path():
    recorder = ReportRecorder(CameraModel.from_focal(320, 240, 200.0), 0.4)
    try:
        recorder.path = [(0.0, 0.0, 0.0, -4.0), (2.9, 10.0, 20.0, -4.0), (9.0, 99.0, 99.0, -4.0)]
        places = report_data(flown(), DecisionOptions(), recorder)["places"]
    finally:
        recorder.close()
    assert places["radius_m"] == 0.4
    assert places["chosen"] == [
        [pytest.approx(3.0, abs=0.01), 11.5, 19.5],
        [pytest.approx(5.0, abs=0.01), None, None],
    ]
