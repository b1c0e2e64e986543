"""What counts as a landable disc within reach, what a procedure amounts to, and the figures of many."""

import dataclasses

import pytest

from companion.simulation.flight_result import FlightResult, FlownStep
from companion.simulation.ground import Patch
from companion.simulation.procedure_count import Outcome, landable_within, outcome, words
from companion.simulation.scenario import read_scenario
from drivers.simulated.vehicle.vehicle import TouchDown
from drivers.simulated.world.world import build_world
from landing.decision.orders import Order, State, Step, Why

BOX = {"kind": "box", "length": 0.3, "width": 0.3, "top": 0.4}
GRID = [
    {**BOX, "north": n * 0.7, "east": e * 0.7} for n in range(-4, 5) for e in range(-4, 5) if (n, e) != (2, 1)
]


@pytest.mark.parametrize(
    ("surfaces", "landable"),
    [
        ([{"kind": "level"}], True),
        ([{"kind": "ramp", "inclination_deg": 7}], True),
        ([{"kind": "ramp", "inclination_deg": 9}], False),
        ([{"kind": "level"}, *GRID], True),  # where one box is missing, and only there
        ([{"kind": "level"}, *GRID, {**BOX, "north": 1.4, "east": 0.7}], False),
        ([{"kind": "step", "height": -2.0, "bearing_deg": 30}], True),
    ],
)
def test_a_landable_disc_is_level_and_even_and_within_reach(surfaces, landable):
    world = build_world(surfaces)
    assert landable_within(world, (0.0, 0.0), 2.0, 0.45, 8.0) is landable


def test_what_lies_out_of_reach_does_not_count():
    world = build_world([{"kind": "level"}, *GRID])
    assert not landable_within(world, (0.0, 0.0), 0.8, 0.45, 8.0)


FLAT, BOULDER = Patch(0.0, 0.0, 1.0, 0.01), Patch(0.0, 0.0, 1.0, 0.2)
TOUCH = TouchDown(20.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.5), 0.0)


@pytest.mark.parametrize(
    ("state", "why", "touch", "ground", "word", "ended"),
    [
        (State.HAND_OVER, Why.LANDING, TOUCH, FLAT, "right", "landed"),
        (State.HAND_OVER, Why.LANDING, TOUCH, BOULDER, "unsafe", "landed"),
        (State.DESCEND, Why.COMING_DOWN, TOUCH, FLAT, "unsafe", "in_descend"),  # it flew into the ground
        (State.GIVE_BACK, Why.SEARCHED_IN_VAIN, None, None, "missed", "searched_in_vain"),
        (State.LOOK, Why.GROUND_UNKNOWN, None, None, "missed", "in_look"),
    ],
)
def test_what_a_procedure_amounts_to(state, why, touch, ground, word, ended):
    result = FlightResult("scene", touch_down=touch, touch_ground=ground)
    result.steps = [FlownStep(9.0, Step(Order(), state, why, True), (0.0, 0.0, -2.0), (0.0, 0.0, 0.1))]
    found = outcome(read_scenario("walk_in"), result)
    assert found is not None
    assert (found.outcome, found.ended, found.reachable) == (word, ended, True)


def test_a_flight_without_a_procedure_is_none_and_one_that_never_began_is_missed():
    assert outcome(read_scenario("level"), FlightResult("scene")) is None
    never = outcome(read_scenario("walk_in"), FlightResult("scene"))
    assert never is not None
    assert (never.outcome, never.ended) == ("missed", "never_began")
    refused = outcome(read_scenario("no_gps"), FlightResult("scene"))
    assert refused is not None
    assert refused.outcome == "right"


def test_the_figures_of_many():
    good = Outcome("right", "landed", True, 0.1, 0.2, 0.03, 20.0)
    worse = dataclasses.replace(good, place_error_m=0.3, divergence_std=None)
    lines = "\n".join(
        words([good, good, worse, Outcome("missed", "way_too_long", True, None, None, None, 30.0)])
    )
    assert "4, landed 3" in lines
    assert "landed where a landable disc was in reach 3 of 4" in lines
    assert "median 0.10, 95 % 0.30, worst 0.30 m" in lines
    assert "not landed: way_too_long" in lines
    assert words([]) == []
