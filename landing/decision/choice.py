"""Which of the landable discs is landed on: the best within reach, kept unless another is clearly better."""

import math

from landing.decision.orders import Inputs, Vector
from landing.ground.spots import Spot

FAR_HAZARD_M = 1.0
"""Clearance beyond this counts no more."""
WAY_COST = 0.25
"""A metre of way counts as much as so many metres of clearance."""
INCLINATION_COST, STEP_COST = 0.05, 10.0
"""A degree of inclination, and a metre of step, count as much as so many metres of clearance."""
CLEARLY_M = 0.4
"""Clearance by which another place must be better."""
SAME_M = 0.4
"""Discs nearer than this to the chosen place are the same place, seen better."""
FOLLOW = 0.2
"""Share of their distance by which the place follows at a look."""
REFUSED_M = 0.6
"""Nothing is chosen so near to a place that turned out unfit."""


def merit(spot: Spot) -> float:
    """In metres of clearance."""
    way = math.hypot(spot.north_m, spot.east_m)
    near = min(spot.clearance_m, FAR_HAZARD_M)
    return near - WAY_COST * way - INCLINATION_COST * spot.inclination_deg - STEP_COST * spot.step_m


class Choice:
    """The chosen place in the map's axes, and those that turned out unfit."""

    def __init__(self, reach_m: float) -> None:
        self._reach_m = reach_m
        self._begin_at = Inputs(time_s=math.nan)
        self.spot_ned: Vector | None = None
        self._refused: list[Vector] = []
        self._merit = 0.0
        """Of the chosen place, when it was among the best last."""

    def begin(self, i: Inputs) -> None:
        """A new procedure, from here."""
        self._begin_at = i
        self.forget()

    def forget(self) -> None:
        """No place is chosen, and none refused."""
        self.spot_ned = None
        self._refused = []

    def refuse(self) -> None:
        """The chosen place turned out unfit."""
        if self.spot_ned is not None:
            self._refused.append(self.spot_ned)
        self.drop()

    def drop(self) -> None:
        """Nothing is chosen; the place may be chosen again."""
        self.spot_ned = None

    def step(self, i: Inputs) -> bool:
        """Take the discs of a frame; whether another place is chosen."""
        if not i.spots:
            return False
        places = [(self._place(spot, i), spot) for spot in i.spots]
        here = [entry for entry in places if self._allowed(i, *entry)]
        if not here:
            return False
        best, spot = max(here, key=lambda entry: merit(entry[1]))
        if self.spot_ned is None:
            self.spot_ned, self._merit = best, merit(spot)
            return True
        chosen = self.spot_ned
        kept = self._kept(here, chosen)
        if kept is not None:
            self.spot_ned = chosen = _between(chosen, kept[0], FOLLOW)
            self._merit = merit(kept[1])
        if merit(spot) - self._merit <= CLEARLY_M:
            return False
        if _apart(best, chosen) <= SAME_M:
            return False
        self.spot_ned, self._merit = best, merit(spot)
        return True

    def follow(self, i: Inputs) -> None:
        """Keep the chosen place where the discs show it, and choose no other."""
        if self.spot_ned is None or not i.spots:
            return
        kept = self._kept([(self._place(spot, i), spot) for spot in i.spots], self.spot_ned)
        if kept is not None:
            self.spot_ned = _between(self.spot_ned, kept[0], FOLLOW)

    def _kept(self, here: list[tuple[Vector, Spot]], chosen: Vector) -> tuple[Vector, Spot] | None:
        """The disc that is the chosen place, as it is seen now."""
        same = [entry for entry in here if _apart(entry[0], chosen) <= SAME_M]
        return min(same, key=lambda entry: _apart(entry[0], chosen)) if same else None

    def _place(self, spot: Spot, i: Inputs) -> Vector:
        north, east, down = i.place_ned
        return (
            north + spot.north_m,
            east + spot.east_m,
            down + (i.height_m if math.isfinite(i.height_m) else 0.0),
        )

    def _allowed(self, i: Inputs, place: Vector, spot: Spot) -> bool:
        """Within reach by the view and by the autopilot, as the fence is, and no place that was refused."""
        reach = [_apart(place, self._begin_at.place_ned)]
        if i.local_ned is not None and self._begin_at.local_ned is not None:
            here = i.local_ned[0] + spot.north_m, i.local_ned[1] + spot.east_m, 0.0
            reach.append(_apart(here, self._begin_at.local_ned))
        if not all(m <= self._reach_m for m in reach):
            return False
        return all(_apart(place, refused) > REFUSED_M for refused in self._refused)


def _apart(a: Vector, b: Vector) -> float:
    return math.hypot(a[0] - b[0], a[1] - b[1])


def _between(a: Vector, b: Vector, share: float) -> Vector:
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])
