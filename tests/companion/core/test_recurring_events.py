"""Events that come and go are reported at once, then rarely, with their number; none is lost."""

from hypothesis import given
from hypothesis import strategies as st

from companion.core.recurring_events import AT_ONCE, RecurringEvents
from companion.messages.events import event

SECOND_US = 1_000_000


def flapping(seconds: int, name: str = "attitude_lost", every: int = 1):
    """What is reported of an event a second: (when, event)."""
    events, out = RecurringEvents(), []
    for s in range(seconds):
        events_now = [event(name, s, s * SECOND_US, "attitude late")] if s % every == 0 else []
        out += [(s, e) for e in events.step(events_now, s * SECOND_US)]
    return events, out


def test_the_first_ones_are_reported_at_once_and_then_their_number():
    events, out = flapping(100)
    assert [s for s, _ in out[:AT_ONCE]] == [0, 1, 2]
    assert len(out) <= AT_ONCE + 4
    assert out[AT_ONCE][1].text.endswith("times in 30 s")
    assert (
        sum(e.details.get("times", 1) for _, e in out)
        + sum(e.details["times"] for e in events.finish(100 * SECOND_US))
        == 100
    )


def test_the_newest_state_is_the_one_reported():
    events, _ = flapping(10)
    (last,) = events.finish(10 * SECOND_US)
    assert last.frame == 9
    assert last.details == {"times": 7}


def test_rare_events_and_others_pass_as_they_are():
    _, out = flapping(100, every=20)
    assert [e.details for _, e in out] == [{}] * 5
    _, out = flapping(100, name="decision_changed")
    assert len(out) == 100


def test_one_input_does_not_hide_another():
    events = RecurringEvents()
    for s in range(8):
        events.step([event("input_stale", None, 0, "attitude", {"input": "attitude"})], s * SECOND_US)
    events_now = event("input_stale", None, 0, "frames", {"input": "frames"})
    assert events.step([events_now], 8 * SECOND_US) == [events_now]


@given(st.lists(st.integers(0, 40), max_size=60))
def test_none_is_lost(gaps):
    events, now_us, count = RecurringEvents(), 0, 0
    for gap in gaps:
        now_us += gap * SECOND_US
        events_now = events.step([event("attitude_back", None, now_us)], now_us)
        count += sum(e.details.get("times", 1) for e in events_now)
    count += sum(e.details["times"] for e in events.finish(now_us))
    assert count == len(gaps)
