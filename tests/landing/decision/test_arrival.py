"""Where the vehicle is against the chosen place, and how it looks about: known answers, each rule by itself."""

import math

import pytest

from landing.decision.arrival import beside, over, sink_share, slow
from landing.decision.looking import Looking, lowest_look, new_spiral
from landing.decision.orders import STILL, Inputs
from landing.decision.procedure_options import (
    ARM_SHARE,
    ARRIVED_M,
    CLIMB_SPEED,
    HANDED_OVER_M,
    LOOK_LOWER_S,
    LOOK_RADIUS_M,
    LOOK_SINK,
    SLOW_M_S,
    UNKNOWN_S,
    UNSURE_S,
    ProcedureOptions,
)
from landing.ground.spots import HAZARD, LANDABLE, UNKNOWN, Disc

SPOT = (2.0, 1.0, 0.0)
OPTIONS = ProcedureOptions()


def at(north_m: float, east_m: float = 0.0, **changes: object) -> Inputs:
    """A vehicle that far from the spot, at 4 m, at rest."""
    place = (SPOT[0] + north_m, SPOT[1] + east_m, -4.0)
    return Inputs(
        **{"time_s": 0.0, "place_ned": place, "height_m": 4.0, "velocity_ned": STILL, "yaw": 0.0, **changes}
    )


@pytest.mark.parametrize(
    ("velocity", "expected"),
    [(None, False), (STILL, True), ((0.3, 0.4, 0.0), True), ((0.3, 0.41, 0.0), False), ((0.0, 0.0, 3.0), True),
     ((math.nan, 0.0, 0.0), False)],
)  # fmt: skip
def test_slow_is_a_level_speed_that_is_known(velocity, expected):
    assert slow(at(0, velocity_ned=velocity), 0.5) is expected


@pytest.mark.parametrize(
    ("off_m", "velocity", "expected"),
    [(0.0, STILL, True), (HANDED_OVER_M + 0.01, STILL, False), (0.0, None, False),
     (-0.2, (0.2, 0.0, 0.0), True), (0.0, (0.2, 0.0, 0.0), False),
     (-SLOW_M_S - 0.05, (SLOW_M_S + 0.05, 0.0, 0.0), False)],
)  # fmt: skip
def test_over_it_stops_on_the_place_and_is_slow(off_m, velocity, expected):
    assert over(at(off_m, velocity_ned=velocity), SPOT) is expected


@pytest.mark.parametrize(
    ("off_m", "expected"), [(ARRIVED_M + 0.39, False), (ARRIVED_M + 0.41, True), (math.nan, True)]
)
def test_beside_grows_with_the_height_and_what_is_unknown_is_beside(off_m, expected):
    assert beside(at(off_m), SPOT, 0.1) is expected


@pytest.mark.parametrize(
    ("changes", "unsure_s", "low", "share"),
    [
        ({}, 0.0, 1.2, 1.0),
        ({}, UNSURE_S, 1.2, 1.0),
        ({}, (UNSURE_S + UNKNOWN_S) / 2, 1.2, 0.5),
        ({}, UNKNOWN_S, 1.2, 0.0),
        ({}, 0.0, 0.97, 0.0),
        ({}, 0.0, 1.01, 0.5),
        # a hazard that rises to the height of the hand-over, one that does not, one of unknown height, and no hazard
        ({"below": Disc(HAZARD, (), step_m=1.0)}, 0.0, 1.2, 0.0),
        ({"below": Disc(HAZARD, (), step_m=0.1)}, 0.0, 1.2, 1.0),
        ({"below": Disc(HAZARD, ())}, 0.0, 1.2, 0.0),
        ({"below": Disc(LANDABLE, (), step_m=1.0)}, 0.0, 1.2, 1.0),
        ({"below": Disc(UNKNOWN, (), step_m=1.0)}, 0.0, 1.2, 1.0),
    ],
)
def test_how_much_it_sinks(changes, unsure_s, low, share):
    assert sink_share(at(0, **changes), SPOT, unsure_s, low) == pytest.approx(share)
    assert sink_share(at(3.0, **changes), SPOT, unsure_s, low) == 0.0, "far beside the place"


