"""The verdict of a disc: known answers at both sides of every limit, and unknown input is never landable."""

import math
from dataclasses import replace

import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from landing.ground.map import CELL_M, CELLS, GroundMap
from landing.ground.spots import HAZARD, LANDABLE, UNKNOWN, Disc, Discs, GroundCode, gaps_of, worst
from landing.options import GroundOptions

OPTIONS = GroundOptions()
MIDDLE = CELLS // 2
PART = 32
"""Cells a side that are seen where the whole map would only take longer."""
Array = np.ndarray


def measured(height: Array | float = 0.0, std_m: float = 0.005) -> GroundMap:
    """A map that is known everywhere."""
    ground = GroundMap(OPTIONS, 256.0)
    ground.height[:] = height
    ground.variance[:] = std_m**2
    ground.looks[:] = 3.0
    return ground


def slope(degrees: float, bearing: float = 30.0) -> Array:
    """Heights of a plane (rows, columns)."""
    north, east = np.meshgrid(*[np.arange(CELLS) * CELL_M] * 2, indexing="ij")
    along = north * math.cos(math.radians(bearing)) + east * math.sin(math.radians(bearing))
    return np.asarray(math.tan(math.radians(degrees)) * along)


def middle(ground: GroundMap, tilt_std_deg: float = 0.3, scale_std: float = 0.1) -> Disc:
    """The disc in the middle."""
    return alone(ground, OPTIONS, tilt_std_deg, scale_std)


def alone(
    ground: GroundMap, options: GroundOptions, tilt_std_deg: float = 0.3, scale_std: float = 0.1
) -> Disc:
    """The disc in the middle, computed by itself; a property below says that it is the one of the whole map."""
    only = np.array([MIDDLE * CELLS + MIDDLE])
    return Discs(ground, options, tilt_std_deg, scale_std, only).at(MIDDLE, MIDDLE)


@pytest.mark.parametrize(
    ("degrees", "verdict", "code"),
    [
        (0, LANDABLE, None),
        (8.5, LANDABLE, None),
        (9.8, UNKNOWN, GroundCode.MAY_BE_STEEP),
        (12, HAZARD, GroundCode.STEEP),
        (40, HAZARD, GroundCode.STEEP),
    ],
)
def test_inclination(degrees: float, verdict: str, code: GroundCode | None) -> None:
    disc = middle(measured(slope(degrees)))
    assert disc.verdict == verdict
    assert disc.reasons == (() if code is None else (code,))
    assert disc.inclination_deg == pytest.approx(degrees, abs=0.01)
    assert disc.step_m == pytest.approx(0.0, abs=1e-9)
    assert disc.known == pytest.approx(1.0)


def test_the_error_of_level_counts() -> None:
    assert middle(measured(slope(8.5)), tilt_std_deg=0.3).verdict == LANDABLE
    assert middle(measured(slope(8.5)), tilt_std_deg=1.0).reasons == (GroundCode.MAY_BE_STEEP,)


@pytest.mark.parametrize(
    ("top", "verdict"), [(0.03, LANDABLE), (0.058, UNKNOWN), (0.12, HAZARD), (-0.3, HAZARD)]
)
def test_one_cell_that_stands_out_is_a_step(top: float, verdict: str) -> None:
    ground = measured()
    ground.height[MIDDLE + 3, MIDDLE - 2] = top
    disc = middle(ground)
    assert disc.verdict == verdict
    assert disc.step_m == pytest.approx(abs(top), abs=0.1 * abs(top))


@pytest.mark.parametrize("share", [0.3, 0.7])
def test_a_step_edge_through_the_disc(share: float) -> None:
    height = np.zeros((CELLS, CELLS))
    height[: MIDDLE - 5 + round(10 * share)] = -0.17
    assert middle(measured(height)).verdict == HAZARD


def test_a_step_outside_of_the_disc_does_not_count() -> None:
    ground = measured()
    ground.height[MIDDLE + 7] = 1.0
    assert middle(ground).verdict == LANDABLE


@pytest.mark.parametrize(("side", "verdict"), [(0, LANDABLE), (1, LANDABLE), (2, UNKNOWN), (6, UNKNOWN)])
def test_a_hole_in_what_is_known(side: int, verdict: str) -> None:
    ground = measured()
    ground.looks[MIDDLE : MIDDLE + side, MIDDLE : MIDDLE + side] = 0.0
    disc = middle(ground)
    assert disc.verdict == verdict
    assert disc.reasons == (() if verdict == LANDABLE else (GroundCode.NOT_SEEN,))


