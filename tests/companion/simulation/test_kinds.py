"""Random flights of a kind: what is changed, and that the pictures show it."""

from dataclasses import replace

import numpy as np
import pytest

from companion.simulation.kinds import KINDS, draw_kind
from companion.simulation.monte_carlo import fly_one
from companion.simulation.random_scenario import random_scenario
from companion.simulation.scenario import Fault, GroundScene, Scenario, parse_scenario, to_toml
from companion.simulation.scene import Scene


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_a_kind_is_a_valid_file_and_always_the_same(kind):
    scenario = draw_kind(kind, 5)
    assert draw_kind(kind, 5) == scenario
    assert parse_scenario(scenario.name, to_toml(scenario), "it") == scenario
    assert (scenario != replace(random_scenario(5), faults=())) == (kind != "sound")


def pictures(scenario: Scenario, times: list[float]) -> list[np.ndarray]:
    scene = Scene(scenario, threads=False)
    quiet = replace(scene.camera.options, noise_sigma=0.0, exposure_drift=0.0)
    scene.camera.options = quiet
    out = []
    for number, time_s in enumerate(times):
        scene.vehicle.time_s = time_s
        scene.vehicle.position = (0.3 * time_s, 0.0, -2.0)
        scene.poses.add(scene.vehicle)
        image = scene.picture(number, time_s, time_s)
        assert image is not None
        out.append(image)
    return out


def flight(**what) -> Scenario:
    scenario = Scenario("it")
    camera = replace(scenario.camera, width_px=64, height_px=48, rate_hz=10.0)
    return replace(scenario, **{"camera": camera} | what)


TIMES = [0.1 * k for k in range(1, 13)]


def test_a_mirrored_picture_has_left_and_right_swapped():
    plain = flight()
    mirrored = replace(plain, camera=replace(plain.camera, mirrored=True))
    assert np.array_equal(pictures(mirrored, TIMES[:1])[0], pictures(plain, TIMES[:1])[0][:, ::-1])


def test_looped_pictures_come_again_in_order_and_to_and_fro_backwards():
    plain = pictures(flight(), TIMES)
    fault = Fault("camera_looped", 0.55, 60.0, loop_s=0.3)
    looped = pictures(flight(faults=(fault,)), TIMES)
    order = [0, 1, 2, 3, 4, 2, 3, 4, 2, 3, 4, 2]
    assert all(np.array_equal(image, plain[k]) for image, k in zip(looped, order, strict=True))
    to_and_fro = pictures(flight(faults=(replace(fault, kind="camera_to_and_fro"),)), TIMES)
    order = [0, 1, 2, 3, 4, 3, 2, 3, 4, 3, 2, 3]
    assert all(np.array_equal(image, plain[k]) for image, k in zip(to_and_fro, order, strict=True))


def test_ground_that_moves_with_the_vehicle_stands_still_in_the_picture():
    still = pictures(flight(ground=GroundScene(0.3, 0.0)), TIMES[:5])
    assert all(np.array_equal(image, still[0]) for image in still[1:])
    moving = pictures(flight(), TIMES[:5])
    assert not np.array_equal(moving[0], moving[4])


def test_a_landing_on_ground_that_moves_is_unsafe_and_a_contradiction_is_counted():
    run = fly_one(1011, draw=lambda seed: draw_kind("yaw_180", seed))
    assert "contradicts" in run.contradicted
    assert run.requested_s is None
