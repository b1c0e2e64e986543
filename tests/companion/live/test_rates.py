"""A fault that repeats is an event with a count; a processor that skips frames is a condition with what would help."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from companion.live.event_rate import BURST, PERIOD_US, EventRate
from companion.live.overload import ENDS, WINDOW_US, Overload
from companion.messages.conditions import Condition
from companion.messages.events import COMMAND_EVENTS, EVENTS, REPEATING, event
from companion.messages.messages import Event

S = 1_000_000
FRAME_US = S // 30


def run(name: str, times_us: list[int], end_us: int, **details: str) -> list[Event]:
    rate, out = EventRate(), []
    for now_us in sorted({*times_us, *range(0, end_us, S // 2)}):
        if now_us in times_us:
            out += rate.feed(event(name, None, now_us, "", dict(details)))
        out += rate.step(now_us)
    return out + rate.finish()


def test_a_clock_that_is_set_eight_times_in_42_seconds():
    out = run("clock_jumped", [k * 6 * S for k in range(8)], 60 * S)
    assert len(out) == 8, "a few in a minute pass"
    out = run("clock_jumped", [k * S // 5 for k in range(210)], 60 * S)
    assert len(out) <= BURST + 42 * S // PERIOD_US + 1
    assert sum(e.details.get("count", 1) for e in out) == 210
    counts = [e.details["count"] for e in out[BURST:]]
    assert f"({counts[0]} times in " in out[BURST].text


def test_what_is_decided_or_commanded_passes_whatever_its_rate():
    assert not REPEATING & (COMMAND_EVENTS | {"decision_changed", "landing_enabled", "landing_disabled"})
    assert set(EVENTS) >= REPEATING
    assert len(run("decision_changed", [k * 1000 for k in range(100)], S)) == 100


def test_one_input_does_not_hold_back_another():
    rate = EventRate()
    for k in range(BURST + 2):
        rate.feed(event("input_stale", None, k, "", {"input": "gyro"}))
    assert rate.feed(event("input_stale", None, 9, "", {"input": "frames"}))


def test_the_last_of_a_kind_always_passes():
    (*_, last) = run("camera_lost", [k * 1000 for k in range(20)], S)
    assert last.time_unix_us == 19_000
    assert last.details["count"] == 20 - BURST


@given(st.lists(st.integers(0, 100 * S), unique=True))
def test_nothing_is_lost_and_no_kind_comes_too_often(times_us: list[int]):
    out = run("link_closed", times_us, 130 * S)
    assert sum(e.details.get("count", 1) for e in out) == len(times_us)
    assert len(out) <= BURST * (130 * S // PERIOD_US + 1)


def flown(
    cost_us: int, seconds: int, overload: Overload, start_us: int = 0
) -> tuple[list[Condition | None], list[int]]:
    """A camera at 30 Hz whose newest frame waits, and a processor that needs ``cost_us`` for each.

    Returns the conditions, one a frame processed, and the numbers of those frames.
    """
    found, processed, now_us = [], [], start_us
    newest = -1
    while now_us < start_us + seconds * 1_000_000:
        frame = (now_us - start_us) // FRAME_US
        if frame == newest:
            now_us = start_us + (frame + 1) * FRAME_US
            continue
        newest = frame
        processed.append(frame)
        found.append(overload.step(now_us, len(processed), frame + 1 - len(processed)))
        now_us += cost_us
    return found, processed


def test_a_processor_that_keeps_up_is_no_condition():
    found, _ = flown(8_000, 20, Overload())
    assert set(found) == {None}


def test_a_quarter_of_that_speed_is_a_condition_that_says_what_would_help():
    found, processed = flown(4 * 25_000, 20, Overload())
    stands = [c for c in found if c is not None]
    assert found[-1] is not None
    assert stands[-1].code == "overloaded"
    assert "10 of 30 frames a second" in stands[-1].text
    for remedy in ("camera.rate_hz", "camera.width", "tracking.max_features"):
        assert remedy in stands[-1].text
    gaps = {later - earlier for earlier, later in pairwise(processed)}
    assert max(gaps) - min(gaps) <= 1, "skipped evenly"


def test_it_ends_when_the_processor_keeps_up_again():
    overload, first_us = Overload(), 0
    counted = [0, 0]
    states = []
    for second in range(40):
        slow = 5 <= second < 20
        counted[0] += 15 if slow else 30
        counted[1] += 15 if slow else 0
        states.append(overload.step(first_us + second * 1_000_000, *counted) is not None)
    assert not any(states[:6])
    assert all(states[10:20])
    assert not any(states[20 + WINDOW_US // 1_000_000 + 1 :])


def test_a_single_late_frame_and_a_camera_that_counts_anew_are_none():
    overload = Overload()
    assert all(overload.step(k * 1_000_000, 30 * k, k // 10) is None for k in range(30))
    assert overload.step(30_000_000, 3, 0) is None
    assert 0 < ENDS < 0.1
