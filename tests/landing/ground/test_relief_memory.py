"""Points that stood out are carried along as what stands there moves, not as the ground about it does."""

from copy import copy

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from landing.ground import relief_memory
from landing.ground.relief_memory import Cells, ReliefMemory
from landing.rotations import exp_so3
from landing.vision.camera import CameraModel

CAMERA = CameraModel.from_focal(320, 240, 256.0)
small = st.floats(-0.02, 0.02)


def memory(pixels: np.ndarray, height: float) -> ReliefMemory:
    made = ReliefMemory(CAMERA, Cells(CAMERA, 80), 8.0)
    made.add(pixels, height)
    return made


@given(st.tuples(small, small, small), st.tuples(small, small, small), st.floats(-0.3, 0.4))
def test_a_point_moves_as_far_as_its_height_says(
    t: tuple[float, ...], turn: tuple[float, ...], height: float
):
    """Against the exact picture of a point at depth 1 / (1 + e) over the plane Z = 1 in both views."""
    pixels = np.array(((150.0, 100.0), (180.0, 130.0)))
    made = memory(pixels, height)
    rotation, n = exp_so3(np.array(turn)), np.array((0.0, 0.0, 1.0))
    made.move(rotation @ (np.eye(3) - np.outer(t, n)), rotation)
    rays = np.column_stack((CAMERA.undistort(pixels), np.ones(2)))
    space = (rays / (1 + height) - np.array(t)) @ rotation.T
    expected = CAMERA.project(space[:, :2] / space[:, 2:])
    assert made._pixels == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("remembered", [0, 2, 5])
def test_no_more_points_are_kept_than_are_asked_for(remembered: int, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(relief_memory, "_MOST", remembered)
    made = ReliefMemory(CAMERA, Cells(CAMERA, 80), 8.0)
    for k in range(4):
        made.add(np.array(((100.0 + 10 * k, 100.0),)), 0.1 * k)
    kept = [0.0, 0.1, 0.2, 0.3][4 - min(remembered, 4) :]
    assert made.heights == pytest.approx(kept)
    cell, height = made.unseen(np.zeros(100, bool))
    assert height == pytest.approx(kept)
    assert len(cell) == len(kept)


def test_without_a_prediction_all_is_forgotten():
    made = memory(np.array(((150.0, 100.0),)), 0.1)
    made.move(None)
    assert not len(made.heights)


def test_what_stands_high_leaves_the_view_before_the_ground_about_it():
    ground, high = (memory(np.array(((300.0, 120.0),)), height) for height in (0.0, 0.4))
    step = np.eye(3) - np.outer((-0.01, 0.0, 0.0), (0.0, 0.0, 1.0))
    left: dict[str, int] = {}
    for k in range(40):
        for name, made in (("ground", ground), ("high", high)):
            made.move(step, np.eye(3))
            if not len(made.heights):
                left.setdefault(name, k)
    assert left["high"] < left["ground"]


def test_what_goes_with_the_vehicle_is_not_remembered():
    """A skid moves against the plane as if it were infinitely far away: it would never leave the view."""
    made = ReliefMemory(CAMERA, Cells(CAMERA, 80), 8.0)
    pixels = np.array(((150.0, 100.0), (180.0, 130.0), (200.0, 130.0)))
    heights = np.array((-1.02, -0.9, 0.1))
    made.update(CAMERA.undistort(pixels), pixels, heights, made.cells.of(pixels), np.zeros(100, bool))
    assert made.heights == pytest.approx((-0.9, 0.1))


def test_what_the_mask_covers_is_forgotten():
    camera = copy(CAMERA)
    made = ReliefMemory(camera, Cells(camera, 80), 8.0)
    made.add(np.array(((150.0, 100.0), (180.0, 130.0))), 0.1)
    made.take_mask()
    assert len(made.heights) == 2
    camera.mask = np.zeros((camera.height, camera.width), bool)
    camera.mask[:, 140:160] = True
    made.take_mask()
    assert made._pixels == pytest.approx(np.array(((180.0, 130.0),)))
