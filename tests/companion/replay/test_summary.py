"""The summary in words and the history behind it, from messages made by hand."""

import itertools
from collections.abc import Iterable

import msgspec
import pytest

from companion.messages.messages import Decision, Estimate, Event, Health, estimate_message
from companion.replay.history import History
from companion.replay.plot import plot
from companion.replay.summary import Pace, stretches, summary
from landing.estimate import SurfaceEstimate
from landing.options import DecisionOptions

LIMITS = DecisionOptions()
RATE_HZ = 20


def estimate(
    frame: int, inclination_deg: float | None, roughness: float = 0.001, status: str = "ok"
) -> Estimate:
    message = estimate_message(
        SurfaceEstimate(frame, 0.0, status, "map"), frame * 1_000_000 // RATE_HZ, None, True
    )
    return msgspec.structs.replace(
        message, inclination_deg=inclination_deg, roughness=roughness, roll_deg=0.0
    )


def decision(frame: int, verdict: str, withheld: tuple[str, ...] = ("landing is not enabled",)) -> Decision:
    return Decision(
        frame=frame,
        time_unix_us=0,
        verdict=verdict,
        reasons=(),
        since_unix_us=0,
        permitted=not withheld,
        withheld=withheld,
        requested=False,
        command="none",
    )


def event(name: str, frame: int, text: str, severity: str = "info") -> Event:
    return Event(event=name, frame=frame, time_unix_us=0, severity=severity, text=text)


def history(messages: Iterable[Estimate | Decision | Event | Health]) -> History:
    kept = History()
    for message in messages:
        kept.add(message)
    return kept


def flight(*parts: tuple[float, float | None, float]) -> History:
    """Parts as (seconds, inclination, roughness)."""
    found, frame = [], 0
    for seconds, inclination_deg, roughness in parts:
        for _ in range(round(seconds * RATE_HZ)):
            status = "ok" if inclination_deg is not None else "motion_too_small"
            found.append(estimate(frame, inclination_deg, roughness, status))
            frame += 1
    return history(found)


def words(kept: History) -> str:
    return summary("f", kept, LIMITS, Pace(2.0, 1.0))


def test_like_surface_is_one_stretch_and_an_edge_is_none():
    kept = flight(
        (4, 1, 0.001), (0.5, 12, 0.05), (4, 25, 0.02), (0.5, 9, 0.05), (4, 0.5, 0.001), (3, None, 0)
    )
    reported = [stretch.surface for stretch in stretches(kept, LIMITS)]
    assert reported == [
        "level, even",
        "slope of 25 degrees, too steep to land, uneven",
        "level, even",
        "not known",
    ]


def test_uneven_ground_is_reported_apart_from_even_ground_of_the_same_inclination():
    kept = flight((3, 1, 0.001), (6, 2, 0.03), (0.5, 1, 0.001), (4, 1, 0.03), (5, 1, 0.001))
    assert [stretch.surface for stretch in stretches(kept, LIMITS)] == [
        "level, even",
        "level, uneven",
        "level, even",
    ]


def test_stretches_cover_the_flight_without_gaps():
    kept = flight((3, 1, 0.001), (5, 15, 0.001), (3, 30, 0.001))
    found = stretches(kept, LIMITS)
    assert found[0].start_s == 0
    for one, two in itertools.pairwise(found):
        assert two.start_s == pytest.approx(one.end_s)
    assert found[-1].end_s == pytest.approx(11, abs=0.1)


def test_nothing_seen_and_nothing_at_all():
    assert "no frame could be used" in words(History())
    assert "0 of 20 frames (0 %); the others: 20 motion too small" in words(flight((1, None, 0)))


def test_fit_but_not_enabled_says_when_it_would_have_been():
    kept = history(
        [
            *(m for frame in range(40) for m in (estimate(frame, 1.0), decision(frame, "unknown"))),
            *(m for frame in range(40, 60) for m in (estimate(frame, 1.0), decision(frame, "fit"))),
        ]
    )
    text = words(kept)
    assert "first fit for landing at 2.0 s (frame 40); fit 33 % of the time" in text
    assert "not enabled (--enable-after); it would have been at 2.0 s" in text
    assert "3.0 times real time" in text


def test_withheld_for_another_reason_says_which():
    kept = history([estimate(0, 1.0), decision(0, "fit", ("landing is not enabled", "vehicle not armed"))])
    assert "not requested: landing is not enabled; vehicle not armed" in words(kept)


def test_a_request_and_its_outcome_are_reported_in_order():
    kept = history(
        [
            estimate(0, 1.0),
            estimate(20, 1.0),
            event("landing_requested", 20, "surface fit"),
            estimate(30, 1.0),
            event("landing_refused", 20, "command to land: refused: denied", "error"),
        ]
    )
    text = words(kept)
    assert "requested at 1.0 s (frame 20)" in text
    assert "1.5 s: command to land: refused: denied" in text
    assert "trouble" not in text


def test_trouble_and_refusals_are_reported():
    health = Health(
        time_unix_us=0,
        state="ok",
        problems=(),
        inputs={},
        counters={"refused attitude: not_finite": 3, "estimates ok": 5},
        clock_offset_s=None,
        clock_std_s=None,
        camera_late_s=None,
        camera_late_std_s=None,
        pipeline_ms=None,
    )
    kept = history([estimate(0, 1.0), event("attitude_lost", 0, "attitude late", "warning"), health])
    assert "0.0 s  attitude late" in words(kept)
    assert "3 of attitude: not finite" in words(kept)
    assert "estimates ok" not in words(kept)


def test_uncalibrated_and_without_attitude_are_said():
    bare = msgspec.structs.replace(
        estimate(0, None, status="ok"), calibrated=False, slope_x_deg=1.0, slope_y_deg=1.0
    )
    assert "uncalibrated" in words(history([bare]))
    assert "relative to the camera" in words(history([bare]))


def test_a_clock_that_is_set_does_not_stretch_the_flight():
    messages = [estimate(frame, 1.0) for frame in range(100)]
    late = [msgspec.structs.replace(m, time_unix_us=m.time_unix_us + 10**9) for m in messages[50:]]
    early = [msgspec.structs.replace(m, time_unix_us=m.time_unix_us - 10**12) for m in messages[50:]]
    for second in (late, early):
        assert history([*messages[:50], *second]).duration_s == pytest.approx(5.0, abs=0.02)


@pytest.mark.parametrize(
    "kept",
    [History(), flight((1, None, 0)), history([estimate(0, 3.0)]), flight((2, 80, 0.5), (1, 2, 0.001))],
    ids=["empty", "nothing known", "one frame", "steep"],
)
def test_every_flight_can_be_drawn(kept: History, tmp_path):
    plot("f", kept, LIMITS, tmp_path / "p.png")
    assert (tmp_path / "p.png").stat().st_size > 10_000


def test_an_event_that_comes_often_is_one_line_with_its_count():
    messages = list(flight((5, 1.0, 0.001)).estimates)
    reported = [event("attitude_lost", k, "attitude gap", "warning") for k in range(40)]
    text = words(history([*messages, *reported, event("camera_lost", 0, "no frame", "warning")]))
    assert text.count("attitude gap") == 1
    assert "attitude gap (attitude lost 40 times)" in text
    assert "no frame" in text
    assert "41 in all: --events FILE.jsonl has them" in text


def test_what_the_recording_lacks_is_a_caution():
    text = summary("f", flight((2, 1.0, 0.001)), LIMITS, Pace(2.0, 1.0), ("attitude at 2 Hz",))
    assert "  caution    attitude at 2 Hz\n" in text
