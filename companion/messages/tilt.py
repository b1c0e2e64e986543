"""The surface as a plane in the vehicle's heading, for drawings."""

import math
from dataclasses import dataclass

from companion.messages.messages import Estimate

STEEPEST_DRAWN_DEG = 75.0


@dataclass(frozen=True, slots=True)
class Tilt:
    """A plane under the vehicle: down = 1 + ahead * x + right * y, lengths over the distance to it."""

    ahead: float
    right: float


def tilt_of(estimate: Estimate) -> Tilt | None:
    """The plane's tilt seen from the vehicle's heading; None while the surface is unknown.

    The direction is that of the per-axis angles (positive pitch rises ahead, positive roll falls to the
    right), the amount the inclination, which is the number that decides.
    """
    pitch, roll, inclination = (
        estimate.surface_pitch_deg,
        estimate.surface_roll_deg,
        estimate.inclination_deg,
    )
    if pitch is None or roll is None or inclination is None:
        return None
    ahead, right = -math.tan(_drawable(pitch)), math.tan(_drawable(roll))
    length = math.hypot(ahead, right)
    amount = math.tan(_drawable(inclination))
    return Tilt(ahead * amount / length, right * amount / length) if length else Tilt(0.0, 0.0)


def _drawable(angle_deg: float) -> float:
    return math.radians(max(-STEEPEST_DRAWN_DEG, min(STEEPEST_DRAWN_DEG, angle_deg)))
