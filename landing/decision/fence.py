"""The fence of a landing procedure: how far from where it began, how high, how low, how long."""

import math

from landing.decision.guidance import ACCELERATION
from landing.decision.orders import Inputs, State, Vector, Why
from landing.decision.procedure_options import CLIMB_M, FENCE_MARGIN_M, LOWEST_SHARE, ProcedureOptions

CLIMB_MARGIN_M = 1.0
"""Above the highest that is asked for: brakes and errors of the height."""


class Fence:
    """About the frame at which a procedure began. Whatever is unknown is outside."""

    def __init__(self, options: ProcedureOptions, begin: Inputs) -> None:
        self._options, self._begin = options, begin

    def against(self, i: Inputs, state: State) -> tuple[Why, str] | None:
        """Why the procedure ends at this frame, and what was found; None within the fence."""
        o, begin = self._options, self._begin
        if i.contradictions:
            return Why.CONTRADICTED, i.contradictions[0]
        if i.local_ned is None or begin.local_ned is None:
            return Why.PERMISSION_ENDED, "no position"
        # whichever of view and autopilot says farther
        away = [
            math.dist(here[:2], start[:2])
            for here, start in ((i.place_ned, begin.place_ned), (i.local_ned, begin.local_ned))
        ]
        if not all(m <= o.max_search_m + FENCE_MARGIN_M for m in away):
            return Why.FENCE_DISTANCE, f"{max(away):.1f} m"
        rise = risen(begin, i)
        if not rise <= CLIMB_M + CLIMB_MARGIN_M:
            return Why.FENCE_HEIGHT, f"{rise:.1f} m above the start"
        if state is State.DESCEND and i.height_m < LOWEST_SHARE * o.hand_over_m:
            return Why.FENCE_HEIGHT, f"{i.height_m:.1f} m"
        if not i.time_s - begin.time_s <= o.max_time_s:
            return Why.FENCE_TIME, ""
        return None

    def held_in(self, i: Inputs, wanted: Vector) -> Vector:
        """The velocity without what leads out, by view or autopilot; beyond half the margin it leads back."""
        north, east, down = wanted
        for here, begin in ((i.place_ned, self._begin.place_ned), (i.local_ned, self._begin.local_ned)):
            if here is None or begin is None:
                continue
            to_north, to_east = here[0] - begin[0], here[1] - begin[1]
            away = math.hypot(to_north, to_east)
            if not away > 0:
                continue
            to_north, to_east = to_north / away, to_east / away
            room = self._options.max_search_m + FENCE_MARGIN_M / 2 - away
            too_fast = (
                north * to_north + east * to_east - math.copysign(math.sqrt(ACCELERATION * abs(room)), room)
            )
            if too_fast > 0:
                north, east = north - too_fast * to_north, east - too_fast * to_east
        return north, east, down


def risen(begin: Inputs, now: Inputs) -> float:
    """How far up it has come, m: by the view or the autopilot, whichever says more. NaN while the view's is unknown."""
    seen = begin.place_ned[2] - now.place_ned[2]
    if begin.local_ned is None or now.local_ned is None:
        return seen
    return max(seen, begin.local_ned[2] - now.local_ned[2]) if math.isfinite(seen) else seen
