"""Is the surface flat, and has it been flat for long enough to be fit for landing?

In: one ``SurfaceEstimate`` per frame, the ground map's discs, the limits (``DecisionOptions``). Out: a ``Verdict``
with the reasons against landing. An unknown value (NaN) fails its check; without a height the ground map decides,
which needs metres. The permission to land is decided elsewhere (``permission.py``).
"""

import math
from dataclasses import dataclass
from typing import Protocol

from landing.estimate import SurfaceEstimate
from landing.ground.landing_area import LandingArea
from landing.ground.spots import HAZARD, LANDABLE, Disc
from landing.options import DecisionOptions
from landing.reasons import Certainty, Code, Reason, Status

_MOST_BLIND = 0.2
"""Share of the view in areas without tracks from which nothing is known of the whole: a blind quarter is beyond it."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """``verdict`` is "fit", "unfit" or "unknown"; ``reasons`` are those against landing.

    ``since_s``: time of the estimate at which the verdict began; ``changed``: whether it differs from the one before.
    """

    verdict: str
    reasons: tuple[Reason, ...]
    since_s: float
    changed: bool


def against_flat(
    estimate: SurfaceEstimate, options: DecisionOptions, widen: float = 0.0
) -> tuple[Reason, ...]:
    """Reasons against calling the surface flat; empty when it is flat.

    The upper bounds of inclination (deg; ``options.sigmas`` standard deviations) and roughness (relief over the
    distance; ``options.roughness_sigmas``) must be at most their limits, which are multiplied by 1 + ``widen``.
    """
    if estimate.status != Status.OK:
        return (Reason(Code.NO_ESTIMATE, status=estimate.status),)
    found = (
        _inclination(estimate, options, widen),
        _roughness(estimate, options, widen),
        _obstacles(estimate, options),
        Reason(Code.APPEARANCE_CHANGE) if estimate.appearance_change else None,
        _coverage(estimate, options),
    )
    return tuple(reason for reason in found if reason is not None)


def _inclination(estimate: SurfaceEstimate, o: DecisionOptions, widen: float) -> Reason | None:
    value, limit = estimate.inclination_deg, o.max_inclination_deg * (1 + widen)
    if not math.isfinite(value):
        return Reason(Code.INCLINATION_UNKNOWN)
    if value > limit:
        return Reason(Code.TOO_STEEP, Certainty.CERTAIN, value, limit=limit)
    upper = value + o.sigmas * estimate.inclination_std_deg
    return (
        None if upper <= limit else Reason(Code.INCLINATION_UNCERTAIN, value=value, upper=upper, limit=limit)
    )


def _roughness(estimate: SurfaceEstimate, o: DecisionOptions, widen: float) -> Reason | None:
    value, std, limit = estimate.roughness, estimate.roughness_std, o.max_roughness * (1 + widen)
    if not math.isfinite(value):
        return Reason(Code.ROUGHNESS_UNKNOWN)
    if value > limit:
        sure = Certainty.CERTAIN if value - o.sigmas * std > limit else Certainty.PROBABLE
        return Reason(Code.TOO_ROUGH, Certainty.POSSIBLE if estimate.unsettled else sure, value, limit=limit)
    if estimate.suspicious:
        return Reason(Code.ROUGHNESS_AT_BORDER)
    upper = value + o.roughness_sigmas * std
    return None if upper <= limit else Reason(Code.ROUGHNESS_UNCERTAIN, value=value, upper=upper, limit=limit)


def _obstacles(estimate: SurfaceEstimate, o: DecisionOptions) -> Reason | None:
    if not estimate.obstacle_points > o.max_standing:
        return None
    return Reason(Code.OBSTACLE_POINTS, Certainty.CERTAIN, estimate.obstacle_points, limit=o.max_standing)


def _coverage(estimate: SurfaceEstimate, o: DecisionOptions) -> Reason | None:
    if not estimate.blind <= _MOST_BLIND:
        return Reason(Code.COVERAGE_TOO_LOW, Certainty.CERTAIN, 1 - estimate.blind, limit=1 - _MOST_BLIND)
    if estimate.coverage >= o.min_coverage:
        return None
    return Reason(Code.COVERAGE_TOO_LOW, Certainty.CERTAIN, estimate.coverage, limit=o.min_coverage)


def against_landing(
    estimate: SurfaceEstimate,
    options: DecisionOptions,
    widen: float = 0.0,
    area: LandingArea | None = None,
    mapped: bool = False,
) -> tuple[Reason, ...]:
    """Reasons against landing here: those against flat, and when there are none, those that depend on the height.

    Relief over the distance decreases with height: from far up, a box that would tip the vehicle over looks even.
    Where the height is known, the relief is therefore limited in metres (``max_relief_m``), and so is the size on the
    ground of the patches that tracks average over (``max_patch_m``). With ``area``, the landing area itself must be in
    the tracks' sight, unless it is ``mapped``: the ground map knows what was measured there, also where a skid covers
    it now.
    """
    o = options
    reasons = against_flat(estimate, o, widen)
    if reasons:
        return reasons
    height_m = estimate.height_m
    upper = (estimate.roughness + o.roughness_sigmas * estimate.roughness_std) * height_m
    limit = o.max_relief_m * (1 + widen)
    # without a height there is only the relief over the distance; the ground map asks for metres
    if upper > limit:
        return (Reason(Code.RELIEF_UNRESOLVED, upper=upper, limit=limit, height_m=height_m),)
    if area is None:
        return ()
    seen = area.look(estimate)
    limit = o.max_patch_m * (1 + widen)
    if seen.patch_m > limit:
        return (Reason(Code.GROUND_UNRESOLVED, value=seen.patch_m, limit=limit, height_m=height_m),)
    least = o.min_area_measured * (1 - widen)
    if not mapped and not seen.measured >= least:
        return (Reason(Code.GROUND_NOT_SEEN, value=seen.measured, limit=least),)
    return ()


def against_motion(estimate: SurfaceEstimate, o: DecisionOptions, widen: float = 0.0) -> tuple[Reason, ...]:
    """What speaks against ground at rest: one standard deviation above what is found must be below the limit."""
    value, std, limit = estimate.ground_speed_m_s, estimate.ground_speed_std_m_s, o.max_ground_speed_m_s
    limit *= 1 + widen
    if value + std <= limit:
        return ()
    if not math.isfinite(value + std):
        return (Reason(Code.GROUND_MOTION_UNKNOWN),)
    sure = Certainty.PROBABLE if value - std > limit else Certainty.POSSIBLE
    return (Reason(Code.GROUND_MAY_MOVE, sure, value, value + std, limit),)


def against_touchdown(below: Disc, way: Disc, all_known: bool) -> tuple[Reason, ...]:
    """Reasons of the ground map against landing: the discs straight below and on the path to the stopping point.

    A vehicle that moves lands at its stopping point, ahead of where it is. No disc of the path may be a hazard
    (``way`` is the worst of them). The disc ``below`` must be landable, and with ``all_known`` so must all discs of
    the path: in fast or low flight they lie ahead of the measured ground, and only a slower flight makes them known.
    """
    for disc in (below, way):
        if disc.verdict == HAZARD:
            return (Reason(Code.TOUCHDOWN_HAZARD, Certainty.CERTAIN, status=", ".join(disc.reasons)),)
    asked = ((below, Code.TOUCHDOWN_UNKNOWN), (way, Code.STOPPING_POINT_UNKNOWN))
    for disc, code in asked if all_known else asked[:1]:
        if disc.verdict != LANDABLE or disc.reasons:
            return (Reason(code, status=", ".join(disc.reasons)),)
    return ()


class GroundBelow(Protocol):
    """What the decision needs of the ground map."""

    def under_way(self) -> tuple[Disc, Disc]:
        """At the newest frame: the disc straight below, and the worst from there to the stopping point."""
        ...


class _Held:
    """How long something has held."""

    def __init__(self) -> None:
        self.since_s, self.last_s = math.inf, -math.inf

    def step(self, now_s: float, patience_s: float) -> float:
        """It holds now; for how long, s. After a silence nothing is known of what came between."""
        if self.since_s > now_s or not now_s - self.last_s <= patience_s:
            self.since_s = now_s
        self.last_s = now_s
        return now_s - self.since_s

    def end(self) -> None:
        """It holds no longer."""
        self.since_s = math.inf


class Decider:
    """The verdict over time: "fit" after ``dwell_s`` without a reason against landing, with hysteresis.

    The ground at the stopping point, which comes nearer as the vehicle brakes, must have been known for
    ``options.patience_s`` only: the map has fused several looks at it. Without ``area`` nothing is asked of where in
    the picture the surface was measured, without ``ground`` nothing of the ground map.
    """

    def __init__(
        self, options: DecisionOptions, area: LandingArea | None = None, ground: GroundBelow | None = None
    ) -> None:
        self.options, self.area, self.ground = options, area, ground
        self._flat, self._known = _Held(), _Held()
        self._verdict = Verdict("unknown", (Reason(Code.NOTHING_SEEN),), math.nan, False)

    def step(self, estimate: SurfaceEstimate) -> Verdict:
        """The verdict after the next estimate; times must not decrease."""
        o, now = self.options, estimate.time_s
        fit = self._verdict.verdict == "fit"
        widen = o.hysteresis if fit else 0.0
        reasons = against_landing(estimate, o, widen, self.area, self.ground is not None)
        if not reasons and self.ground is not None:
            reasons = (o.at_rest_known and against_motion(estimate, o, widen)) or against_touchdown(
                *self.ground.under_way(), o.touchdown_known
            )
        # the surface below is flat all the same while the stopping point still lies ahead of what is known
        ahead = [reason.code for reason in reasons] == [Code.STOPPING_POINT_UNKNOWN]
        if ahead:
            self._flat.step(now, o.patience_s)
        if not reasons:
            flat_s, known_s = self._flat.step(now, o.patience_s), self._known.step(now, o.patience_s)
            for held_s, asked_s in ((flat_s, o.dwell_s), (known_s, min(o.patience_s, o.dwell_s))):
                if not held_s >= asked_s:
                    return self._turn("unknown", (Reason(Code.DWELL, value=held_s, limit=asked_s),), now)
            return self._turn("fit", (), now)
        certain = any(reason.certainty is Certainty.CERTAIN for reason in reasons)
        doubtful = any(reason.ends_verdict for reason in reasons)
        if fit and not doubtful and now - self._known.last_s <= o.patience_s:
            return self._turn("fit", (), now)
        if doubtful:
            self._flat.end()
        if ahead:
            self._known.end()
        return self._turn("unfit" if certain else "unknown", reasons, now)

    def _turn(self, verdict: str, reasons: tuple[Reason, ...], now: float) -> Verdict:
        changed = verdict != self._verdict.verdict
        since = now if changed or math.isnan(self._verdict.since_s) else self._verdict.since_s
        self._verdict = Verdict(verdict, reasons, since, changed)
        return self._verdict
