"""What the ground map says, drawn on the frame: relief as colour of the tracks, and the disc straight below."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from landing.estimate import SurfaceEstimate
from landing.vision.camera import CameraModel

Image = NDArray[np.uint8]
Colour = tuple[int, int, int]

DISC_COLOURS: dict[str, Colour] = {
    "landable": (90, 220, 60),
    "hazard": (60, 60, 255),
    "unknown": (190, 190, 190),
}
LOW: Colour = (255, 120, 40)
LEVEL: Colour = (90, 220, 120)
HIGH: Colour = (50, 80, 255)
RELIEF = 0.04
"""Height over the plane, over the distance, from which a point has the full colour of what is high or low."""


def relief_colour(height: float, fits: bool, stray: Colour) -> Colour:
    """Blue for what lies lower than the plane, green on it, red higher; ``stray`` what moves by itself."""
    if not fits and not abs(height) >= RELIEF / 2:
        return stray
    if not math.isfinite(height):
        return LEVEL
    share = min(1.0, abs(height) / RELIEF)
    end = HIGH if height > 0 else LOW
    blue, green, red = (round(a + share * (b - a)) for a, b in zip(LEVEL, end, strict=True))
    return blue, green, red


def draw_disc(
    picture: Image,
    estimate: SurfaceEstimate,
    camera: CameraModel,
    scale: int,
    up: NDArray[np.float64] | None,
    radius_m: float,
    colour: Colour,
    aside_m: tuple[float, float] = (0.0, 0.0),
) -> None:
    """The edge of a disc on the plane: straight below, or so far ahead and to the right of there."""
    if up is None or not (estimate.height_m > 0 and radius_m > 0):
        return
    slope = np.array([math.tan(math.radians(s)) for s in (estimate.slope_x_deg, estimate.slope_y_deg)])
    down = -up
    slant = float(down[2] - slope @ down[:2])
    if not slant > 0:
        return
    below = down / slant
    ahead = camera.body_from_camera[0] - (camera.body_from_camera[0] @ up) * up
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, up)
    angle = np.linspace(0, 2 * math.pi, 49)[:, None]
    # camera axes are right-handed with the third one down: ahead x up is to the right
    aside = (aside_m[0] + radius_m * np.cos(angle)) * ahead + (aside_m[1] + radius_m * np.sin(angle)) * right
    edge = below + aside / estimate.height_m
    # where that lies on the plane
    edge /= (edge[:, 2] - edge[:, :2] @ slope)[:, None]
    if (edge[:, 2] < 0.05).any():
        return
    pixels = (camera.project(edge[:, :2] / edge[:, 2:]) + 0.5) * scale - 0.5
    if not (np.abs(pixels) < 1e5).all():
        return
    cv2.polylines(picture, [np.rint(pixels).astype(np.int32)], True, colour, 3, cv2.LINE_AA)
