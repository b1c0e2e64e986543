"""Pictures that contradict the vehicle: what is changed shows in them, and a flight reports it."""

from dataclasses import replace

import numpy as np

from companion.simulation.classes import seeds_of
from companion.simulation.monte_carlo import fly_one
from companion.simulation.scenario import Fault, Scenario
from companion.simulation.scene import Scene


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
    ground = {"kind": "level", "material": "gravel"}
    along = pictures(flight(surfaces=({**ground, "moves_m_s": 0.3, "moves_deg": 0.0},)), TIMES[:5])
    assert all(int(np.abs(image.astype(int) - along[0]).max()) <= 1 for image in along[1:])
    passing = pictures(flight(surfaces=(ground,)), TIMES[:5])
    assert int(np.abs(passing[4].astype(int) - passing[0]).max()) > 10


def test_a_contradiction_is_counted_and_nothing_is_requested():
    run = fly_one(seeds_of(["yaw_180"], 1, 1011)[0])
    assert "contradicts" in run.contradicted
    assert run.requested_s is None
