"""Discs of the ground in the picture: known answers of a camera that looks straight down, and of one that leans."""

import numpy as np
import pytest

from companion.simulation.ground import discs_in_view
from landing.rotations import exp_so3
from landing.vision.camera import CameraModel

LENS = CameraModel(320, 240, np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]]))
DOWN = np.eye(3)
"""The camera's axes are north, east and down: its picture is 1.06 m north and 0.79 m east of the middle at 2 m."""
LEVEL = np.array([0.0, 0.0, 1.0])


def seen(
    places: list[tuple[float, float]], turned=DOWN, radius_m: float = 0.2, margin_px: float = 7.5
) -> list[bool]:
    return discs_in_view(LENS, turned, LEVEL @ turned, 2.0, np.array(places), radius_m, margin_px).tolist()


def test_a_disc_counts_when_all_of_it_lies_within_the_margin():
    # (159.5 - 7.5) / 300 x 2 m = 1.013 m north, (119.5 - 7.5) / 300 x 2 m = 0.747 m east, less the radius
    assert seen([(0, 0), (0.80, 0), (0.83, 0), (0, 0.53), (0, 0.56), (-0.80, -0.53)]) == [
        True, True, False, True, False, True,
    ]  # fmt: skip


def test_without_margin_and_size_it_is_the_picture():
    assert seen([(1.06, 0.79), (1.07, 0), (0, 0.80)], radius_m=0.0, margin_px=0.0) == [True, False, False]


def test_a_camera_that_leans_forward_sees_further_ahead():
    leans = exp_so3(np.array([0.0, 0.2, 0.0]))
    assert seen([(1.2, 0)], leans) == [True]
    assert seen([(-0.80, 0)], leans) == [False]


@pytest.mark.parametrize("turn", [np.pi, np.pi / 2])
def test_a_camera_that_looks_up_or_along_the_ground_sees_nothing_below(turn: float):
    assert not any(seen([(0, 0), (0.5, 0), (5, 0)], exp_so3(np.array([turn, 0.0, 0.0]))))


def test_a_surface_seen_from_behind_shows_nothing():
    assert discs_in_view(LENS, DOWN, -LEVEL, 2.0, np.zeros((1, 2)), 0.2, 7.5).tolist() == [False]
