"""The procedure over ground that rises, moves, or is not known, and at its fence."""

import math
from dataclasses import replace

import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from procedure_flight import DT, HERE, OPTIONS, Flight

from landing.decision.at_rest import MOVES_AFTER_REST_S, MOVES_S
from landing.decision.choice import Choice
from landing.decision.fence import Fence
from landing.decision.guidance import ACCELERATION
from landing.decision.headroom import SURE_S, Headroom, level_share
from landing.decision.looking import lowest_look
from landing.decision.orders import GroundMotion, Inputs, OrderKind, State, Why
from landing.decision.procedure_options import FENCE_MARGIN_M, LIMIT_S, LOST_S, SEARCH_LOWER
from landing.ground.spots import LANDABLE, UNKNOWN, Disc

LEAST = lowest_look(OPTIONS)
WIDE = replace(OPTIONS, max_search_m=4.0)


def searching() -> Flight:
    flight = Flight(spot=None, options=WIDE)
    flight.until(State.SEARCH)
    for _ in range(int(2 / DT)):
        flight.step()
    return flight


def test_ground_that_rises_near_the_vehicle_stops_a_search_and_is_climbed_over():
    flight = searching()
    for _ in range(int(1.5 / DT)):
        step = flight.step(clear_m=0.3)
    north, east, down = step.order.velocity_ned
    assert step.state is State.SEARCH
    assert math.hypot(north, east) < 0.01
    assert down == pytest.approx(-0.5)
    step = flight.step()
    assert step.order.velocity_ned[2] < 0 or step.state is State.SEARCH


def test_a_search_from_lower_down_stays_above_the_highest_ground_that_it_flew_across():
    flight = searching()
    for _ in range(int(2 / DT)):
        flight.step(clear_m=-flight.place[2] - 1.2)  # a roof of 1.2 m
    lowest = math.inf
    while flight.step().state is State.SEARCH:
        lowest = min(lowest, -flight.place[2])
    assert flight.machine.why is Why.SEARCHED_IN_VAIN
    assert lowest > 1.2 + 0.9 * LEAST
    free = searching()
    while free.step().state is State.SEARCH:
        lowest = min(lowest, -free.place[2])
    assert lowest == pytest.approx(max(LEAST, SEARCH_LOWER * 4.0), abs=0.1)


@pytest.mark.parametrize("state", [State.SEARCH, State.GO])
def test_without_a_height_nothing_is_flown_across_the_ground(state):
    flight = Flight(spot=(2.5, 1.0) if state is State.GO else None, options=WIDE)
    flight.until(state)
    begun_s, height = flight.time_s, -flight.place[2]
    step = flight.until(State.HOLD, 3.0, height_m=math.nan)
    assert step.why is Why.HEIGHT_LOST
    assert flight.time_s - begun_s == pytest.approx(LOST_S, abs=2 * DT)
    flight.until(State.LOOK, height_m=math.nan)
    assert -flight.place[2] > height + 0.8


def test_a_single_wrong_height_is_not_taken_for_a_roof():
    room = Headroom()
    room.begin(0.0)
    at = {"local_ned": (0.0, 0.0, -6.0), "place_ned": (0.0, 0.0, -6.0)}
    for k in range(40):
        room.step(Inputs(time_s=k * DT, height_m=1.0 if k % 9 == 5 else 6.0, **at))
    assert room.all_around(Inputs(time_s=2.0, height_m=6.0, **at)) == pytest.approx(6.0)
    for k in range(40, 40 + math.ceil(SURE_S / DT) + 2):
        room.step(Inputs(time_s=k * DT, height_m=2.0, **at))
    assert room.all_around(Inputs(time_s=5.0, height_m=6.0, **at)) == pytest.approx(2.0)
    assert math.isnan(room.all_around(Inputs(time_s=5.0, **at)))


def test_the_share_of_a_level_speed():
    assert level_share(5.0, 2.0) == 1.0
    assert level_share(1.5, 2.0) == 0.0
    assert level_share(math.nan, 2.0) == 0.0


