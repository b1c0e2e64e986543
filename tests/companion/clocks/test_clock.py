"""The relation of boot time and companion time: jitter, drift, loss, reboots, wraps, jumps and round trips."""

import random
from itertools import pairwise

import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from companion.clocks.clock import WRAP_US, AutopilotClock, ClockChange
from companion.settings.settings import SyncSettings

OFFSET_US = 1_795_000_000_000_000
BOOT_US = 60_000_000


class Link:
    """An autopilot whose clock drifts against the companion's, behind a link that jitters and loses messages."""

    def __init__(self, seed=1, drift_ppm=0.0, jitter_us=(1000, 9000), loss=0.0, offset_us=OFFSET_US):
        self.random = random.Random(seed)
        self.drift = drift_ppm * 1e-6
        self.jitter_us = jitter_us
        self.loss = loss
        self.offset_us = offset_us
        self.last_us = 0

    def true_us(self, boot_us):
        """Companion time of a boot time."""
        return self.offset_us + boot_us + self.drift * (boot_us - BOOT_US)

    def run(self, clock, start_us, seconds, rate_hz=100.0, shift_us=0, truncate=False, boot_shift_us=0):
        """Feed messages; returns the arrivals that showed a change."""
        changes = []
        for k in range(round(seconds * rate_hz)):
            boot_us = start_us + round(k * 1e6 / rate_hz)
            if self.random.random() < self.loss:
                continue
            arrival_us = round(self.true_us(boot_us) + self.random.uniform(*self.jitter_us))
            arrival_us = self.last_us = max(self.last_us, arrival_us)  # a link keeps the order
            stamp_us = boot_us + boot_shift_us
            if truncate:
                stamp_us = stamp_us // 1000 * 1000 + 500
            arrival = clock.feed(stamp_us, arrival_us + shift_us, 1000 if truncate else 0)
            if arrival.change is not None:
                changes.append(arrival)
        return changes

    def error_us(self, clock, boot_us):
        """Estimated minus true relation, the link's least delay counted as part of it."""
        return clock.offset_us(boot_us) + boot_us - self.true_us(boot_us) - self.jitter_us[0]


@given(
    st.integers(0, 2**31),
    st.floats(-100, 100),
    st.floats(0, 0.5),
    st.sampled_from([10.0, 50.0, 200.0]),
    st.booleans(),
)
@examples(60)
def test_the_relation_stays_within_a_millisecond(seed, drift_ppm, loss, rate_hz, truncate):
    link, clock = Link(seed, drift_ppm, loss=loss), AutopilotClock(SyncSettings())
    link.run(clock, BOOT_US, 6, rate_hz, truncate=truncate)
    end_us = BOOT_US + 6_000_000
    # Ten messages a second, half of them lost, and 8 ms of jitter: the least of 30 delays is 0.26 ms high on average.
    allowed_us = 1000 + 8000 * 6 / (6 * rate_hz * (1 - loss))
    for _ in range(12):
        link.run(clock, end_us, 1, rate_hz, truncate=truncate)
        end_us += 1_000_000
        assert clock.settled
        assert abs(link.error_us(clock, end_us)) < allowed_us


@pytest.mark.parametrize("drift_ppm", [-100, -20, 0, 60, 100])
def test_drift_is_found_and_followed_for_minutes(drift_ppm):
    link, clock = Link(3, drift_ppm), AutopilotClock(SyncSettings())
    link.run(clock, BOOT_US, 180)
    assert clock.drift * 1e6 == pytest.approx(drift_ppm, abs=5)
    assert abs(link.error_us(clock, BOOT_US + 180_000_000)) < 300


def test_conversion_goes_both_ways():
    link, clock = Link(4, 80), AutopilotClock(SyncSettings())
    link.run(clock, BOOT_US, 30)
    for boot_us in range(BOOT_US + 20_000_000, BOOT_US + 31_000_000, 777_777):
        steady_us = boot_us + clock.offset_us(boot_us)
        assert clock.boot_us(round(steady_us)) == pytest.approx(boot_us, abs=2)


@given(st.integers(0, 2**31), st.sampled_from([20.0, 100.0]))
@examples(40)
def test_the_stated_doubt_covers_the_error(seed, rate_hz):
    link, clock = Link(seed, 50), AutopilotClock(SyncSettings())
    link.run(clock, BOOT_US, 20, rate_hz)
    assert abs(link.error_us(clock, BOOT_US + 20_000_000)) < 3 * clock.std_s * 1e6
    assert clock.std_s < 0.002


def test_a_few_messages_do_not_settle_it():
    link, clock = Link(), AutopilotClock(SyncSettings())
    link.run(clock, BOOT_US, 0.05)
    assert not clock.settled
    link.run(clock, BOOT_US + 50_000, 0.1)
    assert clock.settled


def test_a_reboot_is_noticed_and_learned_anew():
    link, clock = Link(5), AutopilotClock(SyncSettings())
    assert link.run(clock, BOOT_US, 5) == []
    gap_us = 4_000_000
    again = Link(6, offset_us=OFFSET_US + BOOT_US + 5_000_000 + gap_us)
    changes = again.run(clock, 0, 3)
    assert [c.change for c in changes] == [ClockChange.REBOOTED]
    assert clock.settled
    assert abs(again.error_us(clock, 3_000_000)) < 600


