"""A link that is late, for a moment or for long, is no clock that was set; what was inferred wrongly is undone."""

import random

import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from companion.clocks.clock import AutopilotClock, ClockChange
from companion.clocks.copies import Copies
from companion.clocks.envelope import Envelope
from companion.clocks.link_watch import LinkWatch
from companion.clocks.round_trips import RoundTrips
from companion.settings.settings import SyncSettings
from drivers.samples import Attitude

OFFSET_US = 1_795_000_000_000_000
BOOT_US = 60_000_000


def feed(clock, seconds, late_s, *, rate_hz=100, start_s=0.0, set_us=0, seed=1):
    """Messages with 1 to 5 ms of jitter, later by ``late_s(t)``, in order; returns changes, errors and stated doubts.

    Errors in us and doubts in us at every message, against the relation with the least delay of 1 ms in it.
    """
    chance, last_us = random.Random(seed), 0
    changes, errors = [], []
    for k in range(round(seconds * rate_hz)):
        t_s = start_s + k / rate_hz
        boot_us = BOOT_US + round(t_s * 1e6)
        arrival_us = OFFSET_US + boot_us + round(chance.uniform(1000, 5000) + late_s(t_s) * 1e6)
        last_us = max(last_us, arrival_us)
        arrival = clock.feed(boot_us, last_us + set_us)
        if arrival.change is not None:
            changes.append(arrival)
        if clock.settled:
            error_us = clock.offset_us(boot_us) + clock.shift_us - set_us - OFFSET_US - 1000
            errors.append((t_s, error_us, clock.std_s * 1e6))
    return changes, errors


def step(at_s, for_s, late_s):
    return lambda t: late_s if at_s <= t < at_s + for_s else 0.0


def drained(at_s, hold_s, pace):
    """Nothing for ``hold_s``, then the backlog at ``pace`` times real time."""
    return lambda t: max(0.0, hold_s - (t - at_s) * (1 - 1 / pace)) if t >= at_s else 0.0


@pytest.mark.parametrize(
    "late_s",
    [
        step(8, 0.55, 0.15),
        step(8, 0.55, 0.35),
        step(6, 3, 0.12),
        step(6, 3, 0.3),
        step(6, 20, 0.09),
        step(6, 40, 0.5),
        drained(5, 0.6, 1.5),
        drained(5, 0.25, 1.2),
        drained(5, 0.4, 1.3),
        lambda t: 0.15 * min(max(t - 6, 0.0), 1.0) * (t < 9),
        lambda t: 0.4 * (1 - t % 1.0) * (t > 2),
    ],
    ids=["15", "35", "12_3s", "30_3s", "9_20s", "50_40s", "drain_a", "drain_b", "drain_c", "ramp", "bursts"],
)
def test_lateness_does_not_move_the_relation(late_s):
    changes, errors = feed(AutopilotClock(SyncSettings()), 60, late_s)
    assert changes == []
    settled = [(e, s) for t, e, s in errors if t > 3]
    assert len(settled) > 5000
    assert max(abs(e) for e, _ in settled) < 9000, "200 ppm, before the drift is known"
    assert all(abs(e) <= 3 * s for e, s in settled)


@given(st.floats(0.02, 1.5), st.floats(0.1, 12), st.floats(4, 20), st.integers(0, 1000))
@examples(25)
def test_no_lateness_of_any_size_is_called_a_clock_that_was_set(late_s, for_s, at_s, seed):
    changes, errors = feed(
        AutopilotClock(SyncSettings()), 35, step(at_s, for_s, late_s), rate_hz=50, seed=seed
    )
    assert changes == []
    assert abs(errors[-1][1]) < 2000


def test_the_doubt_grows_while_all_messages_are_late_and_goes_with_it():
    _, errors = feed(AutopilotClock(SyncSettings()), 30, step(8, 5, 0.08))
    before = max(s for t, _, s in errors if 6 < t < 8)
    during = [s for t, _, s in errors if 10 < t < 13]
    after = max(s for t, _, s in errors if t > 15)
    assert min(during) > 70_000
    assert before < 2000
    assert after < 2000


def test_a_backlog_at_the_start_is_not_taken_for_the_relation():
    clock = AutopilotClock(SyncSettings())
    changes, errors = feed(clock, 6, drained(0, 0.6, 4))
    assert [c.change for c in changes] == [ClockChange.CORRECTED]
    assert all(abs(e) <= 3 * s for _, e, s in errors)
    assert errors[0][0] < 3
    assert errors[-1][2] < 2000


