"""Random scenes for the landing procedure: it begins in a hover; part of the ground, all of it or none is landable."""

import math
import random
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from companion.simulation.random_scenario import MATERIALS
from companion.simulation.scenario import Scenario, StartScene

DURATION_S = 100.0
SEARCH_M = (3.0, 5.0)
RADIUS_M = (0.3, 0.45)
HEIGHT_M = (2.5, 6.0)
MOST_NOISE = 3.5
"""In daylight: what is landable shall be visible."""

Surfaces = tuple[dict[str, Any], ...]
Ground = Callable[[random.Random, float, float, dict[str, Any]], Surfaces]
"""Of the randomness, the reach of the search, the disc's radius (m) and the ground's texture."""


def _place(r: random.Random, least: float, most: float) -> tuple[float, float]:
    """North and east, so far from where it begins."""
    way, bearing = r.uniform(least, most), r.uniform(-math.pi, math.pi)
    return round(way * math.cos(bearing), 2), round(way * math.sin(bearing), 2)


def _rubble(r: random.Random, clear_m: float, clear: tuple[float, float]) -> dict[str, Any]:
    return {
        "kind": "rubble", "seed": r.randrange(1000), "count": r.randrange(120, 200), "length": 9.0, "width": 9.0,
        "smallest": 0.2, "largest": round(r.uniform(0.5, 0.8), 2), "material": r.choice(MATERIALS),
        "clear_m": round(clear_m, 2), "clear_north": clear[0], "clear_east": clear[1],
    }  # fmt: skip


def _patch(r: random.Random, reach: float, radius: float, texture: dict[str, Any]) -> Surfaces:
    """Rubble with one clear place."""
    clear = _place(r, 0.0, 0.7 * reach)
    return {"kind": "level", **texture}, _rubble(r, 2 * radius + r.uniform(0.5, 1.2), clear)


def _only_rubble(r: random.Random, reach: float, radius: float, texture: dict[str, Any]) -> Surfaces:
    return {"kind": "level", **texture}, _rubble(r, 0.0, (0.0, 0.0))


def _boxes(r: random.Random, reach: float, radius: float, texture: dict[str, Any]) -> Surfaces:
    """Boxes on a slope, some of them on one that is too steep."""
    angle, uphill = r.uniform(0, 7) if r.random() < 0.8 else r.uniform(13, 25), r.uniform(-180, 180)
    rise = math.tan(math.radians(angle))
    boxes = []
    for _ in range(r.randrange(4, 25)):
        north, east = _place(r, 0.0, reach + 1)
        ground = rise * (north * math.cos(math.radians(uphill)) + east * math.sin(math.radians(uphill)))
        boxes.append(
            {"kind": "box", "north": north, "east": east, "length": round(r.uniform(0.2, 0.8), 2),
             "width": round(r.uniform(0.2, 0.8), 2), "top": round(ground + r.uniform(0.15, 0.8), 2), "base": -4.0,
             "yaw_deg": r.randrange(90), "material": r.choice((texture["material"], *MATERIALS))}
        )  # fmt: skip
    slope = {"kind": "ramp", "inclination_deg": round(angle, 1), "uphill_deg": round(uphill, 1), **texture}
    return slope, *boxes


def _edge(r: random.Random, reach: float, radius: float, texture: dict[str, Any]) -> Surfaces:
    """A flat roof's edge, or the foot of a wall."""
    height = round(r.choice((1, -1)) * r.uniform(0.3, 3.0), 2)
    bearing = r.uniform(-180, 180)
    way = r.uniform(-0.6 * reach, 0.6 * reach)
    north, east = way * math.cos(math.radians(bearing)), way * math.sin(math.radians(bearing))
    place = {"north": round(north, 2), "east": round(east, 2), "bearing_deg": round(bearing, 1)}
    return ({"kind": "step", "height": height, **place, **texture},)


def _roof(r: random.Random, reach: float, radius: float, texture: dict[str, Any]) -> Surfaces:
    """A house with a steep roof below or beside."""
    north, east = _place(r, 0.0, reach)
    house = {
        "kind": "roof", "north": north, "east": east, "ridge_bearing_deg": round(r.uniform(0, 180), 1),
        "length": round(r.uniform(4, 8), 1), "width": round(r.uniform(3, 5), 1), "eaves": round(r.uniform(1, 2.5), 1),
        "pitch_deg": round(r.uniform(15, 40), 1),
    }  # fmt: skip
    return {"kind": "level", **texture}, house


