"""Whether a surface is flat, and whether it has been flat long enough to be fit for landing."""

import math
from dataclasses import dataclass

from landing.estimate import SurfaceEstimate
from landing.ground.landing_area import LandingArea
from landing.options import DecisionOptions


@dataclass(frozen=True, slots=True)
class Verdict:
    """``verdict`` is "fit", "unfit" or "unknown"; ``reasons`` say in words what stands against landing."""

    verdict: str
    reasons: tuple[str, ...]
    since_s: float
    changed: bool


def against_flat(estimate: SurfaceEstimate, options: DecisionOptions, widen: float = 0.0) -> tuple[str, ...]:
    """What stands against calling the surface flat, in words; empty when it is flat.

    The upper bounds (``options.sigmas`` standard deviations) of inclination and roughness must lie below the
    limits, which ``widen`` relaxes by a share.
    """
    o = options
    if estimate.status != "ok":
        return (f"no estimate: {estimate.status.replace('_', ' ')}",)
    reasons = []
    inclination_limit = o.max_inclination_deg * (1 + widen)
    roughness_limit = o.max_roughness * (1 + widen)
    if not math.isfinite(estimate.inclination_deg):
        reasons.append("inclination unknown without an attitude")
    elif estimate.inclination_deg > inclination_limit:
        reasons.append(f"too steep: {estimate.inclination_deg:.1f} degrees, limit {inclination_limit:.1f}")
    else:
        upper = estimate.inclination_deg + o.sigmas * estimate.inclination_std_deg
        if not upper <= inclination_limit:
            reasons.append(
                f"inclination uncertain: {estimate.inclination_deg:.1f} degrees, may be {upper:.1f},"
                f" limit {inclination_limit:.1f}"
            )
    if not math.isfinite(estimate.roughness):
        reasons.append("roughness unknown")
    elif estimate.roughness > roughness_limit:
        sure = estimate.roughness - o.sigmas * estimate.roughness_std > roughness_limit
        how = "perhaps " if estimate.unsettled else "" if sure else "probably "
        reasons.append(
            f"{how}too rough: {estimate.roughness:.4f} of the distance, limit {roughness_limit:.4f}"
        )
    elif estimate.suspicious:
        reasons.append("perhaps too rough: something may stand out where ground has just come into view")
    else:
        upper = estimate.roughness + o.roughness_sigmas * estimate.roughness_std
        if not upper <= roughness_limit:
            reasons.append(
                f"roughness uncertain: {estimate.roughness:.4f}, may be {upper:.4f}, limit {roughness_limit:.4f}"
            )
    if estimate.standing > o.max_standing:
        reasons.append(f"too rough: {estimate.standing} points stand out, limit {o.max_standing}")
    if estimate.unlike:
        reasons.append(
            "perhaps another surface: what comes into view is unlike the rest and not measured yet"
        )
    if not estimate.coverage >= o.min_coverage:
        reasons.append(
            f"too little of the surface seen: {estimate.coverage:.2f}, at least {o.min_coverage:.2f}"
        )
    return tuple(reasons)


def against_landing(
    estimate: SurfaceEstimate, options: DecisionOptions, widen: float = 0.0, area: LandingArea | None = None
) -> tuple[str, ...]:
    """What stands against landing here: first what stands against flat, then what flat does not say.

    Relief over the distance shrinks with height: from far up a box looks even that would tip a vehicle over, so where
    the height is known the relief counts in metres, and the ground must be resolved finely enough to show such a box.
    And with ``area``, the place to land on must itself be among what was measured.
    """
    o = options
    reasons = against_flat(estimate, o, widen)
    if reasons:
        return reasons
    height_m = estimate.height_m
    if math.isfinite(height_m):
        upper = (estimate.roughness + o.roughness_sigmas * estimate.roughness_std) * height_m
        limit = o.max_relief_m * (1 + widen)
        if upper > limit:
            return (
                f"too high to tell: relief may be {upper:.3f} m from {height_m:.1f} m, limit {limit:.3f} m",
            )
    if area is None:
        return ()
    seen = area.look(estimate)
    limit = o.max_patch_m * (1 + widen)
    if seen.patch_m > limit:
        return (
            f"too high to tell: a track averages over {seen.patch_m:.2f} m from {height_m:.1f} m,"
            f" limit {limit:.2f} m",
        )
    least = o.min_area_measured * (1 - widen)
    if not seen.measured >= least:
        return (
            f"the ground to land on is not seen: {seen.measured:.2f} of it is measured, at least {least:.2f}",
        )
    return ()


class Decider:
    """The verdict over time: flat for a dwell time before it is fit, wider limits while it is.

    Without ``area`` nothing is asked of where in the picture the surface was measured.
    """

    def __init__(self, options: DecisionOptions, area: LandingArea | None = None) -> None:
        self.options, self.area = options, area
        self._flat_since: float | None = None
        self._seen_s = -math.inf
        self._verdict = Verdict("unknown", ("nothing seen yet",), math.nan, False)

    def step(self, estimate: SurfaceEstimate) -> Verdict:
        """Take the next estimate; times must not fall."""
        o, now = self.options, estimate.time_s
        fit = self._verdict.verdict == "fit"
        reasons = against_landing(estimate, o, o.hysteresis if fit else 0.0, self.area)
        if not reasons:
            if now - self._seen_s > o.patience_s:
                # after a silence nothing is known of what came between
                fit, self._flat_since = False, None
            self._seen_s = now
            if self._flat_since is None:
                self._flat_since = now
            held = now - self._flat_since
            if fit or held >= o.dwell_s:
                return self._turn("fit", (), now)
            return self._turn("unknown", (f"flat for {held:.1f} s only, {o.dwell_s:.1f} s asked for",), now)
        certain = any(reason.startswith(("too steep", "too rough", "too little")) for reason in reasons)
        doubtful = certain or any(reason.startswith("probably") for reason in reasons)
        if fit and not doubtful and now - self._seen_s <= o.patience_s:
            return self._turn("fit", (), now)
        if doubtful or now - self._seen_s > o.patience_s:
            self._flat_since = None
        return self._turn("unfit" if certain else "unknown", reasons, now)

    def _turn(self, verdict: str, reasons: tuple[str, ...], now: float) -> Verdict:
        changed = verdict != self._verdict.verdict
        since = now if changed or math.isnan(self._verdict.since_s) else self._verdict.since_s
        self._verdict = Verdict(verdict, reasons, since, changed)
        return self._verdict
