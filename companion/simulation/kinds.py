"""Kinds of random flights: pictures, mounts and grounds that contradict the vehicle, and flights hard and yet sound.

Each is a change of the random scenario of a seed. A contradiction was seen on a vehicle: a camera mounted the wrong
way round, a picture mirrored by a driver's setting, another lens or zoom than the calibrated one, a stream that lags
behind or repeats itself, and ground that moves: water, a lorry's bed, grass in the rotor wash.
"""

import math
import random
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from companion.simulation.random_scenario import random_scenario
from companion.simulation.scenario import Fault, GroundScene, Leg, Scenario, WindScene

Change = Callable[[Scenario, random.Random], Scenario]

FOCAL_BELIEVED = 0.77
OLDEST_S, NEWEST_S = 1.0, 0.3
GROUND_M_S = (0.3, 1.2)
GPS_DRIFT_M_S = 0.21
"""Of an axis: 0.3 m/s over the two level ones."""


def draw_kind(kind: str, seed: int) -> Scenario:
    """The random scenario of a seed, without its faults, changed as a kind says."""
    r = random.Random(f"{kind} {seed}")
    return KINDS[kind](replace(random_scenario(seed), faults=()), r)


def _camera(scenario: Scenario, **what: Any) -> Scenario:
    return replace(scenario, camera=replace(scenario.camera, **what))


def _settings(scenario: Scenario, **what: float) -> Scenario:
    camera = scenario.settings.get("camera", {}) | what
    return replace(scenario, settings=scenario.settings | {"camera": camera})


def _yaw(by_deg: float) -> Change:
    def change(scenario: Scenario, _: random.Random) -> Scenario:
        wrong = math.remainder(scenario.camera.mount_yaw_deg + by_deg, 360.0)
        return _settings(scenario, mount_yaw_deg=wrong)

    return change


def _mirrored(scenario: Scenario, _: random.Random) -> Scenario:
    return _camera(scenario, mirrored=True)


def _focal(scenario: Scenario, _: random.Random) -> Scenario:
    return _camera(scenario, focal_believed=FOCAL_BELIEVED)


def _old(scenario: Scenario, r: random.Random) -> Scenario:
    age_s = round(r.uniform(NEWEST_S, OLDEST_S), 3)
    return _camera(scenario, late_s=age_s, latency_s=age_s + scenario.camera.latency_s, late_known=False)


def _late(scenario: Scenario, r: random.Random) -> Scenario:
    age_s = round(r.uniform(0.1, 0.4), 3)
    return _camera(scenario, late_s=age_s, latency_s=age_s + scenario.camera.latency_s, late_known=False)


def _repeats(kind: Any) -> Change:
    def change(scenario: Scenario, r: random.Random) -> Scenario:
        at_s, loop_s = round(r.uniform(0.8, 2.5), 2), round(r.uniform(0.5, 2.0), 2)
        return replace(scenario, faults=(Fault(kind, at_s, 60.0, loop_s=min(loop_s, at_s)),))

    return change


def _moving(scenario: Scenario, r: random.Random) -> Scenario:
    speed, towards = r.uniform(*GROUND_M_S), r.uniform(0, 2 * math.pi)
    material = {"material": "noise", "texture_m": 4.0} | {
        key: value for key, value in scenario.surfaces[0].items() if key in ("material", "texture_m")
    }
    return replace(
        scenario,
        surfaces=({"kind": "level", **material},),
        ground=GroundScene(round(speed * math.cos(towards), 3), round(speed * math.sin(towards), 3)),
    )


def _moving_below_hover(scenario: Scenario, r: random.Random) -> Scenario:
    return replace(_moving(scenario, r), legs=(Leg(60.0),))


def _gps_drift(scenario: Scenario, _: random.Random) -> Scenario:
    return replace(scenario, sensors=replace(scenario.sensors, velocity_error_m_s=GPS_DRIFT_M_S))


def _slow_velocity(scenario: Scenario, r: random.Random) -> Scenario:
    return replace(scenario, sensors=replace(scenario.sensors, velocity_lag_s=round(r.uniform(0.1, 0.4), 2)))


def _gusts(scenario: Scenario, r: random.Random) -> Scenario:
    wind = WindScene(round(r.uniform(6, 10), 2), round(r.uniform(0, 360), 1), 2.0, 0.15)
    return replace(scenario, wind=wind)


KINDS: dict[str, Change] = {
    "yaw_180": _yaw(180.0),
    "yaw_90": _yaw(90.0),
    "mirrored": _mirrored,
    "focal": _focal,
    "old": _old,
    "late": _late,
    "looped": _repeats("camera_looped"),
    "to_and_fro": _repeats("camera_to_and_fro"),
    "moving": _moving,
    "moving_hover": _moving_below_hover,
    "sound": lambda scenario, _: scenario,
    "sound_gps_drift": _gps_drift,
    "sound_slow_velocity": _slow_velocity,
    "sound_gusts": _gusts,
}
"""Name -> what changes in the random scenario. "late" is no contradiction once the search has found the lateness."""