def looking(side: float = 1.0) -> Looking:
    found = Looking(OPTIONS)
    found.begin((0.0, 0.0, 0.0))
    if side < 0:
        turned = found.sideways(plain(LOOK_RADIUS_M + 0.1), STILL, 0.5)
        assert turned[1] == pytest.approx(-0.5)
    return found


def plain(east_m: float, **changes: object) -> Inputs:
    return Inputs(
        **{"time_s": 0.0, "place_ned": (0.0, east_m, -4.0), "velocity_ned": STILL, "yaw": 0.0, **changes}
    )


@pytest.mark.parametrize(
    ("yaw", "north", "east"), [(0.0, 0.0, 0.5), (math.pi / 2, -0.5, 0.0), (math.nan, 0.0, 0.5)]
)
def test_it_looks_to_its_right_first_and_without_a_heading_to_the_east(yaw, north, east):
    assert looking().sideways(plain(0, yaw=yaw), STILL, 0.5) == pytest.approx((north, east))


def test_it_turns_where_it_could_no_longer_stop_within_the_radius():
    assert looking().sideways(plain(LOOK_RADIUS_M - 0.1), STILL, 0.5)[1] > 0
    assert looking().sideways(plain(LOOK_RADIUS_M - 0.1, velocity_ned=(0, 1.0, 0)), STILL, 0.5)[1] < 0
    assert looking().sideways(plain(LOOK_RADIUS_M - 0.1, velocity_ned=(0, -1.0, 0)), STILL, 0.5)[1] > 0
    assert looking().sideways(plain(LOOK_RADIUS_M + 0.1, velocity_ned=None), STILL, 0.5)[1] < 0
    assert looking(-1.0).sideways(plain(-LOOK_RADIUS_M - 0.1), STILL, 0.5)[1] > 0


def test_at_the_reach_of_the_search_it_turns_back_and_never_outwards():
    far_m = OPTIONS.max_search_m
    assert looking().sideways(plain(0), (0.0, -far_m, 0.0), 0.5)[1] < 0, "outwards lies to the east"
    assert looking().sideways(plain(0), (0.0, far_m, 0.0), 0.5)[1] > 0, "inwards lies to the east"


def test_it_comes_lower_after_a_while_and_not_below_a_height():
    lowest = lowest_look(OPTIONS)
    assert looking().lower(lowest + 1, LOOK_LOWER_S - 0.1) == 0.0
    assert looking().lower(lowest + 1, LOOK_LOWER_S) == pytest.approx(
        min(LOOK_SINK * (lowest + 1), CLIMB_SPEED)
    )
    assert looking().lower(100.0, LOOK_LOWER_S) == CLIMB_SPEED
    assert looking().lower(lowest, LOOK_LOWER_S) == 0.0
    assert looking().lower(math.nan, LOOK_LOWER_S) == 0.0


@pytest.mark.parametrize(
    ("height_m", "arm_m"), [(4.0, 4.0 * ARM_SHARE), (0.2, 0.5 * ARM_SHARE), (math.nan, LOOK_RADIUS_M)]
)
def test_a_spiral_has_arms_as_near_as_the_view_needs_and_begins_where_the_autopilot_was(height_m, arm_m):
    begin = Inputs(time_s=0.0, place_ned=(0.0, 0.0, -4.0), local_ned=(3.0, 1.0, -9.0))
    spiral = new_spiral(begin, height_m, 2.0)
    reached = []
    for k in range(1, 4000):
        spiral.go_on(2.0 + 0.02 * k, 1.0, 0.0)
        reached.append(spiral.radius_m)
        assert math.dist(spiral.point[:2], (3.0, 1.0)) == pytest.approx(spiral.radius_m)
        angle = math.atan2(spiral.point[1] - 1.0, spiral.point[0] - 3.0) % (2 * math.pi)
        turns = spiral.radius_m / arm_m
        assert turns % 1 == pytest.approx(angle / (2 * math.pi), abs=1e-6)
        if reached[-1] > 2.5 * arm_m:
            return
    raise AssertionError("it never came so far")
