"""How low the procedure may fly across the ground: over what rises near the vehicle, and over all it flew across."""

import math
from collections import deque

from landing.decision.orders import NAN, Inputs
from landing.decision.procedure_options import LOST_S

SURE_S = 1.0
"""So long ground must be seen to be that high: heights may be wrong for half a second, and what is flown across at full
speed is within reach for more than two."""
STAND_STILL = 0.8
"""Share of the least height below which nothing is flown level any more."""


class Headroom:
    """``step`` at every frame. Heights of the autopilot's position: the map's own wander over a minute."""

    def __init__(self) -> None:
        self._recent: deque[tuple[float, float]] = deque()
        self._highest_down = math.inf
        self._known_s = math.inf

    def begin(self, time_s: float) -> None:
        """A new procedure; nothing was seen."""
        self._recent.clear()
        self._highest_down, self._known_s = math.inf, time_s

    def step(self, i: Inputs) -> None:
        """Take a frame."""
        near = self.near(i)
        if i.local_ned is None or not math.isfinite(near):
            self._recent.clear()
            return
        self._known_s = i.time_s
        self._recent.append((i.time_s, i.local_ned[2] + near))
        if i.time_s - self._recent[0][0] < SURE_S:
            return
        self._highest_down = min(self._highest_down, max(down for _, down in self._recent))
        self._recent.popleft()

    def lost(self, i: Inputs) -> bool:
        """Whether the height has been unknown for too long to fly across the ground."""
        return not i.time_s - self._known_s <= LOST_S

    def near(self, i: Inputs) -> float:
        """Height over the highest ground about the vehicle, m; NaN while the height is unknown."""
        if not math.isfinite(i.height_m):
            return NAN
        return min(i.height_m, i.clear_m) if math.isfinite(i.clear_m) else i.height_m

    def all_around(self, i: Inputs) -> float:
        """Height over the highest ground that was flown across, m; NaN while the height is unknown."""
        near = self.near(i)
        return near if i.local_ned is None else min(near, self._highest_down - i.local_ned[2])


def level_share(room_m: float, least_m: float) -> float:
    """Share of a level speed that is flown with so much room: none well below the least, nor where it is unknown."""
    share = (room_m / least_m - STAND_STILL) / (1 - STAND_STILL)
    return min(max(share, 0.0), 1.0) if math.isfinite(share) else 0.0
