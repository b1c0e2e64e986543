"""The classes of random flights: valid, repeatable, with what they are named for; what moves, where LAND goes."""

import math
from dataclasses import replace

import pytest

from companion.simulation.classes import CLASS_SEEDS, CLASSES, scenario_of, seeds_of
from companion.simulation.random_scenario import random_scenario
from companion.simulation.scenario import parse_scenario, to_toml
from drivers.simulated.vehicle.flight_controller import FlightController
from drivers.simulated.vehicle.vehicle import Multirotor
from drivers.simulated.world.world import build_world


@pytest.mark.parametrize("name", CLASSES[1:])
def test_each_class_is_a_valid_file_and_the_same_every_time(name: str):
    seed = seeds_of([name], 1, 7)[0]
    assert seed // CLASS_SEEDS == CLASSES.index(name)
    scenario = scenario_of(seed)
    assert scenario == scenario_of(seed)
    assert scenario.basics.description.split()[0] == name
    assert all(fault.kind.startswith("camera_") for fault in scenario.faults)
    assert parse_scenario(scenario.name, to_toml(scenario), "x.toml") == scenario
    plain = replace(random_scenario(7), name=scenario.name, basics=scenario.basics, faults=())
    assert (scenario == plain) == (name == "sound")


def test_an_unknown_class_is_refused_with_the_names():
    with pytest.raises(ValueError, match="no class 'puddle'; there are control, drifting"):
        seeds_of(["puddle"], 1)


def test_a_pit_is_as_deep_as_it_is_said_and_level_around():
    world = build_world([{"kind": "pit", "depth": 0.4, "length": 1.0, "width": 0.6, "north": 2.0}])
    assert world.height_at(2.0, 0.0) == pytest.approx(-0.4)
    assert world.height_at(2.45, 0.25) == pytest.approx(-0.4)
    assert [world.height_at(n, e) for n, e in ((2.6, 0.0), (1.4, 0.0), (2.0, 0.4), (2.0, -0.4))] == [0.0] * 4


def test_what_moves_takes_its_heights_along():
    ground = {"kind": "level"}
    box = {"kind": "box", "north": 0, "east": 0, "length": 0.4, "width": 0.4, "top": 1.0}
    world = build_world([ground, {**box, "moves_m_s": 0.5, "moves_deg": 90.0}])
    assert world.height_at(0.0, 0.0) == pytest.approx(1.0)
    world.advance(2.0)
    assert (world.height_at(0.0, 0.0), world.height_at(0.0, 1.0)) == (pytest.approx(0.0), pytest.approx(1.0))
    world.advance(0.0)
    assert world.height_at(0.0, 0.0) == pytest.approx(1.0)


def test_what_moves_until_then_stands_still_afterwards():
    box = {"kind": "box", "north": 0, "east": 0, "length": 0.4, "width": 0.4, "top": 1.0}
    world = build_world([{"kind": "level"}, {**box, "moves_m_s": 0.5, "moves_deg": 90.0, "moves_s": 4.0}])
    world.advance(9.0)
    assert (world.height_at(0.0, 2.0), world.height_at(0.0, 4.5)) == (pytest.approx(1.0), pytest.approx(0.0))


def test_land_goes_to_the_stopping_point():
    vehicle = Multirotor(ground=lambda n, e: 0.0)
    vehicle.place(0.0, 0.0, 3.0)
    controller = FlightController(vehicle)
    controller.start_airborne("GUIDED")
    for _ in range(600):
        controller.fly((2.0, 0.0, 0.0))
        vehicle.step(0.005, controller.step(0.005))
    north, speed = vehicle.position[0], vehicle.velocity[0]
    controller.set_mode("LAND")
    while not vehicle.on_ground:
        vehicle.step(0.005, controller.step(0.005))
    assert vehicle.position[0] == pytest.approx(north + speed, abs=0.3)
    assert math.isfinite(speed)
