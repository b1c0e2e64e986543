"""The numbers of the landing procedure: what its user sets, and the limits of its states."""

from dataclasses import dataclass

from landing.decision.orders import State, Why
from landing.decision.withheld import Withheld

OUR_MODES = frozenset({"GUIDED", "OFFBOARD"})
"""Flight modes in which an autopilot follows setpoints: ArduCopter's and PX4's."""
OWN = frozenset({Withheld.ALREADY_REQUESTED})
"""What stands against another request because this procedure has used the permission."""
LIMIT_S = {
    State.START: 3.0,
    State.LOOK: 20.0,
    State.CHOOSE: 2.0,
    State.GO: 20.0,
    State.DESCEND: 45.0,
    State.HOLD: 6.0,
}
"""How long each state may take; SEARCH ends with its spiral, all of it with ``max_time_s``."""
IN_VAIN = {
    State.START: Why.NOT_TAKEN,
    State.LOOK: Why.LOOKED_IN_VAIN,
    State.CHOOSE: Why.LOOKED_IN_VAIN,
    State.GO: Why.WAY_TOO_LONG,
    State.DESCEND: Why.DESCENT_TOO_LONG,
    State.HOLD: Why.LOOKED_IN_VAIN,
}
"""Why it gives back when that time is over."""
LOOK_LEAST_S = 2.5
"""So long it looks before it chooses, for the choice to be one."""
LOOK_ENOUGH_S = 12.0
"""Ground that is still unknown then is searched: more of the same motion would not show it."""
LOOK_LOWER_S = 5.0
"""Ground that is still unknown after so long is looked at from lower down, since a pixel covers less of it there."""
LOWEST_LOOK_M, LOWEST_LOOK_SHARE, LOOK_SINK = 1.8, 1.6, 0.15
"""Not below that height, that share of the hand-over's; and the sink over height meanwhile, 1/s."""
LOOK_RADIUS_M = 1.5
"""Farthest to each side while it looks."""
SEARCH_LOWER = 0.6
"""A search in vain is flown once more from so much of its height."""
ARM_SHARE = 0.7
"""Distance of the spiral's arms over the height: less than the picture is wide."""
SEARCH_FLOW = 0.4
"""Speed over height while it looks and searches, 1/s."""
CLIMB_M = 2.5
"""Farthest above the height at which it began."""
CLIMB_SPEED = 0.5
HOLD_CLIMB_SHARE, HOLD_CLIMB_M = 0.3, 1.0
"""How much it climbs where a place turned out unfit: of the height, and at most."""
ARRIVED_M, ARRIVED_SHARE = 0.25, 0.08
"""Over the place: so near, in metres and in shares of the height."""
SLOW_M_S = 0.25
"""Slow enough over the place to begin the descent, and to hand over."""
HANDED_OVER_M = 0.12
"""How near the stopping point must be to the place for the hand-over."""
SURE_S = 2.5
"""How long it circles over the place at most for its ground to be known before it comes down."""
UNSURE_S, UNKNOWN_S = 0.3, 1.5
"""How long the chosen disc may be unknown before it comes down slower, and until it stops."""
LOST_S = 0.5
"""How long the height may be unknown in a flight across the ground."""
CLIMB_UNKNOWN_S = 4.0
"""After so long without a height it climbs while it looks: from too near the pictures show none."""
TRIES = 4
FENCE_MARGIN_M = 1.5
"""Beyond the search: brakes and drift."""
LOWEST_SHARE = 0.75
"""Of the height from which the view holds the disc: below it nothing new is learnt of the place."""


@dataclass(frozen=True, slots=True)
class ProcedureOptions:
    """What the settings say; ``hand_over_m``: height below which the view no longer holds the vehicle's disc."""

    takeover_modes: frozenset[str] = frozenset()
    divergence: float = 0.25
    max_speed: float = 1.5
    max_search_m: float = 8.0
    max_time_s: float = 120.0
    hand_over_m: float = 1.3
