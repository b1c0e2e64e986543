"""Whether the vehicle has come to a place: near it, slow, and about to stop on it."""

import math

from landing.decision.orders import Inputs, Vector
from landing.decision.procedure_options import (
    ARRIVED_M,
    ARRIVED_SHARE,
    HANDED_OVER_M,
    SLOW_M_S,
    UNKNOWN_S,
    UNSURE_S,
)
from landing.ground.spots import HAZARD


def slow(i: Inputs, limit: float) -> bool:
    """Whether its level speed is known and at most ``limit``, m/s."""
    return i.velocity_ned is not None and math.hypot(*i.velocity_ned[:2]) <= limit


def over(i: Inputs, spot: Vector) -> bool:
    """Whether the stopping point is the place."""
    if not slow(i, SLOW_M_S):
        return False
    assert i.velocity_ned is not None  # as it is slow
    stop = i.place_ned[0] + i.velocity_ned[0], i.place_ned[1] + i.velocity_ned[1]
    return math.dist(stop, spot[:2]) <= HANDED_OVER_M


def beside(i: Inputs, spot: Vector, share: float) -> bool:
    """Whether it is farther from the place than a descent's circle, by that share of the height."""
    return not math.dist(i.place_ned[:2], spot[:2]) <= ARRIVED_M + share * i.height_m


def sink_share(i: Inputs, spot: Vector, unsure_s: float, low: float) -> float:
    """Of the usual divergence: less the longer the place has been unknown, and towards the hand-over (``low`` 1).

    None beside the place, nor over a hazard that may rise to the height of the hand-over: the height is that of the
    whole ground in view, and the disc's step is measured from its mean plane.
    """
    near = i.below.verdict == HAZARD and not i.height_m - 2 * i.below.step_m >= i.height_m / low
    if near:
        return 0.0
    off = math.dist(i.place_ned[:2], spot[:2]) - ARRIVED_M
    centred = min(max(3.0 - off / (ARRIVED_SHARE * i.height_m), 0.0), 1.0)
    sure = min(max((UNKNOWN_S - unsure_s) / (UNKNOWN_S - UNSURE_S), 0.0), 1.0)
    return centred * sure * min(max((low - 0.97) / 0.08, 0.0), 1.0)
