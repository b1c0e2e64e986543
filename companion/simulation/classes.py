"""Random flights in classes that are counted apart.

A flight is known by its seed: below ``CLASS_SEEDS`` it is an ordinary random flight ("control"), from there on each
class has so many seeds of its own. Every class is a change of the random scenario, without its faults. Unkind classes
have ways of their own, which are slowed down as the random ones are.
"""

import random
from dataclasses import replace

from companion.simulation.contradictions import CONTRADICTIONS
from companion.simulation.procedure_scenario import PROCEDURES
from companion.simulation.random_scenario import random_scenario, slowing_down
from companion.simulation.scenario import Scenario
from companion.simulation.unkind_scenario import UNKIND

CLASS_SEEDS = 1_000_000
CONTROL = "control"
CHANGES = UNKIND | CONTRADICTIONS | PROCEDURES
"""Name -> change. New ones come last: the place is part of a flight's seed."""
CLASSES = (CONTROL, *CHANGES)


def scenario_of(seed: int) -> Scenario:
    """The scenario of a seed."""
    number, own = divmod(seed, CLASS_SEEDS)
    if number == 0:
        return random_scenario(seed)
    name, plain = CLASSES[number], random_scenario(own)
    basics = replace(plain.basics, description=name, seed=seed)
    scenario = replace(plain, name=f"{name}_{own}", basics=basics, faults=())
    r = random.Random(seed)
    scenario = CHANGES[name](scenario, r)
    return slowing_down(scenario, r) if name in UNKIND else scenario


def seeds_of(names: list[str], count: int, first: int = 0) -> list[int]:
    """``count`` seeds of each class, from its ``first`` on. Raises ValueError for an unknown name."""
    for name in names:
        if name not in CLASSES:
            raise ValueError(f"there is no class '{name}'; there are {', '.join(CLASSES)}")
    return [CLASSES.index(name) * CLASS_SEEDS + first + k for name in names for k in range(count)]
