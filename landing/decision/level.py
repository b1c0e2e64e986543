"""Level flight across the ground: at an altitude that is kept, up and slower where there is too little room below."""

import math

from landing.decision.headroom import level_share
from landing.decision.orders import Inputs, Vector
from landing.decision.procedure_options import CLIMB_SPEED

GAIN = 0.8
"""Speed up or down per metre off the altitude, 1/s."""


class Level:
    """Keeps the altitude of the autopilot's position: the view's own wanders by its error of the height."""

    def __init__(self) -> None:
        self._down = math.nan

    def keep(self, i: Inputs, lower_m: float = 0.0) -> None:
        """The altitude of this frame, or so much lower."""
        self._down = autopilots(i)[2] + lower_m

    def across(
        self, i: Inputs, level: tuple[float, float], room_m: float, least_m: float, *, may_climb: bool
    ) -> Vector:
        """The velocity for a ``level`` one over ground that is ``room_m`` below where ``least_m`` are needed."""
        share = level_share(room_m, least_m)
        down = min(max(GAIN * (self._down - autopilots(i)[2]), -CLIMB_SPEED), CLIMB_SPEED)
        if not room_m > least_m:
            down = -CLIMB_SPEED if may_climb else 0.0
            self.keep(i)
        return share * level[0], share * level[1], down


def autopilots(i: Inputs) -> Vector:
    """The vehicle's place by the autopilot, m NED; nothing starts without one, and the fence ends what loses it."""
    assert i.local_ned is not None
    return i.local_ned
