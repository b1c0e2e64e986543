"""What the monitor keeps: bounded whatever comes, silent vehicles noticed, odd input counted."""

import math
from itertools import pairwise

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from monitor_support import decision, estimate, event

from companion.messages.messages import Decision, Estimate, ProcedureState, encode
from companion.messages.preview import Preview
from companion.messages.tilt import tilt_of
from companion.monitor import words
from companion.monitor.charts import CHARTS, chart_svg
from companion.monitor.ground_view import ground_svg, way_on
from companion.monitor.options import MonitorOptions
from companion.monitor.page import view_of
from companion.monitor.scene import scene_svg
from companion.monitor.state import Watch
from companion.monitor.tracks import counts, tracks_svg
from drivers.bus import Delivery

OPTIONS = MonitorOptions(max_vehicles=3, max_events=5)


def said(vehicle: str, number: int) -> Delivery:
    return Delivery(vehicle, "estimate", encode(estimate(number)))


def test_history_is_thinned_and_bounded() -> None:
    watch = Watch(OPTIONS)
    for number in range(8_000):
        watch.take(said("one", number), number / 10)
    points = watch.vehicles["one"].points
    gaps = [b.time_s - a.time_s for a, b in pairwise(points)]
    assert min(gaps) >= 1 / OPTIONS.history_hz
    assert points[-1].time_s - points[0].time_s == pytest.approx(OPTIONS.history_s, abs=1)
    assert len(points) <= OPTIONS.history_s * OPTIONS.history_hz + 1
    assert watch.vehicles["one"].received["estimate"] == 8_000


def test_vehicles_and_events_are_bounded() -> None:
    watch = Watch(OPTIONS)
    for number in range(10):
        watch.take(said(f"v{number}", 1), 0.0)
        watch.take(Delivery("v0", "event", encode(event(str(number)))), 0.0)
    assert sorted(watch.vehicles) == ["v0", "v1", "v2"]
    assert watch.left_out == 7
    assert [e.text for e in watch.vehicles["v0"].events] == ["5", "6", "7", "8", "9"]


def test_a_vehicle_that_left_makes_room_for_a_new_one() -> None:
    watch = Watch(OPTIONS)
    for name, now in (("a", 0.0), ("b", 1.0), ("c", 20.0), ("d", 20.0), ("e", 20.0), ("f", 20.0)):
        watch.take(said(name, 1), now)
    assert sorted(watch.vehicles) == ["c", "d", "e"]
    assert watch.left_out == 1


@pytest.mark.parametrize(
    "delivery",
    [
        Delivery("one", "estimate", b""),
        Delivery("one", "estimate", b'{"frame":1}'),
        Delivery("one", "estimate", b"\xff\xfe"),
        Delivery("one", "land", b"{}"),
        Delivery("one", "preview", b"\xff\xd8", attachment=b"[1]"),
        Delivery("one", "event", b"x" * 2_000_000),
        Delivery("one", "decision", b"[" * 100_000),
    ],
)
def test_what_cannot_be_understood_is_counted(delivery: Delivery) -> None:
    watch = Watch(OPTIONS)
    watch.take(said("one", 1), 0.0)
    watch.take(delivery, 1.0)
    assert watch.vehicles["one"].refused == 1
    assert watch.vehicles["one"].heard_s == 0.0


NESTED = b"[" * 50_000 + b"]" * 50_000


@pytest.mark.parametrize(
    ("topic", "old", "new"),
    [
        ("event", b'"details":{}', b'"details":{"a":' + NESTED + b"}"),
        ("event", b'"time_unix_us":', b'"time_unix_us":9'),
        ("event", b'"time_unix_us":', b'"time_unix_us":-'),
        ("estimate", b'"frame":1', b'"frame":' + b"9" * 40),
        ("preview", b'"width":320', b'"width":0'),
        ("preview", b'"width":320', b'"width":' + b"9" * 400),
    ],
)
def test_what_could_not_be_shown_is_refused(topic: str, old: bytes, new: bytes) -> None:
    preview = Preview(frame=1, time_unix_us=1, width=320, height=240, status="ok", tracks=(), inlier=())
    good = {
        "event": encode(event("x")),
        "estimate": encode(estimate(1)),
        "preview": msgspec.json.encode(preview),
    }[topic]
    bad = good.replace(old, new)
    assert bad != good
    watch = Watch(OPTIONS)
    for raw, refused in ((good, 0), (bad, 1)):
        watch.take(Delivery("one", topic, b"" if topic == "preview" else raw, attachment=raw), 0.0)
        assert watch.vehicles["one"].refused == refused


