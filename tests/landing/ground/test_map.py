"""The map: looks fall into the same cells wherever the vehicle is, agree or begin anew, and fade."""

import math
from dataclasses import replace

import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from landing.ground.map import CELL_M, CELLS, GroundMap
from landing.ground.relief import ViewRelief
from landing.ground.scale import Scale
from landing.options import GroundOptions
from landing.vision.camera import DOWN

FOCAL_PX = 130.0
HEIGHT = 2.0


def look_at(up: float = 0.0, std_m: float = 0.01, moving: bool = False, reach: float = 0.6) -> ViewRelief:
    """Blocks over level ground that lies ``up`` over the plane 2 m below."""
    x, y = (part.ravel() for part in np.meshgrid(*[np.arange(-reach, reach, 0.025)] * 2))
    points = np.column_stack((x, y)) / HEIGHT
    n = len(points)
    depth = np.full(n, 1 - up / HEIGHT)
    return ViewRelief(points, depth, np.full(n, std_m / HEIGHT), np.full(n, moving), np.zeros(n, bool), 1.0)


def looked(ground: GroundMap, relief: ViewRelief, time_s: float, way: tuple[float, float, float]) -> None:
    """One step and a look."""
    ground.move(time_s, np.array(way))
    ground.look(relief, DOWN, HEIGHT)


def test_looks_from_elsewhere_fall_into_the_same_cells() -> None:
    ground = GroundMap(GroundOptions(), FOCAL_PX)
    for k in range(6):
        looked(ground, look_at(), 0.1 * k, (0.1, 0.05, 0.0))
    assert ground.known.sum() > 80
    assert np.abs(ground.height[ground.known] + HEIGHT).max() < 0.01
    assert ground.disputed.max() == 0.0


@examples(25)
@given(north=st.floats(-40, 40), east=st.floats(-40, 40), up=st.floats(-3, 3))
def test_the_map_is_the_same_wherever_it_was_begun(north: float, east: float, up: float) -> None:
    ground = GroundMap(GroundOptions(), FOCAL_PX)
    ground.move(0.0, np.array((north, east, -up)))
    for k in range(3):
        looked(ground, look_at(), 0.1 + 0.1 * k, (0.0, 0.0, 0.0))
    row, column = ground.cell_of(float(ground.place[0]), float(ground.place[1]))
    assert 0 <= row < CELLS
    assert 0 <= column < CELLS
    assert ground.known[row, column]
    assert ground.height[row, column] == pytest.approx(up - HEIGHT, abs=1e-6)


@examples(25)
@given(rows=st.integers(-300, 300), columns=st.integers(-300, 300))
def test_cells_move_with_the_ground_and_what_comes_into_the_grid_is_unknown(rows: int, columns: int) -> None:
    ground = GroundMap(GroundOptions(), FOCAL_PX)
    for k in range(3):
        looked(ground, look_at(), 0.1 * k, (0.0, 0.0, 0.0))
    before = ground.known.sum()
    ground.move(0.4, np.array((rows * CELL_M, columns * CELL_M, 0.0)))
    inside = max(abs(rows), abs(columns)) + 8 < CELLS // 2
    if inside:
        assert ground.known.sum() == before
        assert ground.known[ground.cell_of(0.01, 0.01)]
    elif max(abs(rows), abs(columns)) - 8 > CELLS // 2 + 1:
        assert not ground.known.any()


@pytest.mark.parametrize(("every", "known"), [(2, True), (3, True), (8, False)])
def test_a_cell_that_is_bare_in_most_looks_is_unknown(every: int, known: bool) -> None:
    ground = GroundMap(GroundOptions(memory_s=1e9), FOCAL_PX)
    measured = look_at()
    strip = np.abs(measured.points[:, 0] * HEIGHT) < 0.2
    bare = replace(measured, depth=np.where(strip, math.nan, measured.depth), bare=strip)
    for k in range(24):
        looked(ground, bare if k % every else measured, 0.1 * k, (0.0, 0.0, 0.0))
    assert ground.looks[ground.cell_of(0.05, 0.05)] >= GroundOptions().min_looks
    assert ground.known[ground.cell_of(0.05, 0.05)] == known
    assert ground.known[ground.cell_of(0.05, 0.45)]


def test_one_look_is_not_enough_and_old_looks_fade() -> None:
    ground = GroundMap(GroundOptions(), FOCAL_PX)
    half = look_at()
    half = replace(half, fresh=0.5)
    looked(ground, half, 0.0, (0.0, 0.0, 0.0))
    assert not ground.known.any()
    looked(ground, half, 0.1, (0.0, 0.0, 0.0))
    assert ground.known.any()
    ground.move(GroundOptions().memory_s * 2, np.zeros(3))
    assert not ground.known.any()


def test_a_look_that_differs_begins_the_cell_anew() -> None:
    ground = GroundMap(GroundOptions(), FOCAL_PX)
    for k in range(4):
        looked(ground, look_at(), 0.1 * k, (0.0, 0.0, 0.0))
    # somebody walks into a part of it: the rest keeps the level
    box = look_at(reach=0.6)
    near = np.abs(box.points).max(axis=1) * HEIGHT < 0.2
    box.depth[near] = 1 - 0.4 / HEIGHT
    box = replace(box, fresh=0.5)
    looked(ground, box, 0.5, (0.0, 0.0, 0.0))
    middle = ground.cell_of(0.01, 0.01)
    assert not ground.known[middle]
    assert ground.disputed[middle] > 0
    looked(ground, box, 0.6, (0.0, 0.0, 0.0))
    assert ground.known[middle]
    assert ground.height[middle] == pytest.approx(0.4 - HEIGHT, abs=0.01)


