"""Changes of a random scenario by which pictures and mounts contradict the vehicle, or are hard for it and yet sound.

Each contradiction was seen on a vehicle: a camera mounted the wrong way round, a picture mirrored by a driver's
setting, another lens or zoom than the calibrated one, a stream that lags behind or repeats itself.
"""

import math
import random
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from companion.simulation.scenario import Fault, Scenario, WindScene
from companion.simulation.unkind_scenario import level

Change = Callable[[Scenario, random.Random], Scenario]

FOCAL_BELIEVED = 0.77
OLDEST_S, NEWEST_S = 1.0, 0.3
GPS_DRIFT_M_S = 0.21
"""Of an axis: 0.3 m/s over the two level ones."""


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


def _gps_drift(scenario: Scenario, _: random.Random) -> Scenario:
    return replace(scenario, sensors=replace(scenario.sensors, velocity_error_m_s=GPS_DRIFT_M_S))


def _slow_velocity(scenario: Scenario, r: random.Random) -> Scenario:
    return replace(scenario, sensors=replace(scenario.sensors, velocity_lag_s=round(r.uniform(0.1, 0.4), 2)))


def _gusts(scenario: Scenario, r: random.Random) -> Scenario:
    wind = WindScene(round(r.uniform(6, 10), 2), round(r.uniform(0, 360), 1), 2.0, 0.15)
    return replace(scenario, wind=wind)


def _over_level_ground(change: Change) -> Change:
    """The flight of ``moving_ground`` with the ground at rest."""
    return lambda scenario, r: change(level(scenario, r), r)


CONTRADICTIONS: dict[str, Change] = {
    "yaw_180": _yaw(180.0),
    "yaw_90": _yaw(90.0),
    "mirrored": _mirrored,
    "focal": _focal,
    "old": _old,
    "late": _late,
    "looped": _repeats("camera_looped"),
    "to_and_fro": _repeats("camera_to_and_fro"),
    "sound": lambda scenario, _: scenario,
    "sound_gps_drift": _gps_drift,
    "sound_slow_velocity": _slow_velocity,
    "sound_gusts": _gusts,
    "at_rest": _over_level_ground(lambda scenario, _: scenario),
    "at_rest_gps_drift": _over_level_ground(_gps_drift),
    "at_rest_slow_velocity": _over_level_ground(_slow_velocity),
    "at_rest_gusts": _over_level_ground(_gusts),
}
"""Name -> what changes in the random scenario. "late" is no contradiction once the search has found the lateness."""
