"""The autopilot's parameters that the chosen landing procedure depends on: what is wrong, and what to set."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from companion.doctor.findings import Finding, Level

LAND, TARGET, OFFBOARD = "land", "landing_target", "offboard"
"""The values of ``landing.procedure``."""
LONGEST_TIMEOUT_S = 1.0
"""So long may a vehicle fly on when the companion has died."""
SHORTEST_TIMEOUT_S = 0.3
"""Below this a single lost setpoint or two stop the vehicle."""


@dataclass(frozen=True, slots=True)
class Rule:
    """One parameter: ``wrong`` says of a value what is wrong with it, empty when nothing is."""

    name: str
    wrong: Callable[[float], str]
    level: Level
    remedy: str


def _time_out(value: float) -> str:
    if value > LONGEST_TIMEOUT_S:
        return "the vehicle flies on for so long when the companion has died"
    return "a few lost messages stop the vehicle" if value < SHORTEST_TIMEOUT_S else ""


def _is(*allowed: float, what: str) -> Callable[[float], str]:
    return lambda value: "" if value in allowed else what


def _has_bit(bit: int, what: str) -> Callable[[float], str]:
    return lambda value: "" if int(value) >> bit & 1 else what


def _lost(value: float) -> str:
    words = {
        -1: "nothing is done when the companion has died",
        0: "when the companion has died the pilot's sticks fly, and without sticks it returns",
        1: "when the companion has died the pilot must hold the position himself",
        2: "when the companion has died the pilot must level the vehicle himself",
        3: "when the companion has died it climbs and returns",
        4: "when the companion has died it lands on whatever is below",
        6: "when the companion has died the flight is terminated",
        7: "when the companion has died the motors stop",
    }
    return "" if value == 5 else words.get(int(value), "unknown")


ARDUPILOT = {
    OFFBOARD: (Rule("GUID_TIMEOUT", _time_out, "failure", "set GUID_TIMEOUT = 1"),),
    TARGET: (
        Rule("PLND_ENABLED", _is(1, what="LANDING_TARGET is not used"), "failure", "set PLND_ENABLED = 1"),
        Rule(
            "PLND_TYPE",
            _is(1, what="the place does not come from LANDING_TARGET"),
            "failure",
            "set PLND_TYPE = 1 and reboot the autopilot",
        ),
        Rule("PLND_YAW_ALIGN", _is(0, what="the place is turned away"), "failure", "set PLND_YAW_ALIGN = 0"),
        Rule(
            "PLND_LAND_OFS_X", _is(0, what="it lands beside the place"), "failure", "set PLND_LAND_OFS_X = 0"
        ),
        Rule(
            "PLND_LAND_OFS_Y", _is(0, what="it lands beside the place"), "failure", "set PLND_LAND_OFS_Y = 0"
        ),
        Rule(
            "PLND_XY_DIST_MAX",
            lambda value: "" if value > 0 else "it sinks however far the place is aside",
            "warning",
            "set PLND_XY_DIST_MAX = 2.5",
        ),
        Rule(
            "PLND_STRICT",
            _is(0, what="with a rangefinder it climbs and tries again when LANDING_TARGET stops"),
            "warning",
            "set PLND_STRICT = 0: it then lands where it is",
        ),
    ),
}
PX4 = {
    OFFBOARD: (
        Rule("COM_OF_LOSS_T", _time_out, "failure", "set COM_OF_LOSS_T = 1"),
        Rule("COM_OBL_RC_ACT", _lost, "failure", "set COM_OBL_RC_ACT = 5 (hold)"),
        Rule(
            "COM_RC_OVERRIDE",
            _has_bit(1, "the sticks do not end OFFBOARD, only the mode switch does"),
            "warning",
            "set COM_RC_OVERRIDE = 3",
        ),
    ),
    TARGET: (
        Rule(
            "PLD_BTOUT",
            lambda value: "" if value <= 5 else "it waits long for a place that is no longer sent",
            "warning",
            "set PLD_BTOUT = 5",
        ),
        Rule(
            "PLD_HACC_RAD",
            lambda value: "" if value <= 0.3 else "it sinks while the place is further aside than this",
            "warning",
            "set PLD_HACC_RAD = 0.2",
        ),
    ),
}
"""Procedure -> what must hold (sources: mode_guided.cpp, AC_PrecLand.cpp, failsafe.cpp, precland.cpp)."""
BY_AUTOPILOT = {"ardupilot": ARDUPILOT, "px4": PX4}


def names(procedure: str, autopilot: str | None) -> tuple[str, ...]:
    """The parameters to read."""
    return tuple(rule.name for rule in BY_AUTOPILOT.get(autopilot or "", {}).get(procedure, ()))


def parameter_findings(procedure: str, autopilot: str, values: Mapping[str, float]) -> list[Finding]:
    """One finding for each parameter that is wrong or could not be read; one in all when everything is well."""
    if procedure == LAND:
        return []
    if autopilot not in BY_AUTOPILOT:
        text = f"landing.procedure {procedure} was tried on ArduCopter and PX4 only, not on {autopilot}"
        return [Finding("procedure", "failure", text, 'set landing.procedure = "land"')]
    rules = BY_AUTOPILOT[autopilot][procedure]
    found: list[Finding] = []
    for rule in rules:
        value = values.get(rule.name)
        if value is None:
            found.append(Finding("procedure", "warning", f"{rule.name} could not be read", rule.remedy))
        elif wrong := rule.wrong(value):
            found.append(Finding("procedure", rule.level, f"{rule.name} is {value:g}: {wrong}", rule.remedy))
    return found or [Finding("procedure", "ok", f"{procedure}: {len(rules)} parameters of the autopilot fit")]
