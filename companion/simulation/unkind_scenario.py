"""Changes of a random scenario that make ground, sensors or view difficult: one function per class of flights.

In: a random scenario and a seeded generator. Out: the scenario with other surfaces, legs or sensors
(m, m/s, s, degrees).
"""

import math
import random
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal

from companion.simulation.random_scenario import MATERIALS
from companion.simulation.scenario import Leg, Scenario, StartScene

GROUND_M_S = (0.3, 1.2)
"""Slowest and fastest speed of ground that moves."""

Surfaces = tuple[dict[str, Any], ...]
Change = Callable[[Scenario, random.Random], Scenario]


def _texture(r: random.Random) -> dict[str, Any]:
    return {"material": r.choice(MATERIALS), "texture_m": round(r.uniform(2, 6), 1)}


def _flown(s: Scenario, height: float, *legs: Leg, seconds: float = 7.0) -> Scenario:
    start = StartScene(0.0, 0.0, round(height, 2), 2.0, s.start.heading_deg)
    return replace(s, start=start, legs=legs, basics=replace(s.basics, duration_s=seconds))


def _level_flight(s: Scenario, r: random.Random, height: float, share: tuple[float, float]) -> Scenario:
    """Straight on northwards at a ventral flow between two bounds, 1/s."""
    s = replace(s, start=replace(s.start, heading_deg=0.0))
    speed = round(min(r.uniform(*share) * height, 4.0), 2)
    return _flown(s, height, Leg(60, forward_m_s=speed))


def _rubble(r: random.Random, smallest: float = 0.12, largest: float = 0.32) -> Surfaces:
    ground = {"kind": "level", **_texture(r)}
    boxes = {
        "kind": "rubble", "seed": r.randrange(1000), "count": 220, "length": 20.0, "width": 20.0,
        "north": 4.0, "smallest": smallest, "largest": largest, "material": r.choice(MATERIALS),
    }  # fmt: skip
    return (ground, boxes)


def _drifting(s: Scenario, r: random.Random) -> Scenario:
    """So slowly that neither flow nor velocity determines the height."""
    height = r.uniform(5, 16)
    s = replace(s, surfaces=_rubble(r))
    return _flown(s, height, Leg(60, forward_m_s=round(r.uniform(0.05, 0.3), 2)), seconds=9.0)


def _braking(s: Scenario, r: random.Random) -> Scenario:
    """On from speed to a hover."""
    height = r.uniform(5, 16)
    s = replace(s, surfaces=_rubble(r))
    legs = Leg(2.5, forward_m_s=round(0.2 * height, 2)), Leg(60)
    return _flown(s, height, *legs, seconds=8.0)


def _hovering(s: Scenario, r: random.Random) -> Scenario:
    height = r.uniform(0.5, 5)
    s = replace(s, surfaces=_rubble(r))
    return _flown(s, height, Leg(60, forward_m_s=round(r.uniform(0, 0.1), 2)), seconds=9.0)


def _velocity(scale: float, sent: bool = True) -> Change:
    def change(s: Scenario, r: random.Random) -> Scenario:
        """High over rubble, with a velocity that is not the vehicle's."""
        height = math.exp(r.uniform(math.log(4), math.log(32)))
        sensors = replace(s.sensors, velocity_scale=scale, velocity_told=sent)
        s = replace(s, sensors=sensors, surfaces=_rubble(r, 0.15, 0.45))
        return _level_flight(s, r, height, (0.15, 0.4))

    return change


def _boxes(s: Scenario, r: random.Random, rows: list[dict[str, Any]], material: str = "") -> Scenario:
    texture = _texture(r)
    ground = {"kind": "level", **texture}
    boxes = [{"kind": "box", "material": material or texture["material"], **row} for row in rows]
    s = replace(s, surfaces=(ground, *boxes))
    return _level_flight(s, r, r.uniform(1.5, 3.5), (0.2, 0.45))


def _smooth_box(s: Scenario, r: random.Random) -> Scenario:
    """A box without any texture of its own, near the way."""
    side, top = r.uniform(0.3, 0.9), round(r.uniform(0.15, 0.9), 2)
    row = {
        "north": round(r.uniform(0.6, 2.5), 2), "east": round(r.uniform(-0.4, 0.4), 2), "length": round(side, 2),
        "width": round(side * r.uniform(0.7, 1.4), 2), "top": top, "yaw_deg": r.randrange(90), "texture_m": 400.0,
    }  # fmt: skip
    s = replace(s, camera=replace(s.camera, brightness=1.0, contrast=1.0))
    return _boxes(s, r, [row], "wood")


def _small_boxes(s: Scenario, r: random.Random) -> Scenario:
    """Boxes of a quarter metre with the ground's own texture."""
    rows = [
        {"north": round(0.2 + 1.2 * k + r.uniform(-0.3, 0.3), 2), "east": round(e + r.uniform(-0.2, 0.2), 2),
         "length": 0.25, "width": 0.25, "top": round(r.uniform(0.13, 0.22), 2), "texture_m": 4.0}
        for k in range(4) for e in (-1.0, 0.0, 1.0)
    ]  # fmt: skip
    return _boxes(s, r, rows)


def _poles(s: Scenario, r: random.Random) -> Scenario:
    rows = [
        {"north": round(r.uniform(-0.5, 4), 2), "east": round(r.uniform(-0.8, 0.8), 2), "length": 0.1, "width": 0.1,
         "top": round(r.uniform(0.3, 1.0), 2), "texture_m": 1.0}
        for _ in range(6)
    ]  # fmt: skip
    return _boxes(s, r, rows, r.choice(MATERIALS))


