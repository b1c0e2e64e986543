"""The soak's own arithmetic: growth with its uncertainty, and who is away when."""

import numpy as np
import pytest
from soak import AWAY, away, slope


def test_growth_and_its_uncertainty_are_those_of_the_samples():
    times = np.arange(600.0)
    noise = np.random.default_rng(3).normal(0, 0.1, times.size)
    found = slope(times, 100 + 2.0 * times / 3600 + noise)
    assert found.per_hour == pytest.approx(2.0, abs=3 * found.std)
    assert 0.02 < found.std < 0.3
    assert (found.first, found.last) == pytest.approx((100.0, 100.33), abs=0.05)
    assert slope(times, np.full(600, 126.0)).per_hour == pytest.approx(0.0, abs=1e-9)


def test_too_few_samples_have_no_slope():
    with pytest.raises(ValueError, match="at least 20"):
        slope(np.arange(19.0), np.arange(19.0))


def test_each_is_away_once_a_cycle_and_alone():
    seen = [away(share) for share in np.linspace(0, 1, 200, endpoint=False)]
    assert {name for gone in seen for name in gone} == set(AWAY)
    assert max(map(len, seen)) == 1
    assert away(0.0) == frozenset(), "everybody is there at the start"
