"""STATUSTEXT for pilots: few, short, the reason first. Pure; time comes from the messages."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from companion.messages.events import COMMAND_EVENTS
from companion.messages.messages import Decision, Event, Health
from landing.reasons import Code

PREFIX = "landslope: "
TEXT_LENGTH = 50
"""Characters of one STATUSTEXT; a longer text goes out in chunks that MAVLink 2 joins by ``id`` and ``chunk_seq``."""
SEVERITIES = {
    "info": dialect.MAV_SEVERITY_INFO,
    "warning": dialect.MAV_SEVERITY_WARNING,
    "error": dialect.MAV_SEVERITY_CRITICAL,
}
AGAIN_US = 5_000_000
"""At most one text of a kind in this time."""
STANDS_US = 1_000_000
"""A verdict is told when it has stood for this long, good health too."""
PERMISSION = {"landing_enabled": "landing enabled", "landing_disabled": "no landing"}

SHORT_REASONS = {
    Code.NOTHING_SEEN: "nothing seen yet",
    Code.NO_FRAMES: "no frames",
    Code.NO_ESTIMATE: "no estimate",
    Code.INCLINATION_UNKNOWN: "no attitude",
    Code.TOO_STEEP: "too steep",
    Code.INCLINATION_UNCERTAIN: "slope uncertain",
    Code.ROUGHNESS_UNKNOWN: "roughness unknown",
    Code.TOO_ROUGH: "too rough",
    Code.ROUGHNESS_AT_BORDER: "perhaps too rough",
    Code.ROUGHNESS_UNCERTAIN: "roughness uncertain",
    Code.OBSTACLE_POINTS: "obstacle",
    Code.APPEARANCE_CHANGE: "another surface ahead",
    Code.COVERAGE_TOO_LOW: "too little seen",
    Code.RELIEF_UNRESOLVED: "too high to tell",
    Code.GROUND_UNRESOLVED: "too high to tell",
    Code.GROUND_NOT_SEEN: "landing area not seen",
    Code.DWELL: "flat, not for long enough",
}
"""Code -> at most 25 characters."""

SHORT_PROBLEMS = {
    "clocks": "no time of the autopilot",
    "camera": "picture frozen",
    "two vehicles on the link": "two vehicles, set system_id",
}
"""Beginning of a problem -> at most 39 characters."""

SHORT_ENDS = {
    "landing_requested": "surface fit, landing requested",
    "landing_failsafe": "landing ended by a failsafe",
    "landing_held": "landing ended, we asked for hold",
    "landing_taken_over": "landing ended, pilot took over",
}


class StatusTexts:
    """Turns decisions, health and events into texts, each kind at most once in ``AGAIN_US``."""

    def __init__(self) -> None:
        self._told_us: dict[str, int] = {}
        self._verdict = ""
        self._since_us = 0
        self._told_verdict = "unknown"
        self._problems: frozenset[str] = frozenset()
        self._well_since_us: int | None = None
        self._well_told = True
        self._id = 0

    def decision(self, decision: Decision) -> list[Any]:
        """The verdict, once it has stood for a while and differs from what was told last."""
        now_us = decision.time_unix_us
        if decision.verdict != self._verdict:
            self._verdict, self._since_us = decision.verdict, now_us
        stands = abs(now_us - self._since_us) >= STANDS_US
        if not stands or decision.verdict == self._told_verdict or not self._may("verdict", now_us):
            return []
        self._told_verdict = decision.verdict
        if not decision.reason_codes:
            return self._text("info", f"surface {decision.verdict}")
        code = decision.reason_codes[0]
        short = SHORT_REASONS[Code(code)] if code in set(Code) else code.replace("_", " ")
        return self._text("info", f"{short}, {decision.verdict}")

    def health(self, health: Health) -> list[Any]:
        """New problems by their subject, without running numbers; that all is well when it stays so."""
        now_us = health.time_unix_us
        kinds = {problem.split(":")[0]: problem for problem in health.problems}
        severity = "warning" if health.state == "degraded" else "error"
        texts: list[Any] = []
        told = set(self._problems & kinds.keys())
        for kind in sorted(kinds.keys() - self._problems):
            if self._may(f"problem {kind}", now_us):
                told.add(kind)
                texts += self._text(severity, _short(kind, kinds[kind]))
                self._well_told = False
        self._problems = frozenset(told)
        if kinds:
            self._well_since_us = None
        elif self._well_since_us is None:
            self._well_since_us = now_us
        well = self._well_since_us is not None and abs(now_us - self._well_since_us) >= STANDS_US
        if well and not self._well_told and self._may("well", now_us):
            self._well_told = True
            texts += self._text("info", "all well")
        return texts

    def event(self, event: Event) -> list[Any]:
        """What became of a command, and permissions that began or ended."""
        if event.event in PERMISSION:
            why = event.text.removeprefix("landing is not enabled").removeprefix(": ")
            text = PERMISSION[event.event]
            if event.event == "landing_disabled" and why:
                text = f"{why}, {text}"
        elif event.event in COMMAND_EVENTS:
            text = SHORT_ENDS.get(event.event, event.text.removeprefix("command to "))
        else:
            return []
        return self._text(event.severity, text) if self._may(text, event.time_unix_us) else []

    def _may(self, kind: str, now_us: int) -> bool:
        told_us = self._told_us.get(kind)
        if told_us is not None and abs(now_us - told_us) < AGAIN_US:
            return False
        self._told_us[kind] = now_us
        return True

    def _text(self, severity: str, text: str) -> list[Any]:
        line = f"{PREFIX}{text}".encode("ascii", "replace")
        pieces = [line[i : i + TEXT_LENGTH] for i in range(0, len(line), TEXT_LENGTH)]
        number = 0
        if len(pieces) > 1:
            number = self._id = self._id % 0xFFFF + 1
        level = SEVERITIES[severity]
        return [dialect.MAVLink_statustext_message(level, piece, number, i) for i, piece in enumerate(pieces)]


def _short(kind: str, problem: str) -> str:
    if kind in SHORT_PROBLEMS:
        return SHORT_PROBLEMS[kind]
    return (
        f"{kind}: none came"
        if "none came" in problem
        else f"{kind}: stopped"
        if "none for" in problem
        else problem
    )