@pytest.mark.parametrize(("rows", "verdict"), [(1, LANDABLE), (2, UNKNOWN)])
def test_a_gap_in_what_is_known_counts_by_its_width(rows: int, verdict: str) -> None:
    ground = measured()
    ground.looks[MIDDLE + 3 : MIDDLE + 3 + rows] = 0.0
    assert middle(ground).verdict == verdict


@pytest.mark.parametrize(("row", "column"), [(4, 0), (-5, 0), (0, 4), (0, -5)])
def test_a_gap_counts_on_every_side_where_it_is(row: int, column: int) -> None:
    ground = measured()
    ground.looks[MIDDLE + row : MIDDLE + row + 2, MIDDLE + column : MIDDLE + column + 2] = 0.0
    assert middle(ground).reasons == (GroundCode.NOT_SEEN,)
    gaps = gaps_of(ground.seen)
    assert gaps[MIDDLE + row : MIDDLE + row + 2, MIDDLE + column : MIDDLE + column + 2].all()
    assert gaps.sum() == 4


@pytest.mark.parametrize(("top", "verdict"), [(0.0, LANDABLE), (0.055, LANDABLE), (0.3, UNKNOWN)])
def test_a_single_look_at_a_part_shows_a_step_and_proves_none(top: float, verdict: str) -> None:
    ground = measured()
    part = slice(MIDDLE + 4, MIDDLE + 6), slice(MIDDLE, MIDDLE + 2)
    ground.looks[part], ground.height[part], ground.variance[part] = 0.4, top, 0.01**2
    disc = middle(ground)
    assert disc.verdict == verdict
    assert disc.reasons == (() if verdict == LANDABLE else (GroundCode.MAY_BE_STEP,))


def test_a_single_look_that_says_little_hides_a_step() -> None:
    ground = measured()
    part = slice(MIDDLE + 3, MIDDLE + 5), slice(MIDDLE, MIDDLE + 2)
    ground.looks[part], ground.variance[part] = 0.4, 0.06**2
    assert middle(ground).reasons == (GroundCode.NOT_SEEN,)


def test_many_small_gaps_are_too_many() -> None:
    ground = measured()
    ground.looks[MIDDLE - 5 : MIDDLE + 6 : 3, MIDDLE - 5 : MIDDLE + 6 : 3] = 0.0
    assert middle(ground).reasons == (GroundCode.NOT_SEEN,)


def test_a_hazard_is_one_though_part_of_the_disc_is_not_seen() -> None:
    ground = measured()
    ground.height[MIDDLE] = 0.4
    ground.looks[:, MIDDLE:] = 0.0
    disc = middle(ground)
    assert disc.verdict == HAZARD
    assert set(disc.reasons) >= {GroundCode.NOT_SEEN, GroundCode.STEP}


@pytest.mark.parametrize("scale_std", [math.nan, math.inf, 0.6])
def test_without_metres_nothing_is_landable(scale_std: float) -> None:
    disc = middle(measured(), scale_std=scale_std)
    assert disc.verdict == UNKNOWN
    assert GroundCode.NO_METRES in disc.reasons
    ground = measured()
    ground.looks[PART:] = 0.0
    discs = Discs(ground, OPTIONS, 0.3, scale_std)
    assert not discs.landable.any()
    assert discs.spots(ground, 0.0) == ()


@pytest.mark.parametrize("place", [(-1, MIDDLE), (MIDDLE, CELLS), (10**9, 0)])
def test_outside_of_the_grid_is_unknown(place: tuple[int, int]) -> None:
    only = np.array([MIDDLE * CELLS + MIDDLE])
    assert Discs(measured(), OPTIONS, 0.3, 0.1, only).at(*place) == Disc(UNKNOWN, (GroundCode.NOT_SEEN,))


@examples(15)
@given(
    array=st.sampled_from(["height", "variance", "looks"]),
    value=st.sampled_from([math.nan, math.inf, -math.inf]),
    row=st.integers(-3, 3),
    column=st.integers(-3, 3),
)
def test_no_number_that_is_none_makes_a_disc_landable(
    array: str, value: float, row: int, column: int
) -> None:
    ground = measured()
    block = slice(MIDDLE + row - 1, MIDDLE + row + 2), slice(MIDDLE + column - 1, MIDDLE + column + 2)
    getattr(ground, array)[block] = value
    disc = middle(ground)
    assert disc.verdict != LANDABLE or (array == "looks" and value == math.inf)


