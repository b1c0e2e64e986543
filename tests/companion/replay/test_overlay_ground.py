"""The ground map on the overlay: colours of heights, and the disc below at its place and size."""

import math

import numpy as np

from companion.replay.overlay_ground import DISC_COLOURS, HIGH, LEVEL, LOW, RELIEF, draw_disc, relief_colour
from landing.estimate import SurfaceEstimate
from landing.vision.camera import CameraModel

CAMERA = CameraModel.from_focal(320, 240, 256.0)
COLOUR = DISC_COLOURS["landable"]


def test_colours_go_from_low_over_level_to_high() -> None:
    stray = (1, 2, 3)
    assert relief_colour(0.0, True, stray) == LEVEL
    assert relief_colour(RELIEF, True, stray) == relief_colour(1.0, False, stray) == HIGH
    assert relief_colour(-RELIEF, False, stray) == LOW


def test_what_moves_by_itself_and_is_neither_high_nor_low_has_its_own_colour() -> None:
    stray = (1, 2, 3)
    assert relief_colour(0.0, False, stray) == relief_colour(math.nan, False, stray) == stray
    assert relief_colour(math.nan, True, stray) == LEVEL


def drawn(
    tilt_deg: float = 0.0,
    height_m: float = 4.0,
    radius_m: float = 0.5,
    aside_m: tuple[float, float] = (0.0, 0.0),
) -> np.ndarray:
    """Pixels (n, 2) x, y of the disc's edge; the camera is tilted about its x."""
    slope = math.tan(math.radians(tilt_deg))
    estimate = SurfaceEstimate(1, 0.0, "ok", "map", slope_x_deg=0.0, slope_y_deg=-tilt_deg, height_m=height_m)
    up = np.array((0.0, -slope, -1.0)) / math.hypot(slope, 1.0)
    picture = np.zeros((240, 320, 3), np.uint8)
    draw_disc(picture, estimate, CAMERA, 1, up, radius_m, COLOUR, aside_m)
    rows, columns = (picture == COLOUR).all(axis=2).nonzero()
    return np.column_stack((columns, rows))


def test_the_disc_has_its_size_and_place() -> None:
    edge = drawn()
    # half a metre from 4 m up, 256 px of focal length
    np.testing.assert_allclose(edge.mean(axis=0), (159.5, 119.5), atol=1.0)
    away = np.hypot(*(edge - edge.mean(axis=0)).T)
    assert abs(away.mean() - 32.0) < 1.5


def test_a_disc_ahead_and_to_the_right_is_up_and_to_the_right_in_the_picture() -> None:
    edge = drawn(aside_m=(0.5, 1.0))
    np.testing.assert_allclose(edge.mean(axis=0), (159.5 + 64, 119.5 - 32), atol=1.0)


def test_a_tilted_camera_has_it_aside() -> None:
    edge = drawn(tilt_deg=10.0)
    assert abs(edge.mean(axis=0)[1] - (119.5 + 256 * math.tan(math.radians(10.0)))) < 4


def test_nothing_is_drawn_where_the_height_is_unknown() -> None:
    assert not len(drawn(height_m=math.nan))
    assert not len(drawn(radius_m=math.nan))
