"""The delay of an autopilot's rates: known answers, and what no noise or nonsense makes of it."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from companion.clocks.rate_delay import FIRST_S, RateDelay

NOISE_RAD = 2e-4
vectors = st.lists(st.floats(-50, 50), min_size=3, max_size=3).map(np.array)


def test_without_a_turn_the_first_belief_stays():
    delay = RateDelay(NOISE_RAD)
    for k in range(300):
        delay.saw(k * 33_000, np.full(3, 1e-4), np.zeros(3))
    assert delay.s == FIRST_S


def test_the_delay_is_found_through_the_noise_of_the_attitudes():
    rng, delay = np.random.default_rng(1), RateDelay(NOISE_RAD)
    for k in range(300):
        change = rng.normal(0, 0.05, 3)
        turned = 0.013 * change + rng.normal(0, NOISE_RAD * math.sqrt(2), 3)
        turned[2] += 0.01
        delay.saw(k * 33_000, turned, change)
    assert abs(delay.s - 0.013) < 0.001


def test_another_autopilot_filter_is_learnt_after_the_first():
    delay = RateDelay(NOISE_RAD)
    for k in range(6000):
        change = np.full(3, 0.1 if k % 2 else -0.1)
        delay.saw(k * 33_000, (0.004 if k < 1000 else 0.015) * change, change)
    assert abs(delay.s - 0.015) < 0.001


def test_a_moment_that_was_seen_counts_once():
    delay = RateDelay(NOISE_RAD)
    delay.saw(1_000_000, np.full(3, 0.002), np.full(3, 0.1))
    once = delay.s
    delay.saw(1_000_000, np.full(3, 0.002), np.full(3, 0.1))
    delay.saw(900_000, np.full(3, 0.009), np.full(3, 0.1))
    assert delay.s == once


def test_what_is_no_number_is_left_out():
    delay = RateDelay(NOISE_RAD)
    delay.saw(1_000_000, np.full(3, 0.002), np.full(3, 0.1))
    once = delay.s
    delay.saw(2_000_000, np.array((math.nan, 0.0, 0.0)), np.full(3, 0.1))
    delay.saw(3_000_000, np.zeros(3), np.array((0.0, math.inf, 0.0)))
    assert delay.s == once


@given(st.lists(st.tuples(vectors, vectors), max_size=20))
def test_it_stays_a_delay_that_a_filter_in_flight_can_have(spans):
    delay = RateDelay(NOISE_RAD)
    for k, (turned, change) in enumerate(spans):
        delay.saw(k * 33_000, turned, change)
        assert 0 <= delay.s <= 0.05
