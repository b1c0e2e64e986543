"""Motion that shows the ground: back and forth across the heading, and lower where a pixel covers too much of it."""

import math

from landing.decision.guidance import ACCELERATION, Spiral
from landing.decision.level import autopilots
from landing.decision.orders import STILL, Inputs, Vector
from landing.decision.procedure_options import (
    ARM_SHARE,
    CLIMB_SPEED,
    LOOK_LOWER_S,
    LOOK_RADIUS_M,
    LOOK_SINK,
    LOWEST_LOOK_M,
    LOWEST_LOOK_SHARE,
    ProcedureOptions,
)


def lowest_look(options: ProcedureOptions) -> float:
    """Height to which looking and searching come down, m."""
    return max(LOWEST_LOOK_M, LOWEST_LOOK_SHARE * options.hand_over_m)


def new_spiral(begin: Inputs, height_m: float, time_s: float) -> Spiral:
    """A search about where the procedure began, by the autopilot's position: the view's wanders over a minute."""
    arm = ARM_SHARE * max(height_m, 0.5) if math.isfinite(height_m) else LOOK_RADIUS_M
    return Spiral(autopilots(begin), arm, time_s)


class Looking:
    """About the place where it began."""

    def __init__(self, options: ProcedureOptions) -> None:
        self._options = options
        self._from: Vector = STILL
        self._side = 1.0

    def begin(self, place_ned: Vector) -> None:
        """Look from here."""
        self._from = place_ned

    def sideways(self, i: Inputs, origin: Vector, speed: float) -> tuple[float, float]:
        """Velocity north and east: turned where it can still stop within the radius, and at the search's reach."""
        yaw = i.yaw if math.isfinite(i.yaw) else 0.0
        north, east = -math.sin(yaw), math.cos(yaw)
        off = (i.place_ned[0] - self._from[0]) * north + (i.place_ned[1] - self._from[1]) * east
        out_north, out_east = i.place_ned[0] - origin[0], i.place_ned[1] - origin[1]
        far = math.hypot(out_north, out_east) > self._options.max_search_m - LOOK_RADIUS_M
        outwards = (out_north * north + out_east * east) * self._side > 0
        moving = i.velocity_ned or STILL
        along = max((moving[0] * north + moving[1] * east) * self._side, 0.0)
        if off * self._side + along**2 / (2 * ACCELERATION) > LOOK_RADIUS_M or (far and outwards):
            self._side = -self._side
        return self._side * speed * north, self._side * speed * east

    def lower(self, room_m: float, looked_s: float) -> float:
        """Speed down while the ground stays unknown; 0 where it may go no lower. ``room_m`` over the highest ground."""
        if looked_s < LOOK_LOWER_S or not room_m > lowest_look(self._options):
            return 0.0
        return min(LOOK_SINK * room_m, CLIMB_SPEED)