EXTREMES = {
    int: st.integers(-(2**70), 2**70),
    float | None: st.none() | st.floats(allow_nan=False, allow_infinity=False),
    str: st.text(max_size=600),
    str | None: st.none() | st.text(max_size=600),
    bool: st.booleans(),
    tuple[str, ...]: st.lists(st.text(max_size=600), max_size=30).map(tuple),
}


EXTREMES[tuple[float, float, float] | None] = st.none()


def anything(kind: type) -> st.SearchStrategy[object]:
    fields = {f.name: EXTREMES[f.type.__origin__] for f in msgspec.structs.fields(kind)}
    return st.fixed_dictionaries(fields).map(lambda given: kind(**given))


EXTREMES[ProcedureState | msgspec.UnsetType] = st.just(msgspec.UNSET) | anything(ProcedureState)


@given(anything(Estimate), anything(Decision))
def test_whatever_is_stored_can_be_shown(one: Estimate, other: Decision) -> None:
    watch = Watch(OPTIONS)
    watch.take(Delivery("one", "estimate", encode(one)), 0.0)
    watch.take(Delivery("one", "decision", encode(other)), 0.0)
    vehicle = view_of(watch, "one", 0.1).vehicle
    assert vehicle is not None
    texts = [
        *words.figures(vehicle.estimate).values(),
        words.permission(vehicle.decision),
        words.command(vehicle.decision),
        words.procedure(vehicle.decision),
        *words.against(vehicle.decision, vehicle.estimate),
        words.verdict(vehicle.decision),
    ]
    assert max(len(words.clipped(text)) for text in texts) <= 401
    svg = scene_svg(vehicle.estimate, "fit")
    assert "nan" not in svg
    ground = {"north_m": 1.0, "east_m": 2.0}
    assert "nan" not in ground_svg(ground, None, words.steered(vehicle.decision), [(0.0, 0.0), (1.0, 2.0)])
    for chart in CHARTS:
        drawn = chart_svg(chart, list(vehicle.points), 1.0, 60.0, 10.0)
        assert "nan" not in drawn
        assert "inf" not in drawn


@given(st.binary(max_size=200), st.sampled_from(["estimate", "decision", "health", "event", "preview", "x"]))
def test_no_bytes_break_it(raw: bytes, topic: str) -> None:
    watch = Watch(OPTIONS)
    watch.take(Delivery("one", topic, raw, attachment=raw), 0.0)
    vehicle = watch.vehicles["one"]
    assert vehicle.refused + vehicle.received.total() == 1


def test_silence_is_an_age_or_a_fallen_token() -> None:
    watch = Watch(OPTIONS)
    watch.take(Delivery("one", "alive", alive=True), 0.0)
    watch.take(said("one", 1), 1.0)
    silent = [view_of(watch, None, now).silent for now in (1.5, 1.0 + OPTIONS.silent_after_s + 0.1)]
    assert silent[0] == []
    assert silent[1] == [("one", pytest.approx(OPTIONS.silent_after_s + 0.1))]
    watch.take(said("one", 2), 5.0)
    assert view_of(watch, None, 5.1).silent == []
    watch.take(Delivery("one", "alive", alive=False), 5.2)
    assert [name for name, _ in view_of(watch, None, 5.3).silent] == ["one"]


def test_a_vehicle_that_returns_without_a_token_is_heard_again() -> None:
    watch = Watch(OPTIONS)
    watch.take(said("one", 1), 0.0)
    watch.take(Delivery("one", "alive", alive=False), 1.0)
    watch.take(Delivery("one", "alive", alive=True), 2.0)
    watch.take(said("one", 2), 2.1)
    assert view_of(watch, None, 2.2).silent == []


def test_missing_frames_are_counted_and_a_restart_is_none() -> None:
    watch = Watch(OPTIONS)
    for number in (1, 2, 5, 6, 0, 1):
        watch.take(said("one", number), 0.0)
    assert watch.vehicles["one"].missed == 2


def test_the_first_vehicle_that_speaks_is_shown_and_a_chosen_one_stays() -> None:
    watch = Watch(OPTIONS)
    assert view_of(watch, None, 0.0).vehicle is None
    watch.take(said("a", 1), 0.0)
    watch.take(said("b", 1), 10.0)
    shown = view_of(watch, None, 10.1).vehicle
    assert shown is not None
    assert shown.name == "b"  # a has fallen silent
    shown = view_of(watch, "a", 10.1).vehicle
    assert shown is not None
    assert shown.name == "a"
    assert view_of(watch, "c", 10.1).vehicle is None


