"""Whether the ground is at rest, over a procedure: it must have been known once, and never be clearly moving."""

import math

from landing.decision.orders import GroundMotion, Inputs

KNOWN_S, MOVES_S = 0.5, 1.0
"""How long either must hold."""
MOVES_AFTER_REST_S = 5.0
"""How long it must move where it was known to be at rest: the autopilot's velocity wanders, and uneven ground is no
plane; faster ground is a contradiction at once."""


class AtRest:
    """``step`` at every frame of a procedure."""

    def __init__(self) -> None:
        self.known = self.moves = False
        self._motion, self._since_s = GroundMotion.UNKNOWN, math.inf

    def begin(self) -> None:
        """A new procedure: nothing is known."""
        self.known = self.moves = False
        self._motion = GroundMotion.UNKNOWN

    def step(self, i: Inputs) -> None:
        """Take a frame."""
        if i.ground_motion is not self._motion:
            self._motion, self._since_s = i.ground_motion, i.time_s
        held_s = i.time_s - self._since_s
        if self._motion is GroundMotion.AT_REST and held_s >= KNOWN_S:
            self.known = True
        if self._motion is GroundMotion.MOVES and held_s >= (MOVES_AFTER_REST_S if self.known else MOVES_S):
            self.moves = True
