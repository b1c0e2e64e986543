"""What is in the simulated picture beside the ground stays, moves or lies where it does outside."""

import numpy as np
import pytest

from drivers.errors import DriverError
from drivers.simulated.world.camera import Pose, SensorOptions, SimulatedCamera
from drivers.simulated.world.in_view import IN_VIEW
from drivers.simulated.world.lens import Lens
from drivers.simulated.world.render import Renderer
from drivers.simulated.world.world import build_world
from landing.vision.camera import DOWN

LENS = Lens.from_fov(160, 120, 64.0, DOWN)


def pictures(kind: str, *, speed: float = 0.0, sink: float = 0.0) -> list[np.ndarray]:
    """What differs from the ground alone, at 0, 1 and 2 s from 3 m up."""

    def flight(time_s: float) -> Pose:
        position = np.array((speed * time_s, 0.0, -3.0 + sink * time_s))
        return Pose(position, np.eye(3), np.array((speed, 0.0, sink)))

    world = build_world([{"kind": "level"}])
    shown = [
        SimulatedCamera(
            Renderer(world, LENS, texture_size=128), SensorOptions(noise_sigma=0.0, in_view=what), seed=3
        )
        for what in (kind, "nothing")
    ]
    frames = [[camera.expose(k, float(k), flight).astype(int) for k in range(3)] for camera in shown]
    return [np.abs(a - b) > 12 for a, b in zip(*frames, strict=True)]


@pytest.mark.parametrize("kind", ["skids", "dirt"])
def test_what_is_fixed_to_the_camera_stays_in_the_picture(kind: str) -> None:
    first, *later = pictures(kind, speed=0.5)
    assert first.sum() > 50
    for picture in later:
        assert (picture & first).sum() > 0.7 * first.sum()


def middle(picture: np.ndarray) -> np.ndarray:
    return np.argwhere(picture).mean(axis=0)


def test_the_shadow_stands_still_over_ground_and_grows_on_the_way_down() -> None:
    first, _, last = pictures("shadow", speed=0.5)
    assert first.sum() > 20
    assert np.abs(middle(first) - middle(last)).max() < 3
    first, _, last = pictures("shadow", sink=0.75)
    assert last.sum() > 2 * first.sum()
    assert np.abs(middle(first) - middle(last)).max() < 6


def test_a_person_walks() -> None:
    walked = [middle(picture) for picture in pictures("person") if picture.any()]
    assert len(walked) >= 2
    assert max(np.abs(a - b).max() for a in walked for b in walked) > 20


def test_another_thing_is_named() -> None:
    with pytest.raises(DriverError, match="nothing, skids, shadow, dirt, person, got 'cat'"):
        SimulatedCamera(
            Renderer(build_world([{"kind": "level"}]), LENS, texture_size=128), SensorOptions(in_view="cat")
        )
    assert IN_VIEW[0] == "nothing"