def with_angles(pitch: float | None, roll: float | None, inclination: float | None) -> Estimate:
    return msgspec.structs.replace(
        estimate(1), surface_pitch_deg=pitch, surface_roll_deg=roll, inclination_deg=inclination
    )


def test_the_drawn_plane_has_the_sign_and_the_size_of_the_surface() -> None:
    rising = tilt_of(with_angles(20, 0, 20))
    falling_right = tilt_of(with_angles(0, 10, 10))
    assert rising is not None
    assert falling_right is not None
    # down = 1 + ahead x + right y: ground that rises ahead has its depth shrink ahead
    assert (rising.ahead, rising.right) == pytest.approx((-math.tan(math.radians(20)), 0))
    assert (falling_right.ahead, falling_right.right) == pytest.approx((0, math.tan(math.radians(10))))


@given(st.floats(-180, 180), st.floats(-180, 180), st.floats(0, 90))
def test_any_surface_can_be_drawn(pitch: float, roll: float, inclination: float) -> None:
    svg = scene_svg(with_angles(pitch, roll, inclination), "fit")
    assert "nan" not in svg
    assert "inf" not in svg


def test_an_unknown_surface_is_not_drawn_as_a_level_one() -> None:
    known, unknown = (
        scene_svg(with_angles(0, 0, 0), "fit"),
        scene_svg(with_angles(None, None, None), "unknown"),
    )
    assert known.count("<polygon") == unknown.count("<polygon") + 1
    assert "data-ahead" not in unknown
    assert "data-ahead" not in scene_svg(None, "unknown")


def test_unknown_numbers_are_dashes_and_gaps() -> None:
    nothing = msgspec.structs.replace(
        estimate(1),
        status="motion_too_small",
        **dict.fromkeys(
            ("inclination_deg", "inclination_std_deg", "time_to_contact_s", "ventral_flow_x", "roughness")
        ),
    )
    shown = words.figures(nothing)
    assert shown["inclination_deg"] == shown["roughness"] == shown["ventral_flow"] == words.DASH
    assert "no estimate: motion too small" in words.against(decision(), nothing)
    watch = Watch(OPTIONS)
    watch.take(Delivery("one", "estimate", encode(nothing)), 1.0)
    for chart in CHARTS:
        drawn = chart_svg(chart, list(watch.vehicles["one"].points), 2.0, 60.0, None)
        assert '<path class="value" d=""/>' in drawn


def test_the_command_and_the_permission_in_words() -> None:
    assert words.permission(decision(permitted=True)) == "given"
    assert "landing was requested" in words.permission(decision(requested=True))
    assert words.command(decision(command="denied: not armable")) == "denied: not armable"
    assert words.command(decision()) == "none sent"


@given(st.lists(st.tuples(*[st.floats(allow_nan=True, allow_infinity=True)] * 4), max_size=20))
def test_tracks_draw_only_what_can_be_drawn(rows: list[tuple[float, float, float, float]]) -> None:
    preview = Preview(
        frame=1,
        time_unix_us=1,
        width=320,
        height=240,
        status="ok",
        tracks=tuple(rows),
        inlier=(True,) * len(rows),
    )
    svg = tracks_svg(preview)
    assert "nan" not in svg
    assert "inf" not in svg
    assert counts(preview) == f"frame 1: {len(rows)} inliers, 0 outliers"


def test_the_way_and_the_chosen_place_are_drawn_from_above() -> None:
    path: list[tuple[float, float]] = []
    for north in (0.0, 0.5, 1.0):
        path = way_on(path, {"north_m": north, "east_m": 0.0})
    chosen = ProcedureState(
        kind="offboard",
        state="go",
        code="on_the_way",
        text="",
        order="velocity",
        spot_north_m=2.0,
        spot_east_m=-1.0,
    )
    svg = ground_svg({"north_m": 1.0, "east_m": 0.0}, None, chosen, path)
    assert 'points="200.0,225.0 200.0,212.5 200.0,200.0"' in svg, "south of where it is now"
    assert 'class="chosen" cx="175.0" cy="150.0"' in svg
    assert way_on(path, {"north_m": 40.0, "east_m": 0.0}) == [(40.0, 0.0)], "the map began anew"
    assert way_on(path, {"north_m": None}) == path
    assert "chosen" not in ground_svg({"north_m": 1.0, "east_m": 0.0}, None)
