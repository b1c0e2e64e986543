"""The rangefinder at an exposure: between its samples, not beyond their age, and never where it measured nothing."""

import pytest

from companion.core.rangefinder import ASSUMED_SHARE, ASSUMED_STD_M, MAX_AGE_US, Rangefinder
from drivers.samples import Distance


def sample(boot_us: int, metres: float | None, std_m: float | None = 0.05) -> Distance:
    return Distance(boot_us + 5_000, boot_us, metres, std_m, 0.1, 40.0)


def finder(*samples: Distance) -> Rangefinder:
    found = Rangefinder()
    for one in samples:
        found.feed(one)
    return found


def test_between_two_samples_on_the_line() -> None:
    both = finder(sample(1_000_000, 4.0), sample(1_100_000, 3.8))
    assert both.at(1_050_000) == (pytest.approx(3.9), 0.05)
    assert both.at(1_100_000) == (pytest.approx(3.8), 0.05)
    assert both.at(1_130_000) == (pytest.approx(3.8), 0.05)
    assert both.at(990_000) == (pytest.approx(4.0), 0.05)


def test_a_stale_one_is_none() -> None:
    assert finder().at(0) is None
    old = finder(sample(1_000_000, 4.0))
    assert old.at(1_000_000 + MAX_AGE_US) is not None
    assert old.at(1_000_001 + MAX_AGE_US) is None
    old.forget()
    assert old.at(1_000_000) is None


def test_nothing_in_reach_is_none_on_either_side() -> None:
    assert finder(sample(1_000_000, 4.0), sample(1_100_000, None)).at(1_050_000) is None
    assert finder(sample(1_000_000, None), sample(1_100_000, 4.0)).at(1_050_000) is None
    assert finder(sample(1_000_000, None)).at(1_000_000) is None


def test_without_a_covariance_an_error_is_assumed() -> None:
    found = finder(sample(1_000_000, 10.0, None)).at(1_000_000)
    assert found == (10.0, pytest.approx(ASSUMED_STD_M + 10 * ASSUMED_SHARE))


def test_boot_times_that_wrapped_are_of_the_same_moment() -> None:
    wrap_us = 2**32 * 1000
    assert finder(sample(500_000, 4.0)).at(wrap_us + 510_000) is not None
    assert finder(sample(wrap_us - 10_000, 4.0)).at(wrap_us + 10_000) is not None
