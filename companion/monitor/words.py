"""Numbers and states as the page shows them: unknown is a dash, never a zero."""

from companion.messages.messages import Decision, Estimate, Health, InputHealth, ProcedureState

DASH = "–"
SILENT = "SILENT"
SAID_LAST = "The values below were the last to arrive; they may be out of date."
LARGEST_PLAIN = 1e6
"""Larger numbers are written with a power of ten."""
LONGEST_TEXT = 400
LATE_SHOWN_S = 0.003
COMPASS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
FORBIDDEN = "NO LANDING"
UNCALIBRATED = "the camera is not calibrated"
FAULTY = "FIT, WITH FAULTS"
VERDICTS = {"fit": "FIT TO LAND", "unfit": "NOT FIT", "unknown": "UNKNOWN"}
SIGNS = {"fit": "\u2714", "unfit": "\u2716", "unknown": "?", "caution": "!", "silent": "!"}
"""A shape for each verdict, for those who do not see the colours."""
STALE = ("stale", "missing")
MOST_STALE = 4
CONTACT_SHOWN_S = 60.0


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


FIGURES = (
    "inclination_deg",
    "height_m",
    "time_to_contact_s",
    "ventral_flow",
    "roughness",
    "slopes",
    "downhill_bearing_deg",
    "attitude",
)


def figures(e: Estimate | None) -> dict[str, str]:
    """The large numbers by field name."""
    if e is None:
        return dict.fromkeys(FIGURES, DASH)
    flow = (
        DASH
        if e.ventral_flow_x is None or e.ventral_flow_y is None
        else f"{_signed(e.ventral_flow_x)}, {_signed(e.ventral_flow_y)}"
    )
    return {
        "inclination_deg": with_spread(e.inclination_deg, e.inclination_std_deg, 1, "°"),
        "height_m": with_spread(e.height_m, e.height_std_m, 1, " m"),
        "time_to_contact_s": contact(e.time_to_contact_s),
        "ventral_flow": flow,
        "roughness": with_spread(e.roughness, e.roughness_std, 4, ""),
        "slopes": slopes(e),
        "downhill_bearing_deg": bearing(e.downhill_bearing_deg),
        "attitude": attitude(e.roll_deg, e.pitch_deg),
    }


def contact(seconds: float | None) -> str:
    """The time to contact as far as it means something."""
    if seconds is None:
        return DASH
    if seconds < 0:
        return "moving away"
    return number(seconds, 1, " s") if seconds <= CONTACT_SHOWN_S else "over a minute"


def attitude(roll_deg: float | None, pitch_deg: float | None) -> str:
    """The vehicle's roll and pitch."""
    if roll_deg is None or pitch_deg is None:
        return DASH
    side, end = ("right" if roll_deg > 0 else "left"), ("up" if pitch_deg > 0 else "down")
    return f"roll {abs(roll_deg):.0f}° {side}, nose {abs(pitch_deg):.0f}° {end}"


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
    """A compass point, and the bearing it was made of."""
    if degrees is None:
        return DASH
    return f"{COMPASS[round(degrees % 360 / 45) % len(COMPASS)]} ({round(degrees) % 360}°)"


def forbidding(health: Health | None) -> list[str]:
    """What forbids a landing whatever the surface is like, in words."""
    return [] if health is None else [c.text for c in health.conditions if c.forbids_landing]


def verdict(decision: Decision | None, health: Health | None = None, estimate: Estimate | None = None) -> str:
    """The verdict in capitals; a fit surface where something forbids a landing is no invitation to land."""
    if decision is None:
        return VERDICTS["unknown"]
    if decision.verdict == "fit":
        return {"fit": VERDICTS["fit"], "caution": FAULTY}.get(look(decision, health, estimate), FORBIDDEN)
    return VERDICTS.get(decision.verdict, decision.verdict.upper())


def look(decision: Decision | None, health: Health | None, estimate: Estimate | None = None) -> str:
    """The colour of the verdict: "fit" only while nothing at all is wrong with the vehicle."""
    if decision is None or decision.verdict not in VERDICTS:
        return "unknown"
    if decision.verdict != "fit":
        return decision.verdict
    uncalibrated = estimate is not None and not estimate.calibrated
    if uncalibrated or forbidding(health) or (health is not None and health.state not in ("ok", "degraded")):
        return "unknown"
    return "fit" if health is None or health.state == "ok" else "caution"


def battery(health: Health | None) -> str:
    """The battery's charge where it is known."""
    percent = getattr(health, "battery_percent", None)
    return "" if percent is None else f"battery {percent:.0f} %"


def status(estimate: Estimate | None, health: Health | None) -> list[tuple[str, bool]]:
    """What is uncalibrated, stale or recording, one text each; True: something is wrong."""
    parts: list[tuple[str, bool]] = []
    if estimate is not None:
        parts.append(("camera calibrated", False) if estimate.calibrated else ("camera NOT CALIBRATED", True))
    if health is None:
        return [*parts, ("no health yet", True)]
    stale = [
        f"{name.replace('_', ' ')} {found.state}"
        for name, found in health.inputs.items()
        if found.state in STALE
    ]
    parts += [(text, True) for text in stale[:MOST_STALE]] or [("all inputs fresh", False)]
    if health.recording is not None:
        parts.append(("recording", False) if health.recording else ("not recording", False))
    return parts


def flying(health: Health | None) -> tuple[str, str]:
    """(armed or not, flight mode)."""
    if health is None:
        return DASH, DASH
    armed = DASH if health.armed is None else "ARMED" if health.armed else "disarmed"
    return armed, health.mode or DASH


def against(decision: Decision | None, estimate: Estimate | None, health: Health | None = None) -> list[str]:
    """What stands against landing now, in words: first what forbids it whatever the surface."""
    if decision is None:
        return ["no decision has come yet"]
    forbidden = forbidding(health)
    if decision.verdict == "fit" and health is not None:
        forbidden += [problem for problem in health.problems if problem not in forbidden]
    if estimate is not None and not estimate.calibrated and UNCALIBRATED not in forbidden:
        forbidden.append(UNCALIBRATED)
    found = [*forbidden, *(reason for reason in decision.reasons if reason not in forbidden)]
    if estimate is not None and estimate.status != "ok":
        status = estimate.status.replace("_", " ")
        line = f"no estimate: {status}"
        if line not in found and status not in " ".join(found):
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


def steered(decision: Decision | None) -> ProcedureState | None:
    """The landing procedure of a decision; None where there is none."""
    found = decision.procedure if decision is not None else None
    return found if isinstance(found, ProcedureState) else None


def procedure(decision: Decision | None) -> str:
    """What the landing procedure does; a dash where there is none."""
    found = steered(decision)
    return DASH if found is None else f"{found.state.replace('_', ' ')}: {found.text}"


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
