"""The wind as a vehicle shows it: how it leans against the air while its velocity does not change.

A multirotor that holds its place tilts until its thrust balances the drag (Neumann and Bartholmai 2015, "Real-time
wind estimation on a micro unmanned aerial vehicle using its inertial measurement unit"). The drag, m/s^2, is what is
left of its acceleration when that of the thrust is taken away; the vehicle's own motion through the air is part of
it, and small at the speeds of a landing.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

GRAVITY = 9.81
HELD_S = 4.0
"""Time constant of the mean, s: gusts and turns average out."""
DRIFT_S2 = 0.07
"""How far downwind a gust carries a vehicle that is landing, over the drag, s^2: a third of the drag more for 0.6 s,
until the autopilot has leaned against it."""
STEEPEST = 0.5
"""Least vertical part of the thrust: beyond, it is a manoeuvre and no lean."""


class Lean:
    """``step`` at every frame."""

    def __init__(self) -> None:
        self._time_s = np.nan
        self._drag, self._velocity = np.zeros(2), np.zeros(2)
        self._newest = np.zeros(2)

    def step(self, time_s: float, ned_from_body: Array | None, velocity_ned: Array | None) -> None:
        """Take a frame; a frame without attitude (3, 3) or velocity (3,) begins anew."""
        if ned_from_body is None or velocity_ned is None or not ned_from_body[2, 2] > STEEPEST:
            self._time_s = np.nan
            return
        thrust = -GRAVITY * ned_from_body[:2, 2] / ned_from_body[2, 2]
        interval_s = time_s - self._time_s
        self._time_s, self._newest = time_s, velocity_ned[:2]
        if not 0 <= interval_s < 1:
            self._drag, self._velocity = -thrust, self._newest
            return
        share = min(interval_s / HELD_S, 1.0)
        self._drag = self._drag + share * (-thrust - self._drag)
        self._velocity = self._velocity + share * (self._newest - self._velocity)

    @property
    def drift_m(self) -> tuple[float, float]:
        """Where a gust would carry the vehicle, m north and east; none while the lean is unknown."""
        # (v - mean v) / time constant is the mean of the acceleration
        drag = self._drag + (self._newest - self._velocity) / HELD_S
        if not (np.isfinite(self._time_s) and np.isfinite(drag).all()):
            return 0.0, 0.0
        return float(DRIFT_S2 * drag[0]), float(DRIFT_S2 * drag[1])
