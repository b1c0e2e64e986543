"""Random short flights over random ground, for counting how often the landing is right. One seed, one scenario."""

import math
import random
from dataclasses import replace
from typing import Any

from companion.simulation.scenario import (
    Basics,
    CameraScene,
    Fault,
    Leg,
    LinkScene,
    Scenario,
    SensorScene,
    StartScene,
    WindScene,
)

DURATION_S = 7.0
MATERIALS = ("noise", "gravel", "grass", "tiles", "wood", "concrete", "asphalt", "roof")
GROUNDS = {
    "level": 0.14,
    "gentle": 0.10,
    "steep": 0.16,
    "stairs": 0.15,
    "rubble": 0.15,
    "step": 0.10,
    "boxes": 0.10,
    "rolling": 0.10,
}
"""Kind of ground -> share of the flights."""
FAULT_SHARE = 0.25
BLUR_SHARE = 0.15
TURN_SHARE = 0.25
ROLLING_SHARE, KNOWN_SHARE, LONGEST_READOUT_S = 0.7, 0.5, 0.03
"""Shares of flights with a rolling shutter, and of those whose readout is set."""

SLOWS_SHARE, SLOWS_AT_S, CREEPS = 0.7, (1.5, 3.0), 0.06
"""Share of the flights that slow down as a pilot does before a landing, when, and the largest speed then over the
height, 1/s: the autopilot lands at the stopping point, which only then lies on measured ground."""

Surfaces = tuple[dict[str, Any], ...]


def random_scenario(seed: int) -> Scenario:
    """The scenario of a seed."""
    r = random.Random(seed)
    kind = r.choices(list(GROUNDS), list(GROUNDS.values()))[0]
    height = math.exp(r.uniform(math.log(1.3), math.log(8.0)))
    # Motion that shows the surface: a ventral flow of 0.15 to 0.6 a second.
    speed = min(max(r.uniform(0.15, 0.6) * height, 0.3), 3.0)
    surfaces = _ground(kind, r, speed)
    scenario = Scenario(
        name=f"random_{seed}",
        basics=Basics(kind, seed, DURATION_S, r.randrange(8)),
        camera=_camera(r),
        start=StartScene(0.0, 0.0, round(height, 2), 2.0, round(r.uniform(-25, 25), 1)),
        wind=WindScene(
            round(r.uniform(0, 8), 2),
            round(r.uniform(0, 360), 1),
            round(r.uniform(0, 1.2), 2),
            round(r.uniform(0, 0.1), 3),
        ),
        sensors=SensorScene(
            round(r.uniform(0.002, 0.01), 4),
            round(r.uniform(0, 0.005), 4),
            round(r.uniform(0.05, 0.4), 3),
            round(r.uniform(0.01, 0.1), 3),
            round(r.uniform(0.02, 0.2), 3),
        ),
        link=LinkScene(
            0.001, round(r.uniform(0.003, 0.02), 4), round(r.choice((0, 0, r.uniform(0, 0.05))), 3)
        ),
        surfaces=surfaces,
        legs=_legs(r, speed, height),
        faults=_faults(r),
        settings={"camera": {"time_offset_s": round(r.gauss(0, 0.0015), 5)}},
    )
    # drawn last, so that a seed's flight stays the same
    readout_s = round(r.uniform(0, LONGEST_READOUT_S), 4) if r.random() < ROLLING_SHARE else 0.0
    known = r.random() < KNOWN_SHARE
    scenario = replace(scenario, camera=replace(scenario.camera, readout_s=readout_s, readout_known=known))
    return slowing_down(scenario, r)


def slowing_down(scenario: Scenario, r: random.Random) -> Scenario:
    """The scenario, in a share of the cases cut short by a leg at a creep to its end."""
    if r.random() >= SLOWS_SHARE:
        return scenario
    left_s, legs = round(r.uniform(*SLOWS_AT_S), 2), []
    for leg in scenario.legs:
        if left_s > 0:
            legs.append(replace(leg, seconds=min(leg.seconds, left_s)))
            left_s = round(left_s - leg.seconds, 2)
    creep = math.copysign(r.uniform(0, CREEPS) * scenario.start.height_m, legs[-1].forward_m_s)
    return replace(scenario, legs=(*legs, Leg(60, forward_m_s=round(creep, 2))))


