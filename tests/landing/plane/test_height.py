"""Height from velocity and ventral flow: both have errors, on every axis."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from landing.plane.height import BetterHeight, height

component = st.floats(-3, 3)


@given(component, component, component, st.floats(0.3, 30))
def test_without_errors_it_is_exact(x: float, y: float, z: float, height_m: float):
    velocity = np.array((x, y, z))
    if np.linalg.norm(velocity) < 0.01:
        return
    found, std = height(velocity, 0.0, velocity / height_m, np.zeros(3), 0.6)
    assert found == pytest.approx(height_m, rel=1e-6)
    assert std < 1e-3


def test_a_wrong_climb_rate_does_not_outweigh_the_way_across():
    """Ventral flow along the axis is the surest of the three; the velocity along it may be the worst."""
    velocity, omega = np.array((0.6, 0.0, 0.18)), np.array((0.2, 0.0, 0.0))
    found, std = height(velocity, 0.2, omega, np.array((0.01, 0.01, 0.001)), 0.6)
    assert found == pytest.approx(3.0, abs=std)


def test_the_uncertainty_is_that_of_the_errors():
    rng = np.random.default_rng(1)
    true, omega_std = np.array((0.8, -0.5, 0.3)), np.array((0.01, 0.02, 0.005))
    normalised = []
    for _ in range(400):
        reported = true + 0.05 * rng.standard_normal(3)
        seen = true / 2.0 + omega_std * rng.standard_normal(3)
        found, std = height(reported, 0.05, seen, omega_std, 0.6)
        normalised.append((found - 2.0) / std)
    assert np.std(normalised) == pytest.approx(1, abs=0.15)


@pytest.mark.parametrize(
    ("velocity", "omega"),
    [
        ((0.0, 0.0, 0.0), (0.1, 0.0, 0.0)),
        ((0.5, 0.0, 0.0), (-0.1, 0.0, 0.0)),
        ((0.1, 0.0, 0.0), (0.05, 0.0, 0.0)),
        ((0.5, 0.0, 0.0), (math.nan, 0.0, 0.0)),
    ],
    ids=["no motion", "the other way", "slower than the velocity's error", "no flow"],
)
def test_what_does_not_tell_the_height_gives_none(velocity: tuple, omega: tuple):
    found = height(np.array(velocity), 0.2, np.array(omega), np.full(3, 0.01), 0.6)
    assert all(math.isnan(f) for f in found)


UNKNOWN = (math.nan, math.nan)


def test_a_vehicle_that_creeps_keeps_the_height_that_its_braking_told():
    better = BetterHeight(0.45)
    assert better.step((3.1, 0.9), UNKNOWN) == (3.1, 0.9)
    assert better.step((3.1, 0.9), (2.9, 0.4)) == (3.1, 0.9)
    assert better.step((8.9, 4.1), (2.9, 0.4)) == (2.9, 0.4)
    assert better.step((8.9, 4.1), (2.9, 1.5)) == (8.9, 4.1)
    assert better.step(UNKNOWN, (2.9, 0.4)) == (2.9, 0.4)


def test_a_line_counts_only_with_a_velocity_that_was_once_large_beside_its_error():
    better = BetterHeight(0.45)
    for ratio in (UNKNOWN, (1.0, 0.5)):
        assert better.step(ratio, (0.9, 0.05)) == pytest.approx(ratio, nan_ok=True)
    assert better.step((9.0, 3.0), (8.8, 1.0)) == (9.0, 3.0)
    assert better.step(UNKNOWN, (8.8, 1.0)) == (8.8, 1.0)
    # another ground: the line has to be found anew
    assert better.step(UNKNOWN, UNKNOWN) == pytest.approx(UNKNOWN, nan_ok=True)
    assert better.step(UNKNOWN, (0.9, 0.05)) == pytest.approx(UNKNOWN, nan_ok=True)
    better.step((9.0, 3.0), (8.8, 1.0))
    better.forget()
    assert better.step(UNKNOWN, (8.8, 1.0)) == pytest.approx(UNKNOWN, nan_ok=True)
