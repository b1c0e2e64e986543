"""STATUSTEXT for pilots: few, short, the reason first. Pure; time comes from the messages."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from companion.messages.conditions import Code as ConditionCode
from companion.messages.conditions import Condition, identity
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
"""A verdict is sent when it has lasted for this long, and good health too."""
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
    Code.RELIEF_UNRESOLVED: "too high",
    Code.GROUND_UNRESOLVED: "too high",
    Code.GROUND_NOT_SEEN: "landing area not seen",
    Code.DWELL: "flat, not for long enough",
    Code.UNCALIBRATED: "camera not calibrated",
    Code.TOUCHDOWN_HAZARD: "hazard where it lands",
    Code.TOUCHDOWN_UNKNOWN: "ground below not known",
    Code.STOPPING_POINT_UNKNOWN: "fly slower to land",
    Code.GROUND_MAY_MOVE: "ground may move",
    Code.GROUND_MOTION_UNKNOWN: "ground motion not known",
}
"""Code -> at most 25 characters."""

SHORT_CONDITIONS = {
    ConditionCode.INPUT_MISSING: "{subject}: none came",
    ConditionCode.INPUT_STALE: "{subject}: stopped",
    ConditionCode.VITAL_INPUT_MISSING: "{subject}: none came",
    ConditionCode.VITAL_INPUT_STALE: "{subject}: stopped",
    ConditionCode.CLOCKS_UNRELATED: "autopilot's time not known",
    ConditionCode.CAMERA_FROZEN: "picture frozen",
    ConditionCode.MASK_LARGE: "mask too large",
    ConditionCode.ATTITUDE_MISSING: "no attitude for pictures",
    ConditionCode.TWO_VEHICLES: "two vehicles, set system_id",
    ConditionCode.UNCALIBRATED: "camera not calibrated",
    ConditionCode.RECORDING_STOPPED: "not recording",
    ConditionCode.CLOCK_WITHOUT_DATE: "date not known",
    ConditionCode.RADIO_LOST: "pilot's switch not heard",
    ConditionCode.RATE_TOO_LOW: "rate too low: {subject}",
    ConditionCode.IMAGE_SIZE: "picture of another size",
    ConditionCode.OVERLOADED: "processor too slow",
    ConditionCode.READOUT_UNKNOWN: "camera readout not known",
    ConditionCode.ROTATION_CONTRADICTS: "picture and gyro disagree",
    ConditionCode.VELOCITY_CONTRADICTS: "ground, velocity disagree",
    ConditionCode.HEIGHT_CONTRADICTS: "heights disagree",
    ConditionCode.LATENESS_CONTRADICTS: "pictures too late",
    ConditionCode.VELOCITY_UNKNOWN: "velocity not known",
    ConditionCode.ATTITUDE_UNSURE: "roll and pitch unsure",
    ConditionCode.UNSIGNED: "unsigned messages refused",
}
"""Code -> few words without running numbers."""

SHORT_ENDS = {
    "landing_requested": "surface fit, landing requested",
    "landing_failsafe": "landing ended by a failsafe",
    "landing_held": "landing ended, hold requested",
    "landing_taken_over": "landing ended, pilot took over",
}

SHORT_PROCEDURE = {
    "start": "procedure takes over",
    "search": "procedure searches for a place",
    "go": "procedure goes to a place",
    "descend": "procedure descends",
    "hold": "procedure stops, place unfit",
    "hand_over": "procedure hands over to land",
}
"""State -> few words; short states are not sent."""
GAVE_BACK = "procedure ended"


class StatusTexts:
    """Turns decisions, health and events into texts, each kind at most once in ``AGAIN_US``."""

    def __init__(self) -> None:
        self._reported_us: dict[str, int] = {}
        self._verdict = ""
        self._since_us = 0
        self._reported_verdict = "unknown"
        self._reported: dict[tuple[str, str], Condition] = {}
        self._gone_us: dict[tuple[str, str], int] = {}
        self._well_reported = True
        self._id = 0

    def decision(self, decision: Decision) -> list[Any]:
        """The verdict, once it has lasted for a while and differs from the one sent last."""
        now_us = decision.time_unix_us
        if decision.verdict != self._verdict:
            self._verdict, self._since_us = decision.verdict, now_us
        stands = abs(now_us - self._since_us) >= STANDS_US
        if not stands or decision.verdict == self._reported_verdict or not self._may("verdict", now_us):
            return []
        self._reported_verdict = decision.verdict
        if not decision.reason_codes:
            return self._text("info", f"surface {decision.verdict}")
        code = decision.reason_codes[0]
        short = SHORT_REASONS[Code(code)] if code in set(Code) else code.replace("_", " ")
        return self._text("info", f"{short}, {decision.verdict}")

    def health(self, health: Health) -> list[Any]:
        """Conditions that begin; those that have been over for a while; and that all is well when it stays so."""
        now_us = health.time_unix_us
        standing = {identity(c): c for c in health.conditions}
        texts: list[Any] = []
        for key, found in standing.items():
            self._gone_us.pop(key, None)
            if key not in self._reported and self._may(f"condition {key}", now_us):
                self._reported[key] = found
                self._well_reported = False
                texts += self._text(found.severity, _short(found))
        for key in [key for key in self._reported if key not in standing]:
            gone_us = self._gone_us.setdefault(key, now_us)
            if abs(now_us - gone_us) >= STANDS_US:
                ended = self._reported.pop(key)
                if standing and self._may(f"end {key}", now_us):
                    texts += self._text("info", f"over: {_short(ended)}")
        if not standing and not self._reported and not self._well_reported and self._may("well", now_us):
            self._well_reported = True
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
        elif event.event == "procedure_gave_back":
            why = str(event.details.get("code", "")).replace("_", " ")
            text = f"{GAVE_BACK}: {why}"[: TEXT_LENGTH - len(PREFIX)]
        elif event.event == "procedure_changed" and event.details.get("state") in SHORT_PROCEDURE:
            text = SHORT_PROCEDURE[event.details["state"]]
        else:
            return []
        return self._text(event.severity, text) if self._may(text, event.time_unix_us) else []

    def _may(self, kind: str, now_us: int) -> bool:
        reported_us = self._reported_us.get(kind)
        if reported_us is not None and abs(now_us - reported_us) < AGAIN_US:
            return False
        self._reported_us[kind] = now_us
        return True

    def _text(self, severity: str, text: str) -> list[Any]:
        line = f"{PREFIX}{text}".encode("ascii", "replace")
        pieces = [line[i : i + TEXT_LENGTH] for i in range(0, len(line), TEXT_LENGTH)]
        number = 0
        if len(pieces) > 1:
            number = self._id = self._id % 0xFFFF + 1
        level = SEVERITIES[severity]
        return [dialect.MAVLink_statustext_message(level, piece, number, i) for i, piece in enumerate(pieces)]


def _short(found: Condition) -> str:
    words = SHORT_CONDITIONS[ConditionCode(found.code)]
    return words.format(subject=found.subject.replace("_", " ") if words.startswith("{") else found.subject)
