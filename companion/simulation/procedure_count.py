"""Landing procedures over random scenes, counted: what became of them, and the figures of those that landed."""

import math
import statistics
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from companion.simulation.counting.shares import Share
from companion.simulation.flight_result import FlightResult
from companion.simulation.ground import SLOPE_MARGIN_DEG, unsafe
from companion.simulation.procedure_figures import flown
from companion.simulation.scenario import Scenario
from drivers.simulated.world.world import World
from landing.decision.orders import State

GRID_M = 0.1
SPARE_M = 0.2
"""Ground about the vehicle's disc that must be as good for a place to be clearly landable."""
EVEN_M = 0.03
"""Deviation from its plane of a disc that is clearly landable."""
LANDED = "landed"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a procedure; None where it did not come so far. ``ended`` is the code of its last state."""

    outcome: str
    ended: str
    reachable: bool
    """Whether there was a clearly landable disc within reach."""
    place_error_m: float | None
    """From the place that it handed over for to the touchdown."""
    hand_over_m_s: float | None
    """Down."""
    divergence_std: float | None
    procedure_s: float | None


class Counted(Protocol):
    """What an ``Outcome`` has, or a row that holds it."""

    @property
    def outcome(self) -> str: ...
    @property
    def ended(self) -> str: ...
    @property
    def reachable(self) -> bool: ...
    @property
    def place_error_m(self) -> float | None: ...
    @property
    def hand_over_m_s(self) -> float | None: ...
    @property
    def divergence_std(self) -> float | None: ...
    @property
    def procedure_s(self) -> float | None: ...


def outcome(scenario: Scenario, result: FlightResult) -> Outcome | None:
    """Of a flight; None where the settings name no procedure that moves the vehicle."""
    settings = scenario.flight_settings(None)
    if settings.landing.procedure != "offboard":
        return None
    limit_deg, radius_m = settings.decision.max_inclination_deg, settings.vehicle.landing_radius_m
    start = scenario.start.north_m, scenario.start.east_m
    reachable = landable_within(
        scenario.world(),
        start,
        settings.vehicle.max_search_m,
        radius_m + SPARE_M,
        limit_deg - SLOPE_MARGIN_DEG,
    )
    figures = flown(result)
    step = result.steps[-1].step if result.steps else None
    touched, ground = result.touch_down is not None, result.touch_ground
    landed = step is not None and step.state is State.HAND_OVER and touched
    none_due = scenario.expect.landing == "none"
    if touched and (not landed or none_due or ground is None or unsafe(ground, limit_deg)):
        word = "unsafe"
    else:
        word = "missed" if reachable and not none_due and not landed else "right"
    if step is None:
        ended = "never_began"
    elif landed:
        ended = LANDED
    else:
        ended = step.why.value if step.state is State.GIVE_BACK else f"in_{step.state.value}"
    numbers = figures.error_m, figures.hand_over_m_s, figures.divergence_std, figures.seconds
    return Outcome(word, ended, reachable, *(round(x, 4) if math.isfinite(x) else None for x in numbers))


def landable_within(
    world: World, middle: tuple[float, float], reach_m: float, radius_m: float, max_inclination_deg: float
) -> bool:
    """Whether a disc within reach is level and even, of the ground as it was built."""
    half = math.ceil((reach_m + radius_m) / GRID_M)
    axis = np.arange(-half, half + 1) * GRID_M
    height = np.array([[world.height_at(middle[0] + n, middle[1] + e) for e in axis] for n in axis])
    size = math.ceil(radius_m / GRID_M)
    offset = np.arange(-size, size + 1) * GRID_M
    down, across = np.meshgrid(offset, offset, indexing="ij")
    inside = np.hypot(down, across) <= radius_m + 1e-9
    x, y = down[inside], across[inside]
    design = np.column_stack([x, y, np.ones_like(x)])
    fit = np.linalg.pinv(design)
    steepest = math.tan(math.radians(max_inclination_deg))
    for i, j in _middles(axis, reach_m):
        i0, j0 = i - size, j - size
        if min(i0, j0) < 0 or max(i0, j0) + 2 * size >= len(axis):
            continue
        disc = height[i0 : i0 + 2 * size + 1, j0 : j0 + 2 * size + 1][inside]
        if not np.isfinite(disc).all():
            continue
        plane = fit @ disc
        if math.hypot(plane[0], plane[1]) <= steepest and np.abs(disc - design @ plane).max() <= EVEN_M:
            return True
    return False


def _middles(axis: NDArray[np.floating[Any]], reach_m: float) -> Iterator[tuple[int, int]]:
    for i, n in enumerate(axis):
        for j, e in enumerate(axis):
            if math.hypot(n, e) <= reach_m:
                yield i, j


def words(outcomes: Sequence[Counted]) -> list[str]:
    """The figures, several lines; none without a procedure."""
    if not outcomes:
        return []
    landed = [o for o in outcomes if o.ended == LANDED]
    reachable = [o for o in outcomes if o.reachable]
    unfit = Share(sum(o.outcome == "unsafe" for o in outcomes), len(outcomes))
    within = Share(sum(o.ended == LANDED and o.outcome == "right" for o in reachable), len(reachable))
    back = Counter(o.ended for o in outcomes if o.ended != LANDED)
    return [
        f"  landing procedures                          {len(outcomes)}, landed {len(landed)}",
        f"    touched down on unfit ground, or unasked  {unfit}",
        f"    landed where a landable disc was in reach {within}",
        f"    touchdown from the place                  {_spread([o.place_error_m for o in landed])} m",
        f"    down at the hand-over                     {_spread([o.hand_over_m_s for o in landed])} m/s",
        f"    deviation of the divergence               {_spread([o.divergence_std for o in landed], 3)} 1/s",
        f"    time                                      {_spread([o.procedure_s for o in landed], 1)} s",
        *(f"    not landed: {code:<29} {count}" for code, count in back.most_common()),
    ]


def _spread(values: Sequence[float | None], digits: int = 2) -> str:
    known = sorted(v for v in values if v is not None)
    if not known:
        return "not known,"
    at = known[round(0.95 * (len(known) - 1))]
    return f"median {statistics.median(known):.{digits}f}, 95 % {at:.{digits}f}, worst {known[-1]:.{digits}f}"
