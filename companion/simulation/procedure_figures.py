"""The figures of a landing procedure that was flown: divergence, hand-over, time, distance from the place."""

import math
import statistics
from dataclasses import dataclass
from typing import TYPE_CHECKING

from landing.decision.orders import OrderKind, State

if TYPE_CHECKING:
    from companion.simulation.flight_result import FlightResult

SETTLED_S = 1.5
"""After the descent has begun: the vehicle has taken up its sink by then."""
NAN = math.nan


@dataclass(frozen=True, slots=True)
class Flown:
    """Truth of a procedure; NaN where it did not come so far. ``divergence`` is sink over height, 1/s."""

    divergence: float
    divergence_std: float
    hand_over_m_s: float
    seconds: float
    error_m: float


def flown(result: "FlightResult") -> Flown:
    """Of one flight; the height is over the ground below, the place is where the hand-over believed it."""
    steps, path = result.steps, result.path
    kinds = (OrderKind.START, OrderKind.TARGET)
    begun = next((s.time_s for s in steps if s.step.order.kind in kinds), NAN)
    # a landing autopilot is sent the place to the end
    handed = next((s for s in reversed(steps) if s.step.order.kind is OrderKind.LAND), None)
    last = handed or next((s for s in reversed(steps) if s.step.order.kind is OrderKind.TARGET), None)
    descent = [s for s in steps if s.step.state is State.DESCEND] if path else []
    from_s, values, k = (descent[0].time_s + SETTLED_S if descent else NAN), [], 0
    for s in descent:
        while k + 1 < len(path) and path[k + 1].time_s <= s.time_s:
            k += 1
        height = -s.position[2] - path[k].ground_m
        slow = s.step.order.velocity_ned[2] < 0.05
        if s.time_s >= from_s and height > 0 and not slow:
            values.append(s.velocity[2] / height)
    touch, error = result.touch_down, NAN
    if (
        last is not None
        and touch is not None
        and last.step.spot_ned is not None
        and last.step.place_ned is not None
    ):
        # map axes and the world's differ by where the vehicle was when the order was given
        aimed = [last.position[i] + last.step.spot_ned[i] - last.step.place_ned[i] for i in (0, 1)]
        error = math.dist(aimed, touch.position[:2])
    return Flown(
        statistics.fmean(values) if values else NAN,
        statistics.pstdev(values) if len(values) > 1 else NAN,
        handed.velocity[2] if handed is not None else NAN,
        (touch.time_s if touch is not None else steps[-1].time_s) - begun if steps else NAN,
        error,
    )
