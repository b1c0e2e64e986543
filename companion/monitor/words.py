"""Numbers and states as the page shows them: unknown is a dash, never a zero."""

from companion.messages.messages import Decision, Estimate, Health, InputHealth

DASH = "–"
SILENT = "SILENT"
SAID_LAST = "What follows is what it said last; it may not be true any more."
LARGEST_PLAIN = 1e6
"""Larger numbers are written with a power of ten."""
LONGEST_TEXT = 400
LATE_SHOWN_S = 0.003
COMPASS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")
FORBIDDEN = "NO LANDING"
VERDICTS = {"fit": "FIT TO LAND", "unfit": "NOT FIT", "unknown": "UNKNOWN"}


def number(value: float | None, digits: int, unit: str = "") -> str:
    """The value with its unit, a dash where it is unknown."""
    if value is None:
        return DASH
    return f"{value:.{digits}f}{unit}" if abs(value) < LARGEST_PLAIN else f"{value:.1e}{unit}"


def clipped(text: str) -> str:
    """A text of a vehicle, not longer than a page can bear."""
    return text if len(text) <= LONGEST_TEXT else text[:LONGEST_TEXT] + "…"


def with_spread(value: float | None, std: float | None, digits: int, unit: str) -> str:
    """The value with one standard deviation."""
    if value is None:
        return DASH
    return (
        number(value, digits, unit)
        if std is None
        else f"{number(value, digits)} ± {number(std, digits, unit)}"
    )


def figures(e: Estimate | None) -> dict[str, str]:
    """The large numbers by field name."""
    if e is None:
        return dict.fromkeys(
            (
                "inclination_deg",
                "time_to_contact_s",
                "ventral_flow",
                "roughness",
                "slopes",
                "downhill_bearing_deg",
            ),
            DASH,
        )
    flow = (
        DASH
        if e.ventral_flow_x is None or e.ventral_flow_y is None
        else f"{_signed(e.ventral_flow_x)}, {_signed(e.ventral_flow_y)}"
    )
    return {
        "inclination_deg": with_spread(e.inclination_deg, e.inclination_std_deg, 1, "°"),
        "time_to_contact_s": number(e.time_to_contact_s, 1, " s"),
        "ventral_flow": flow,
        "roughness": with_spread(e.roughness, e.roughness_std, 4, ""),
        "slopes": slopes(e),
        "downhill_bearing_deg": bearing(e.downhill_bearing_deg),
    }


def slopes(e: Estimate) -> str:
    """The surface's slope along and across the vehicle's heading."""
    if e.surface_pitch_deg is None or e.surface_roll_deg is None:
        return "ahead –, to the right –"
    ahead = "rises" if e.surface_pitch_deg > 0 else "falls"
    right = "falls" if e.surface_roll_deg > 0 else "rises"
    return (
        f"{ahead} {abs(e.surface_pitch_deg):.1f}° ahead, {right} {abs(e.surface_roll_deg):.1f}° to the right"
    )


def bearing(degrees: float | None) -> str:
    """A bearing with its compass point."""
    if degrees is None:
        return DASH
    return f"{degrees % 360:.0f}° {COMPASS[round(degrees % 360 / 45) % len(COMPASS)]}"


def verdict(decision: Decision | None, health: Health | None = None) -> str:
    """The verdict in capitals; a fit surface on which something forbids a landing is no invitation to land."""
    if decision is None:
        return VERDICTS["unknown"]
    if decision.verdict == "fit" and look(decision, health) != "fit":
        return FORBIDDEN
    return VERDICTS.get(decision.verdict, decision.verdict.upper())


def look(decision: Decision | None, health: Health | None) -> str:
    """As what the verdict is coloured: "fit" only where no standing condition forbids a landing."""
    if decision is None or decision.verdict not in VERDICTS:
        return "unknown"
    forbidden = health is not None and any(c.forbids_landing for c in health.conditions)
    return "unknown" if forbidden and decision.verdict == "fit" else decision.verdict


def against(decision: Decision | None, estimate: Estimate | None, health: Health | None = None) -> list[str]:
    """What stands against landing now, in words: first what forbids it whatever the surface."""
    if decision is None:
        return ["no decision has come yet"]
    forbidding = [] if health is None else [c.text for c in health.conditions if c.forbids_landing]
    found = [*forbidding, *(reason for reason in decision.reasons if reason not in forbidding)]
    if estimate is not None and estimate.status != "ok":
        line = f"no estimate: {estimate.status}"
        if line not in found and estimate.status not in " ".join(found):
            found.append(line)
    return found


def permission(decision: Decision | None) -> str:
    """Whether a landing may be requested, and what withholds it."""
    if decision is None:
        return DASH
    if decision.requested:
        return "given and used: a landing was requested"
    if decision.permitted:
        return "given"
    return "withheld: " + ("; ".join(decision.withheld) or "no reason given")


def command(decision: Decision | None) -> str:
    """The command to land and what became of it."""
    if decision is None or decision.command == "none":
        return "none sent"
    return decision.command


def input_line(found: InputHealth) -> tuple[str, str, str, str]:
    """State, rate, age and counters of one input."""
    refused = f", {found.refused} refused" if found.refused else ""
    return (
        found.state,
        number(found.rate_hz, 1, " Hz"),
        number(found.age_s, 2, " s"),
        f"{found.count}{refused}",
    )


def clock(health: Health | None) -> str:
    """How well the clocks agree, and the pipeline's time."""
    if health is None:
        return DASH
    std_ms = None if health.clock_std_s is None else 1000 * health.clock_std_s
    known = "clocks not set against each other yet" if std_ms is None else f"clocks agree to {std_ms:.1f} ms"
    late_s = health.camera_late_s
    if late_s is not None and abs(late_s) >= LATE_SHOWN_S:
        known += f"; frames {abs(1000 * late_s):.0f} ms {'later' if late_s > 0 else 'earlier'} than set"
    return f"{known}; pipeline {number(health.pipeline_ms, 1, ' ms')} a frame"


def duration(seconds: float) -> str:
    """A time that has passed, readable at a glance."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.0f} h"


def _signed(value: float) -> str:
    return ("+" if value >= 0 else "") + number(value, 2)
