"""The height of two sources: each alone, both fused, their disagreement, and the ray of a tilted camera."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from landing.plane.height import along_axis, of_sources
from landing.rotations import exp_so3
from landing.vision.camera import DOWN

NONE = (math.nan, math.nan)
metres = st.floats(0.3, 60)
share = st.floats(0.01, 0.5)


def test_each_alone_and_none() -> None:
    assert of_sources(NONE, NONE, 1.0).source == ""
    assert math.isnan(of_sources(NONE, NONE, 1.0).value_m)
    alone = of_sources((4.0, 0.4), NONE, 1.0)
    assert (alone.value_m, alone.std_m, alone.source) == (4.0, 0.4, "velocity")
    alone = of_sources(NONE, (4.0, 0.1), 0.0)
    assert (alone.value_m, alone.std_m, alone.source) == (4.0, 0.1, "rangefinder")
    assert math.isnan(alone.chi2)


@pytest.mark.parametrize("bad", [NONE, (4.0, math.nan), (math.nan, 0.1), (-1.0, 0.1), (0.0, 0.1), (4.0, 0.0)])
def test_what_is_no_measurement_is_left_out(bad: tuple[float, float]) -> None:
    assert of_sources(bad, (3.0, 0.1), 1.0).source == "rangefinder"
    assert of_sources((3.0, 0.1), bad, 1.0).source == "velocity"


@given(metres, share, metres, share)
def test_both_lie_between_and_are_better_than_either(a: float, sa: float, b: float, sb: float) -> None:
    found = of_sources((a, a * sa), (b, b * sb), 1.0)
    assert found.source == "both"
    assert min(a, b) * (1 - 1e-9) <= found.value_m <= max(a, b) * (1 + 1e-9)
    assert found.std_m / found.value_m <= min(sa, sb) * (1 + 1e-9)


def test_only_a_difference_beyond_all_errors_is_one() -> None:
    for velocity_m in (3.4, 4.0, 4.6):
        assert of_sources((velocity_m, 0.4), (4.0, 0.2), 2.0).chi2 < 2
    assert of_sources((1.0, 0.1), (4.0, 0.2), 2.0).chi2 > 20
    # a drift of the autopilot's velocity explains much of it while the vehicle is slow
    assert of_sources((1.0, 0.1), (4.0, 0.2), 0.2).chi2 < 1


@pytest.mark.parametrize("tilt", [(0.0, 0.0, 0.0), (0.2, 0.0, 0.0), (-0.1, 0.15, 0.3)])
def test_the_ray_meets_the_plane_where_the_rangefinder_measured(tilt: tuple[float, float, float]) -> None:
    """Known answer: a point on the plane n . X = h along the body's z axis, however the camera is mounted."""
    body_from_camera = exp_so3(np.array(tilt)) @ DOWN
    normal, height_m = np.array((-0.1, 0.05, 1.0)), 3.0
    down = body_from_camera[2]
    range_m = height_m / float(normal @ down)
    value, std = along_axis(range_m, 0.02, down, normal)
    assert value == pytest.approx(height_m)
    assert std > 0.05 * value


@pytest.mark.parametrize("range_m", [math.nan, 0.0, -1.0])
def test_no_range_no_height(range_m: float) -> None:
    assert all(map(math.isnan, along_axis(range_m, 0.02, np.array((0, 0, 1.0)), np.array((0, 0, 1.0)))))
    assert all(map(math.isnan, along_axis(3.0, math.nan, np.array((0, 0, 1.0)), np.array((0, 0, 1.0)))))
    assert all(map(math.isnan, along_axis(3.0, 0.1, np.array((0, 0, -1.0)), np.array((0, 0, 1.0)))))