def test_messages_that_had_always_been_late_correct_the_relation_once():
    changes, errors = feed(AutopilotClock(SyncSettings()), 20, lambda t: 0.3 if t < 6 else 0.0)
    assert [c.change for c in changes] == [ClockChange.CORRECTED]
    assert changes[0].jump_us == pytest.approx(-300_000, abs=6000)
    assert abs(errors[-1][1]) < 1500


def test_a_claim_that_the_clock_was_set_is_taken_back_when_messages_come_in_time_again():
    """A gap in the frames at the same moment makes the link's lateness look like a clock that was set."""
    clock = AutopilotClock(SyncSettings(), lambda jump, at: abs(jump - 300_000) < 30_000)
    feed(clock, 6, lambda t: 0.0)
    changes, _ = feed(clock, 3, lambda t: 0.3, start_s=6)
    assert [c.change for c in changes] == [ClockChange.JUMPED]
    changes, errors = feed(clock, 6, lambda t: 0.0, start_s=9)
    assert [c.change for c in changes] == [ClockChange.TAKEN_BACK]
    assert clock.shift_us == 0
    assert abs(errors[-1][1]) < 1500


def test_a_clock_that_nobody_sets_is_never_called_set():
    clock = AutopilotClock(SyncSettings(), lambda jump, at: True, monotonic=True)
    changes, errors = feed(clock, 20, step(6, 3, 5.0))
    assert changes == []
    assert abs(errors[-1][1]) < 1500


def test_the_frames_witness_makes_a_jump_of_the_clock():
    clock = AutopilotClock(SyncSettings(), lambda jump, at: abs(jump - 200_000) < 30_000)
    feed(clock, 6, lambda t: 0.0)
    changes, errors = feed(clock, 6, lambda t: 0.0, start_s=6, set_us=200_000)
    assert [c.change for c in changes] == [ClockChange.JUMPED]
    assert changes[0].witnessed
    assert abs(errors[-1][1]) < 5000


def trips(*offsets_us, trip_us=1000):
    """An envelope at offset 0 and round trips that say otherwise."""
    envelope, found = Envelope(SyncSettings()), RoundTrips(SyncSettings())
    for k in range(2000):
        envelope.add(k * 10_000, 0.0 if k % 7 else 2000.0)
    for k, offset_us in enumerate(offsets_us):
        found.add(19_000_000 + k * 200_000, offset_us, trip_us, envelope)
    return found, envelope


def test_outliers_among_round_trips_are_believed_when_three_agree():
    found, _ = trips(-40_000, -40_300, -39_900)
    best = found.best(20_000_000, 0.0)
    assert best is not None
    assert best.offset_us == pytest.approx(-40_000, abs=400)
    assert trips(-40_000, -40_300)[0].best(20_000_000, 0.0) is None
    assert trips(-40_000, 90_000, -39_900)[0].best(20_000_000, 0.0) is None


def test_round_trips_by_which_messages_arrive_before_they_are_sent_are_a_doubt():
    found, envelope = trips(30_000, 30_200, 29_900)
    assert found.best(20_000_000, 0.0) is None
    assert found.contradiction_us(20_000_000, envelope) == pytest.approx(29_400, abs=500)


def test_a_short_round_trip_ends_the_doubt_about_late_messages():
    clock = AutopilotClock(SyncSettings())
    feed(clock, 10, step(6, 30, 0.08))
    assert clock.std_s > 0.05
    boot_us = BOOT_US + 10_000_000
    clock.feed_round_trip(boot_us, OFFSET_US + boot_us + 1000, OFFSET_US + 200, 1500)
    assert clock.std_s < 0.001
    assert clock.offset_us(boot_us) == pytest.approx(OFFSET_US + 200, abs=100)


def test_copies_are_known_by_boot_time_within_two_seconds():
    copies = Copies()
    first = Attitude(1_000_000, 500_000, 0, 0, 0)
    assert not copies.is_copy(first)
    assert copies.is_copy(Attitude(1_300_000, 500_000, 0, 0, 0))
    assert not copies.is_copy(Attitude(1_300_000, 520_000, 0, 0, 0))
    assert not copies.is_copy(Attitude(4_000_000, 500_000, 0, 0, 0)), "a reboot may have the same boot times"


def test_a_late_link_is_reported_rarely_with_a_count():
    watch, reports = LinkWatch(0.1), []
    for k in range(6000):
        t_s = k / 100
        details = watch.feed(0.4e6 * (t_s % 1.0), round(t_s * 1e6))
        if details is not None:
            reports.append((t_s, details))
    assert [round(t) for t, _ in reports] == [1, 31]
    assert reports[0][1]["late_s"] == pytest.approx(0.396, abs=0.005)
    assert reports[1][1]["spells"] == pytest.approx(30, abs=1)