def _stairs(r: random.Random, reach: float, radius: float, texture: dict[str, Any]) -> Surfaces:
    north, east = _place(r, 0.0, 0.5 * reach)
    steps = {
        "kind": "stairs", "count": r.randrange(4, 14), "run": round(r.uniform(0.25, 0.4), 3),
        "rise": round(r.uniform(0.12, 0.2), 3), "north": north, "east": east,
        "bearing_deg": round(r.uniform(-180, 180), 1),
    }  # fmt: skip
    return ({**steps, **texture},)


def _rolling(r: random.Random, reach: float, radius: float, texture: dict[str, Any]) -> Surfaces:
    waves = {
        "kind": "rolling", "seed": r.randrange(1000), "size": 24.0, "cell": 1.5,
        "wavelength": round(r.uniform(6, 14), 1), "amplitude": round(r.uniform(0.05, 0.6), 2),
    }  # fmt: skip
    return {**waves, **texture}, {"kind": "level", "height": -3.0, **texture}


def _pit(r: random.Random, reach: float, radius: float, texture: dict[str, Any]) -> Surfaces:
    north, east = _place(r, 0.0, 0.6 * reach)
    pit = {
        "kind": "pit", "depth": round(r.uniform(0.15, 0.6), 2), "length": round(r.uniform(0.4, 6.0), 2),
        "width": round(r.uniform(0.25, 1.2), 2), "north": north, "east": east,
        "bearing_deg": round(r.uniform(-90, 90), 1), "inside": r.choice(("dark", texture["material"])),
    }  # fmt: skip
    return ({**pit, **texture},)


def _level(r: random.Random, reach: float, radius: float, texture: dict[str, Any]) -> Surfaces:
    return ({"kind": "level", **texture},)


def _walker(r: random.Random, reach: float, radius: float, texture: dict[str, Any]) -> Surfaces:
    """Somebody crosses level ground while the vehicle comes down."""
    pace, when, bearing = r.uniform(0.3, 1.2), r.uniform(5.0, 14.0), r.uniform(-180, 180)
    near = _place(r, 0.0, 1.0)
    person = {
        "kind": "box", "north": round(near[0] - pace * when * math.cos(math.radians(bearing)), 2),
        "east": round(near[1] - pace * when * math.sin(math.radians(bearing)), 2), "length": 0.4, "width": 0.5,
        "top": round(r.uniform(0.9, 1.8), 2), "material": r.choice(MATERIALS), "texture_m": 1.0,
        "moves_m_s": round(pace, 2), "moves_deg": round(bearing, 1),
    }  # fmt: skip
    return {"kind": "level", **texture}, person


GROUNDS: dict[str, tuple[float, Ground]] = {
    "patch": (0.25, _patch),
    "boxes": (0.2, _boxes),
    "edge": (0.12, _edge),
    "house": (0.1, _roof),
    "stairs": (0.06, _stairs),
    "rolling": (0.08, _rolling),
    "pit": (0.06, _pit),
    "walker": (0.04, _walker),
    "plain": (0.04, _level),
    "all_rubble": (0.05, _only_rubble),
}
"""Kind of ground -> share of the scenes, and what makes it."""


def procedure(s: Scenario, r: random.Random) -> Scenario:
    """Lens, noise, wind, link and sensors of the random flight; another ground, and a procedure."""
    shares = [share for share, _ in GROUNDS.values()]
    kind = r.choices(list(GROUNDS), shares)[0]
    radius, reach = round(r.uniform(*RADIUS_M), 2), round(r.uniform(*SEARCH_M), 1)
    texture = {"material": r.choice(MATERIALS), "texture_m": round(r.uniform(2, 6), 1)}
    height = round(r.uniform(*HEIGHT_M), 2)
    camera = replace(
        s.camera,
        width_px=240,
        height_px=180,
        exposure_s=0.0,
        readout_s=0.0,
        readout_known=True,
        brightness=round(r.uniform(0.7, 1.4), 2),
        contrast=round(r.uniform(0.6, 1.3), 2),
        noise=min(s.camera.noise, MOST_NOISE),
    )
    landing = {"procedure": "offboard", "takeover_modes": ["GUIDED"]}
    settings = {"landing": landing, "vehicle": {"landing_radius_m": radius, "max_search_m": reach}}
    return replace(
        s,
        basics=replace(s.basics, description=f"procedure {kind}", duration_s=DURATION_S),
        camera=camera,
        start=StartScene(0.0, 0.0, height, 2.0, s.start.heading_deg),
        surfaces=GROUNDS[kind][1](r, reach, radius, texture),
        legs=(),
        settings=s.settings | settings,
    )


PROCEDURES = {"procedure": procedure}
"""Name of the class -> what it makes of a random flight."""