def test_an_unknown_error_of_level_is_not_landable() -> None:
    assert middle(measured(), tilt_std_deg=math.nan).verdict == UNKNOWN


@examples(8)
@given(seed=st.integers(0, 10**6), rough=st.floats(0.0, 0.05), hole=st.floats(0, 0.2))
def test_the_picture_of_all_cells_says_what_each_disc_says(seed: int, rough: float, hole: float) -> None:
    rng = np.random.default_rng(seed)
    ground = measured(rng.normal(0, rough, (CELLS, CELLS)))
    ground.looks[rng.random((CELLS, CELLS)) < hole] = 0.0
    ground.looks[:, PART:] = ground.looks[PART:] = 0.0
    discs = Discs(ground, OPTIONS, 0.3, 0.1)
    landable = discs.landable
    for row, column in rng.integers(0, PART, (12, 2)):
        assert landable[row, column] == (discs.at(row, column).verdict == LANDABLE)
        only = Discs(ground, OPTIONS, 0.3, 0.1, np.array([row * CELLS + column]))
        assert only.at(row, column).verdict == discs.at(row, column).verdict


def test_spots_keep_away_from_hazards_and_from_the_unknown() -> None:
    ground = measured()
    ground.height[:, : MIDDLE + 2] = 0.5 * np.arange(CELLS)[:, None]
    ground.looks[:, MIDDLE + 40 :] = 0.0
    spots = Discs(ground, OPTIONS, 0.3, 0.1).spots(ground, 0.0)
    assert spots
    for spot in spots:
        assert 0.2 + spot.radius_m <= spot.east_m <= 4.0 - spot.radius_m + CELL_M
        assert spot.clearance_m > 2 * CELL_M
    assert spots[0].east_m > 0.9
    apart = [math.dist((a.north_m, a.east_m), (b.north_m, b.east_m)) for a in spots for b in spots if a != b]
    assert min(apart) >= 2 * OPTIONS.landing_radius_m
    nearer = Discs(ground, OPTIONS, 0.3, 0.1).spots(ground, 0.3)
    assert all(spot.east_m >= 0.2 + spot.radius_m + 0.5 for spot in nearer)


def test_in_wind_spots_keep_farther_from_a_hazard_downwind() -> None:
    ground = measured()
    steep = 0.5 * np.arange(CELLS)[:, None]
    for hazard in (slice(0, MIDDLE - 14), slice(MIDDLE + 15, CELLS)):
        ground.height[hazard] = steep[hazard]
    discs = Discs(ground, OPTIONS, 0.3, 0.1)
    calm, *_ = discs.spots(ground, 0.0)
    assert calm.north_m == pytest.approx(0.0, abs=CELL_M)
    for wind in (1.0, -1.0):
        blown, *_ = discs.spots(ground, 0.0, (0.4 * wind, 0.0))
        assert blown.north_m == pytest.approx(calm.north_m - 0.2 * wind, abs=CELL_M)
        assert blown.clearance_m < calm.clearance_m


def test_the_way_to_the_stopping_point_is_as_good_as_its_worst_disc() -> None:
    ground = measured()
    ground.height[MIDDLE + 15 :] = -3.0
    discs = Discs(ground, OPTIONS, 0.3, 0.1)
    assert discs.along(ground, np.array([(0.0, 0.0), (0.5, 0.0)])).verdict == LANDABLE
    assert discs.along(ground, np.array([(0.0, 0.0), (1.2, 0.0)])).verdict == HAZARD
    assert discs.along(ground, np.array([(0.0, 0.0), (9.0, 0.0)])).verdict == UNKNOWN
    assert discs.along(ground, np.empty((0, 2))).verdict == UNKNOWN


def test_the_worst_of_discs() -> None:
    good, bad, unseen = Disc(LANDABLE, ()), Disc(HAZARD, (GroundCode.STEP,)), Disc(UNKNOWN, ())
    assert worst([good, unseen, bad]) is bad
    assert worst([good, unseen]) is unseen
    assert worst([]).verdict == UNKNOWN


def test_a_larger_vehicle_needs_more_ground() -> None:
    ground = measured()
    ground.height[MIDDLE + 8] = 0.5
    assert middle(ground).verdict == LANDABLE
    wide = replace(OPTIONS, landing_radius_m=0.9)
    assert alone(ground, wide).verdict == HAZARD
    tall = replace(OPTIONS, max_step_m=0.5, landing_radius_m=0.9)
    assert alone(ground, tall).verdict != HAZARD