def _camera(r: random.Random) -> CameraScene:
    blurred = r.random() < BLUR_SHARE
    return CameraScene(
        width_px=160,
        height_px=120,
        fov_deg=round(r.uniform(55, 80), 1),
        distortion=(round(r.uniform(-0.15, 0.02), 3), round(r.uniform(0, 0.03), 3)),
        rate_hz=15.0,
        latency_s=round(r.uniform(0.005, 0.05), 3),
        late_known=False,
        mount_roll_deg=round(r.uniform(-5, 5), 2),
        mount_pitch_deg=round(r.uniform(-8, 8), 2),
        mount_yaw_deg=r.choice((0.0, 0.0, 90.0, 180.0)),
        noise=round(r.uniform(0.5, 5), 2),
        vignetting=round(r.uniform(0, 0.4), 2),
        exposure_drift=round(r.uniform(0, 0.2), 2),
        exposure_s=round(r.uniform(0.002, 0.008), 4) if blurred else 0.0,
        brightness=round(r.uniform(0.35, 1.5), 2),
        contrast=round(r.uniform(0.35, 1.3), 2),
    )


def _ground(kind: str, r: random.Random, speed: float) -> Surfaces:
    """Surfaces about the flight northwards from the origin; what changes lies within the first seconds' way."""
    material = r.choice(MATERIALS)
    texture = {"material": material, "texture_m": round(r.uniform(2, 6), 1)}
    change = round(r.uniform(-1.0, 5.0) * speed, 2)
    if kind == "level":
        return ({"kind": "level", **texture},)
    if kind in ("gentle", "steep"):
        angle = r.uniform(0, 7) if kind == "gentle" else r.uniform(13, 45)
        uphill = round(r.uniform(0, 360), 1)
        return ({"kind": "ramp", "inclination_deg": round(angle, 1), "uphill_deg": uphill, **texture},)
    if kind == "stairs":
        count = r.randrange(6, 20)
        run = round(r.uniform(0.25, 0.4), 3)
        rise = round(r.uniform(0.12, 0.2), 3) * r.choice((1, -1))
        first = round(r.uniform(-1, 0.5) * count * run, 2)
        bearing = round(r.uniform(-20, 20), 1)
        steps = {"kind": "stairs", "count": count, "run": run, "rise": rise}
        return ({**steps, "north": first, "bearing_deg": bearing, **texture},)
    if kind == "step":
        rise = round(r.uniform(0.15, 1.2) * r.choice((1, -1)), 2)
        return (
            {
                "kind": "step",
                "height": rise,
                "north": change,
                "bearing_deg": round(r.uniform(-40, 40), 1),
                **texture,
            },
        )
    if kind == "rolling":
        return (
            {"kind": "rolling", "seed": r.randrange(1000), "north": 5.0, "size": 24.0, "cell": 1.5,
             "wavelength": round(r.uniform(6, 14), 1), "amplitude": round(r.uniform(0.05, 0.8), 2), **texture},
            {"kind": "level", "height": -3.0, **texture},
        )  # fmt: skip
    dense = kind == "rubble"
    clear = r.random() < 0.5
    boxes = {
        "kind": "rubble",
        "seed": r.randrange(1000),
        "count": r.randrange(90, 160) if dense else r.randrange(4, 25),
        "length": 10.0 if dense else 14.0,
        "width": 10.0,
        "north": round(change - 5.0, 2) if clear else 4.0,
        "smallest": 0.15,
        "largest": round(r.uniform(0.3, 0.7), 2),
        "material": r.choice(MATERIALS),
    }
    return ({"kind": "level", **texture}, boxes)


def _legs(r: random.Random, speed: float, height: float) -> tuple[Leg, ...]:
    v = round(speed, 2)
    turn = round(r.uniform(-30, 30), 1) if r.random() < TURN_SHARE else 0.0
    style = r.choice(("forward", "forward", "follow", "sideways", "descend", "reverse"))
    if style == "follow":
        return (Leg(60, forward_m_s=v, height_m=round(height, 2), turn_deg_s=turn),)
    if style == "sideways":
        return (Leg(60, forward_m_s=v, right_m_s=round(v * r.uniform(-0.7, 0.7), 2), turn_deg_s=turn),)
    if style == "descend":
        sink = round(min(0.1 * height, 0.5), 2)
        return (Leg(60, forward_m_s=v, climb_m_s=-sink, turn_deg_s=turn),)
    if style == "reverse":
        return (Leg(3.5, forward_m_s=v, turn_deg_s=turn), Leg(60, forward_m_s=-v, turn_deg_s=turn))
    return (Leg(60, forward_m_s=v, turn_deg_s=turn),)


def _faults(r: random.Random) -> tuple[Fault, ...]:
    if r.random() >= FAULT_SHARE:
        return ()
    kind: Any = r.choice(("camera_frozen", "camera_lost", "camera_dark", "link_silent", "autopilot_reboot"))
    return (Fault(kind, round(r.uniform(1, 4.5), 2), round(r.uniform(0.3, 2.0), 2)),)