def test_samples_between_a_reboot_and_its_discovery_are_withheld():
    link, clock = Link(5), AutopilotClock(SyncSettings())
    link.run(clock, BOOT_US, 5)
    offset_us = OFFSET_US + BOOT_US + 6_000_000
    found = [clock.feed(10_000 * k, offset_us + 10_000 * k + 2000) for k in range(8)]
    boots = [a.boot_us for a in found]
    assert boots[:4] == [None] * 4
    assert boots[4:] == [40_000, 50_000, 60_000, 70_000]


def test_the_wrap_of_boot_time_is_no_reboot():
    link, clock = Link(7), AutopilotClock(SyncSettings())
    start_us = WRAP_US - 5_000_000
    changes, boots = [], []
    for k in range(1000):
        boot_us = start_us + 10_000 * k
        arrival = clock.feed(boot_us % WRAP_US, round(link.true_us(boot_us)) + 1500)
        boots.append(arrival.boot_us)
        if arrival.change:
            changes.append(arrival.change)
    assert changes == [ClockChange.WRAPPED]
    assert clock.wraps == 1
    assert all(b - a == 10_000 for a, b in pairwise(boots))


def test_messages_with_and_without_the_wrap_agree():
    """RAW_IMU's 64 bits of microseconds do not wrap where ATTITUDE's 32 bits of milliseconds have."""
    clock = AutopilotClock(SyncSettings())
    for k in range(300):
        boot_us = 3 * WRAP_US + 10_000_000 + 10_000 * k
        first = clock.feed(boot_us % WRAP_US + 500, OFFSET_US + boot_us + 1500, 1000)
        second = clock.feed(boot_us, OFFSET_US + boot_us + 1500)
        assert first.change is second.change is None
        assert first.boot_us == second.boot_us + 500


@pytest.mark.parametrize("seconds", [-3600.0, -1.0, -0.2, 0.2, 1.0, 3600.0])
def test_a_jump_of_the_companion_clock_keeps_the_relation(seconds):
    by_us = round(seconds * 1e6)
    link, clock = Link(8), AutopilotClock(SyncSettings(), lambda jump, _at: abs(jump - by_us) < 50_000)
    link.run(clock, BOOT_US, 5)
    changes = link.run(clock, BOOT_US + 5_000_000, 3, shift_us=by_us)
    assert [c.change for c in changes] == [ClockChange.JUMPED]
    assert changes[0].jump_us == pytest.approx(by_us, abs=1500)
    assert clock.shift_us == changes[0].jump_us
    assert clock.settled
    assert abs(link.error_us(clock, BOOT_US + 8_000_000)) < 1500


@pytest.mark.parametrize("stall_s", [0.3, 1.0, 3.0])
def test_a_stalled_link_is_no_jump(stall_s):
    link, clock = Link(9), AutopilotClock(SyncSettings())
    link.run(clock, BOOT_US, 5)
    link.last_us = round(
        link.true_us(BOOT_US + 5_000_000) + stall_s * 1e6
    )  # what comes now waited until then
    assert link.run(clock, BOOT_US + 5_000_000, stall_s + 2) == []
    assert clock.settled
    assert clock.shift_us == 0
    assert abs(link.error_us(clock, BOOT_US + 7_000_000 + round(stall_s * 1e6))) < 600


def test_late_messages_keep_their_boot_time():
    link, clock = Link(10), AutopilotClock(SyncSettings())
    link.run(clock, BOOT_US, 5)
    boot_us = BOOT_US + 5_000_000
    arrival = clock.feed(boot_us, round(link.true_us(boot_us)) + 400_000)
    assert arrival.boot_us == boot_us
    assert arrival.steady_us is None


def test_a_hole_in_the_telemetry_changes_nothing():
    link, clock = Link(11, 50), AutopilotClock(SyncSettings())
    link.run(clock, BOOT_US, 20)
    assert link.run(clock, BOOT_US + 50_000_000, 2) == []
    assert clock.settled


def test_round_trips_take_the_links_delay_out():
    link, clock = Link(12, jitter_us=(4000, 12_000)), AutopilotClock(SyncSettings())
    for second in range(20):
        start_us = BOOT_US + second * 1_000_000
        link.run(clock, start_us, 1)
        there, back = link.random.uniform(800, 9000), link.random.uniform(800, 9000)
        if second == 10:
            there = back = 800
        sent_us = round(link.true_us(start_us + 999_000) - there)
        back_us = round(link.true_us(start_us + 999_000) + back)
        offset_us = (sent_us + back_us) // 2 - (start_us + 999_000)
        clock.feed_round_trip(start_us + 999_000, back_us, offset_us, back_us - sent_us)
    link.run(clock, BOOT_US + 20_000_000, 2)
    error_us = clock.offset_us(BOOT_US + 22_000_000) - OFFSET_US
    assert abs(error_us) < 300, "the envelope alone would be 4 ms late"
    assert clock.std_s < 0.001


def test_round_trips_that_contradict_the_arrivals_are_not_believed():
    link, clock = Link(13), AutopilotClock(SyncSettings())
    link.run(clock, BOOT_US, 10)
    before = clock.offset_us(BOOT_US + 12_000_000)
    for wrong_us in (20_000, -50_000, 10_000_000):
        clock.feed_round_trip(
            BOOT_US + 10_000_000, OFFSET_US + BOOT_US + 10_000_000, OFFSET_US + wrong_us, 1000
        )
    link.run(clock, BOOT_US + 10_000_000, 2)
    assert clock.offset_us(BOOT_US + 12_000_000) == pytest.approx(before, abs=300)