def test_ground_that_moves_plainly_is_refused_with_its_own_reason():
    flight = Flight()
    flight.now["ground_motion"] = GroundMotion.MOVES
    flight.until(State.LOOK)
    step = flight.until(State.GIVE_BACK, MOVES_S + 0.5)
    assert (step.why, step.order.kind) == (Why.GROUND_MOVES, OrderKind.STOP)
    rested = Flight()
    rested.until(State.GO)
    rested.until(State.GIVE_BACK, MOVES_AFTER_REST_S + 0.5, ground_motion=GroundMotion.MOVES)
    assert rested.machine.why is Why.GROUND_MOVES


def test_over_ground_that_is_not_known_to_be_at_rest_it_does_not_come_down():
    flight = Flight()
    seen = set()
    while flight.machine.state is not State.GIVE_BACK:
        step = flight.step(ground_motion=GroundMotion.UNKNOWN)
        seen.add(step.state)
        assert flight.time_s < LIMIT_S[State.LOOK] + LIMIT_S[State.GO] + 5
    assert State.DESCEND not in seen
    assert step.why is Why.GROUND_MAY_MOVE


@examples(60)
@given(
    st.floats(0, 2 * math.pi),
    st.floats(0.2, 1.5),
    st.floats(-1.5, 1.5),
    st.booleans(),
)
def test_no_velocity_leads_out_of_the_fence(bearing, speed, error_m, by_view):
    """Flown as asked, whichever of view and autopilot is right, and with what was asked limited as it is."""
    place = [0.0, 0.0, -4.0]
    begin = Inputs(time_s=0.0, place_ned=(0.0, 0.0, -4.0), local_ned=(0.0, 0.0, -4.0))
    fence = Fence(WIDE, begin)
    velocity = [0.0, 0.0]
    for k in range(400):
        here, other = tuple(place), (place[0] + error_m * k / 400, place[1], place[2])
        i = Inputs(
            time_s=k * DT,
            place_ned=here if by_view else other,
            local_ned=other if by_view else here,
            below=Disc(LANDABLE if k % 2 else UNKNOWN, ()),
            height_m=4.0,
        )
        asked = fence.held_in(i, (speed * math.cos(bearing), speed * math.sin(bearing), 0.0))
        for axis in (0, 1):
            change = ACCELERATION * DT
            velocity[axis] += min(max(asked[axis] - velocity[axis], -change), change)
            place[axis] += velocity[axis] * DT
        assert math.hypot(*place[:2]) < WIDE.max_search_m + FENCE_MARGIN_M
        assert fence.against(i, State.SEARCH) is None


@pytest.mark.parametrize("by_view", [True, False])
def test_a_place_out_of_reach_of_view_or_autopilot_is_not_chosen(by_view):
    begin = Inputs(time_s=0.0, place_ned=(0.0, 0.0, -4.0), local_ned=(0.0, 0.0, -4.0))
    choice = Choice(4.0)
    choice.begin(begin)
    here, other = (2.0, 0.0, -4.0), (3.0, 0.0, -4.0)
    now = replace(
        begin,
        place_ned=other if by_view else here,
        local_ned=here if by_view else other,
        spots=(replace(HERE, north_m=1.5, east_m=0.0),),
    )
    assert not choice.step(now)
    assert choice.step(replace(now, spots=(replace(HERE, north_m=0.9, east_m=0.0),)))


def test_level_flight_keeps_the_autopilots_altitude_whatever_the_view_makes_of_it():
    flight = Flight(spot=(3.0, 0.0))
    flight.until(State.GO)
    for k in range(int(2 / DT)):
        here = tuple(flight.place)
        seen = here[0], here[1], here[2] + 0.02 * k
        step = flight.step(place_ned=seen, local_ned=here)
    assert step.state is State.GO
    assert flight.place[2] == pytest.approx(-4.0, abs=0.05)
