"""A fault that repeats is an event with a count; what was decided always passes."""

from hypothesis import given
from hypothesis import strategies as st

from companion.live.event_rate import BURST, PERIOD_US, EventRate
from companion.messages.events import COMMAND_EVENTS, EVENTS, REPEATING, event
from companion.messages.messages import Event

S = 1_000_000


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