def _kerb(s: Scenario, r: random.Random) -> Scenario:
    texture = _texture(r)
    step = {
        "kind": "step", "height": round(r.choice((1, -1)) * r.uniform(0.2, 0.35), 2),
        "north": round(r.uniform(0.5, 3), 2), "bearing_deg": round(r.uniform(-60, 60), 1), **texture,
    }  # fmt: skip
    return _level_flight(replace(s, surfaces=(step,)), r, r.uniform(1.5, 5), (0.2, 0.45))


def _hole(length: tuple[float, float], width: tuple[float, float], depth: tuple[float, float]) -> Change:
    def change(s: Scenario, r: random.Random) -> Scenario:
        """A hole whose inside lies in the dark."""
        pit = {
            "kind": "pit", "depth": round(r.uniform(*depth), 2), "length": round(r.uniform(*length), 2),
            "width": round(r.uniform(*width), 2), "north": round(r.uniform(0.8, 2.8), 2),
            "east": round(r.uniform(-0.3, 0.3), 2), "bearing_deg": round(r.uniform(-80, 80), 1), "inside": "dark",
            **_texture(r),
        }  # fmt: skip
        return _level_flight(replace(s, surfaces=(pit,)), r, r.uniform(1.5, 4), (0.2, 0.45))

    return change


def _edge(s: Scenario, r: random.Random) -> Scenario:
    """The stopping point lies beyond a drop of three metres."""
    speed, height = r.uniform(1.2, 3.0), r.uniform(1.5, 4.0)
    step = {
        "kind": "step", "height": -3.0, "north": round(speed * r.uniform(1.5, 3.5), 2),
        "bearing_deg": round(r.uniform(-30, 30), 1), **_texture(r),
    }  # fmt: skip
    s = replace(s, surfaces=(step,), start=replace(s.start, heading_deg=0.0))
    return _flown(s, height, Leg(60, forward_m_s=round(speed, 2)), seconds=5.0)


def level(s: Scenario, r: random.Random, material: str = "") -> Scenario:
    """Level, fit ground, for classes in which the fault is in the picture."""
    texture = _texture(r) | ({"material": material} if material else {})
    camera = replace(s.camera, brightness=1.0, contrast=1.0, exposure_s=0.0)
    s = replace(s, surfaces=({"kind": "level", **texture},), camera=camera)
    return _level_flight(s, r, r.uniform(1.5, 4), (0.15, 0.35))


def _in_view(what: Literal["skids", "dirt", "shadow"]) -> Change:
    def change(s: Scenario, r: random.Random) -> Scenario:
        s = level(s, r)
        return replace(s, camera=replace(s.camera, in_view=what))

    return change


def _tiles(s: Scenario, r: random.Random) -> Scenario:
    return level(s, r, "tiles")


def _moving_ground(s: Scenario, r: random.Random) -> Scenario:
    """Nothing to stand on: water, a belt, another vehicle's roof."""
    s = level(s, r)
    moves = {"moves_m_s": round(r.uniform(*GROUND_M_S), 2), "moves_deg": round(r.uniform(0, 360), 1)}
    s = replace(s, expect=replace(s.expect, landing="none"))
    return replace(s, surfaces=tuple({**surface, **moves} for surface in s.surfaces))


def _moving_below_hover(s: Scenario, r: random.Random) -> Scenario:
    return replace(_moving_ground(s, r), legs=(Leg(60.0),))


def _walker(s: Scenario, r: random.Random) -> Scenario:
    """Somebody of the size of a person crosses the way."""
    s = level(s, r)
    side = r.choice((1, -1))
    pace, when = r.uniform(0.3, 1.2), r.uniform(2.0, 5.0)
    ahead = s.legs[0].forward_m_s * when + r.uniform(-0.3, 0.6)
    person = {
        "kind": "box", "north": round(ahead, 2), "east": round(side * pace * when, 2), "length": 0.4,
        "width": 0.5, "top": round(r.uniform(0.6, 1.2), 2), "material": r.choice(MATERIALS), "texture_m": 1.0,
        "moves_m_s": round(pace, 2), "moves_deg": -90.0 * side,
    }  # fmt: skip
    start = replace(s.start, height_m=max(s.start.height_m, 2.5))
    return replace(s, start=start, surfaces=(*s.surfaces, person))


UNKIND: dict[str, Change] = {
    "drifting": _drifting,
    "braking": _braking,
    "hovering": _hovering,
    "velocity_missing": _velocity(1.0, sent=False),
    "velocity_zero": _velocity(0.0),
    "velocity_tenth": _velocity(0.1),
    "smooth_box": _smooth_box,
    "small_boxes": _small_boxes,
    "poles": _poles,
    "kerb": _kerb,
    "dark_pit": _hole((0.4, 1.2), (0.4, 1.2), (0.3, 0.6)),
    "dark_ditch": _hole((3.0, 6.0), (0.25, 0.6), (0.15, 0.4)),
    "edge_ahead": _edge,
    "skids": _in_view("skids"),
    "dirt": _in_view("dirt"),
    "shadow": _in_view("shadow"),
    "tiles": _tiles,
    "moving_ground": _moving_ground,
    "walker": _walker,
    "moving_hover": _moving_below_hover,
}
"""Name -> what it makes of a random flight."""
