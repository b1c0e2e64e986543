"""The minimum of a search over shifts, its uncertainty, and costs that a bad pair does not move."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.clocks.lag import jackknife, minimum, robust_costs


@given(st.floats(-0.24, 0.24), st.floats(0.1, 10))
def test_the_minimum_of_a_parabola_is_found_between_the_samples(place, bend):
    shifts = np.arange(-0.25, 0.2501, 0.004)
    found, at_edge = minimum(shifts, bend * (shifts - place) ** 2)
    assert found == pytest.approx(place, abs=1e-9)
    assert not at_edge


def test_a_minimum_at_the_edge_is_none():
    shifts = np.arange(5.0)
    assert minimum(shifts, shifts)[1]
    assert minimum(shifts, -shifts)[1]


def test_the_jackknife_gives_the_spread_that_repetition_shows():
    """Many made-up measurements of an offset of zero: their spread is what the jackknife of each one claims."""
    random = np.random.default_rng(4)
    shifts = np.arange(-20, 21) * 0.5
    claims, results = [], []
    for _ in range(200):
        terms = (shifts[:, None] - random.normal(0, 3, 120)[None, :]) ** 2
        offset, _ = minimum(shifts, terms.sum(axis=1))
        results.append(offset)
        claims.append(jackknife(shifts, terms, offset, 12))
    assert np.mean(claims) == pytest.approx(np.std(results), rel=0.2)


def test_a_few_bad_pairs_do_not_move_the_minimum():
    random = np.random.default_rng(5)
    slopes = random.normal(0, 1, (60, 3))
    wrong = np.where(np.arange(60)[:, None] < 12, 50.0, 0.0)
    shifts = np.arange(-25, 26) * 0.01
    errors = lambda shift: slopes * (shift - 0.03) + wrong + random.normal(0, 1e-3, (60, 3))  # noqa: E731
    costs = robust_costs(errors, np.tile(np.eye(3), (60, 1, 1)), shifts)
    assert minimum(shifts, costs.sum(axis=1))[0] == pytest.approx(0.03, abs=2e-3)