def test_looks_that_differ_by_what_the_vehicle_can_stand_on_agree_with_a_doubt() -> None:
    ground = GroundMap(GroundOptions(), FOCAL_PX)
    for k in range(4):
        looked(ground, look_at(std_m=0.003), 0.1 * k, (0.0, 0.0, 0.0))
    other = look_at(std_m=0.003)
    near = np.abs(other.points).max(axis=1) * HEIGHT < 0.2
    other.depth[near] = 1 - 0.04 / HEIGHT
    looked(ground, other, 0.5, (0.0, 0.0, 0.0))
    middle = ground.cell_of(0.01, 0.01)
    assert ground.known[middle]
    assert ground.disputed[middle] == 0
    # both heights lie within a standard deviation
    assert ground.height[middle] == pytest.approx(0.02 - HEIGHT, abs=0.002)
    assert math.sqrt(ground.variance[middle]) == pytest.approx(0.02, abs=0.002)


def test_a_single_look_is_seen_and_not_known() -> None:
    ground = GroundMap(GroundOptions(), FOCAL_PX)
    half = look_at()
    looked(ground, replace(half, fresh=0.4), 0.0, (0.0, 0.0, 0.0))
    middle = ground.cell_of(0.01, 0.01)
    assert ground.seen[middle]
    assert not ground.known[middle]
    ground.forget()
    assert not ground.seen.any()


def test_what_moves_makes_the_ground_under_it_unknown() -> None:
    ground = GroundMap(GroundOptions(), FOCAL_PX)
    for k in range(4):
        looked(ground, look_at(), 0.1 * k, (0.0, 0.0, 0.0))
    seen = look_at(moving=True, reach=0.2)
    nothing = replace(seen, depth=seen.depth * math.nan)
    looked(ground, nothing, 0.5, (0.0, 0.0, 0.0))
    assert not ground.known[ground.cell_of(0.01, 0.01)]
    assert ground.known[ground.cell_of(0.45, 0.45)]


def test_errors_of_the_vertical_motion_are_taken_out_by_what_is_seen_again() -> None:
    ground = GroundMap(GroundOptions(), FOCAL_PX)
    for k in range(20):
        # it says that it climbs, and does not
        looked(ground, look_at(), 0.1 * k, (0.02, 0.0, -0.01))
    assert ground.disputed.max() < 0.2
    assert np.ptp(ground.height[ground.known]) < 0.02


@pytest.mark.parametrize("way", [None, np.array((math.nan, 0.0, 0.0)), np.array((0.0, math.inf, 0.0))])
def test_a_place_that_is_lost_forgets_the_map(way: np.ndarray | None) -> None:
    ground = GroundMap(GroundOptions(), FOCAL_PX)
    for k in range(4):
        looked(ground, look_at(), 0.1 * k, (0.0, 0.0, 0.0))
    ground.move(0.5, way)
    assert not ground.known.any()
    assert np.isfinite(ground.place).all()


def test_from_too_far_up_a_block_tells_nothing_of_a_landing_place() -> None:
    ground = GroundMap(GroundOptions(), FOCAL_PX)
    for k in range(4):
        ground.move(0.1 * k, np.zeros(3))
        ground.look(look_at(), DOWN, 25.0)
    assert not ground.known.any()


def test_a_look_with_a_large_error_is_not_known() -> None:
    ground = GroundMap(GroundOptions(), FOCAL_PX)
    for k in range(3):
        looked(ground, look_at(std_m=0.2), 0.1 * k, (0.0, 0.0, 0.0))
    assert not ground.known.any()


def test_the_largest_velocity_of_a_hovering_vehicle_gives_no_metres() -> None:
    """Over ground that moves the view moves, and each velocity is noise: now and then one is far from zero."""
    scale, most = Scale(), GroundOptions().max_scale_std
    for k in range(200):
        speed = 0.65 if k % 50 in (48, 49) else 0.1
        relative = 0.2 / speed
        scale.step(1 / 30, 0.0, 3.0 if relative < 0.6 else math.nan, 3.0 * relative)
        assert scale.relative_std > most
    for _ in range(15):
        scale.step(1 / 30, 0.0, 3.0, 3.0 * 0.2)
    assert scale.relative_std < most
    assert scale.relative_std > 0.2


def test_metres_begun_anew_are_not_told_by_one_measurement() -> None:
    scale, most = Scale(), GroundOptions().max_scale_std
    for _ in range(60):
        scale.step(1 / 30, 0.0, 3.0, 0.3)
    assert scale.relative_std < 0.11
    scale.step(1 / 30, 0.0, 9.0, 0.9)
    assert scale.distance_m == pytest.approx(9.0)
    assert scale.relative_std > most
    for _ in range(60):
        scale.step(1 / 30, 0.0, 9.0, 0.9)
    assert scale.relative_std < most


def test_metres_average_noise_but_do_not_claim_to_know_better_than_the_best_measurement() -> None:
    scale = Scale()
    rng = np.random.default_rng(3)
    for _ in range(100):
        scale.step(0.05, 0.0, 2.0 * math.exp(rng.normal(0, 0.05)), 0.4)
    assert scale.distance_m == pytest.approx(2.0, rel=0.05)
    assert scale.relative_std >= 0.15
    known = scale.relative_std
    for _ in range(40):
        scale.step(0.05, 0.25, math.nan, math.nan)
    assert scale.distance_m == pytest.approx(2.0 * math.exp(-0.5), rel=0.05)
    assert scale.relative_std > known
    scale.step(0.05, math.nan, math.nan, math.nan)
    assert math.isnan(scale.distance_m)
    assert scale.relative_std == math.inf
