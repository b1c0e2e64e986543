"""From estimates to the decision and, rarely, the request to land; and what became of that request."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import msgspec
import numpy as np
from numpy.typing import NDArray

from companion.core.approach import Approach, Ordered
from companion.core.command import Command, CommandChange, CommandState
from companion.core.consent import Consent
from companion.core.health import HealthMonitor
from companion.messages.events import event
from companion.messages.messages import Decision, Event
from companion.settings.settings import Settings
from drivers.samples import (
    CommandAnswer,
    CurrentMode,
    Heartbeat,
    LandedState,
    ManualControl,
    RcChannels,
    StatusText,
    SystemStatus,
)
from landing.decision.decision import Decider, GroundBelow, Verdict
from landing.decision.orders import OrderKind, Vector
from landing.decision.permission import Phase
from landing.decision.withheld import Withheld
from landing.estimate import SurfaceEstimate
from landing.ground.landing_area import LandingArea
from landing.options import DecisionOptions
from landing.reasons import Code, Reason, codes, in_words

Array = NDArray[np.float64]

SECOND_US = 1_000_000

Followed = (
    Heartbeat
    | CurrentMode
    | LandedState
    | CommandAnswer
    | RcChannels
    | ManualControl
    | SystemStatus
    | StatusText
)
"""Samples by which the permission and the command are followed."""

ENDS = {
    Command.TAKEN_OVER: Withheld.TAKEN_OVER,
    Command.FAILSAFE: Withheld.FAILSAFE,
    Command.HELD: Withheld.OWN_HOLD,
}
"""How a command ended -> what that makes of the permission."""


@dataclass(frozen=True, slots=True)
class LandRequest:
    """The autopilot is to be commanded to land."""

    frame: int
    time_unix_us: int
    text: str


Output = Decision | Event | LandRequest | Ordered


class DecisionLogic:
    """Keeps the verdict, the permission and the command's state; publishes decisions on change and once a second.

    ``now_us`` is always the steady companion time, by which inputs age; ``time_unix_us`` the companion's clock as
    stamped, for the messages. ``by_pilot``: see ``Consent``; changes of the permission are then events.
    """

    def __init__(
        self,
        settings: Settings,
        health: HealthMonitor,
        area: LandingArea | None = None,
        ground: GroundBelow | None = None,
        *,
        by_pilot: bool = False,
        approach: Callable[[Consent], Approach] | None = None,
    ) -> None:
        self._health = health
        self._decider = Decider(settings.decision, area, ground)
        self._consent = Consent(settings.landing, health, by_pilot=by_pilot)
        self._command = CommandState(settings.landing.mode_timeout_s)
        self._verdict = Verdict("unknown", (Reason(Code.NOTHING_SEEN),), 0.0, False)
        self._frame = 0
        self._since_us = 0
        self._reported: Decision | None = None
        self._against: str | None = None if by_pilot else ""
        self._by_pilot = by_pilot
        self._approach = None if approach is None else approach(self._consent)

    def set_decision(self, options: DecisionOptions, area: LandingArea | None) -> None:
        """Other limits from now on; the ground has to prove itself anew."""
        self._decider = Decider(options, area, self._decider.ground)

    def set_enabled(self, enabled: bool, now_us: int) -> None:
        """The user's permission; taking it back and giving it again allows another request."""
        self._consent.set_enabled(enabled, now_us)
        if not enabled:
            self._command.reset()

    def hold(self) -> None:
        """We ask the autopilot for hold: it is our doing when the landing ends now."""
        self._command.hold()
        self._consent.permission.end(Withheld.OWN_HOLD)

    def see(
        self, estimate: SurfaceEstimate, now_us: int, time_unix_us: int, attitude: Array | None = None
    ) -> list[Output]:
        """Take the next estimate; ``attitude`` is ned_from_body (3, 3) at its exposure."""
        out: list[Output] = []
        self._verdict = verdict = self._believed(self._decider.step(estimate))
        self._frame = estimate.frame
        self._since_us = time_unix_us - round((estimate.time_s - verdict.since_s) * 1e6)
        if verdict.changed:
            reasons = in_words(verdict.reasons)
            text = "; ".join(reasons)
            text = f"surface {verdict.verdict}: {text}" if text else f"surface {verdict.verdict} for landing"
            details = {"verdict": verdict.verdict, "reasons": list(reasons)}
            out.append(event("decision_changed", estimate.frame, time_unix_us, text, details))
        if self._approach is not None:
            ordered = self._approach.see(estimate, attitude, now_us, time_unix_us, busy=self._landing)
            out += self._obeyed(ordered, time_unix_us)
        return out + self.decide(now_us, time_unix_us, seen=estimate.flat)

    def locate(self, position_ned: Vector, now_us: int) -> None:
        """The autopilot's position, NED in m from an origin of its own."""
        if self._approach is not None:
            self._approach.locate(position_ned, now_us)

    def watch(self, now_us: int, time_unix_us: int, time_s: float) -> list[Output]:
        """Between frames: what ends the landing procedure ends it at once."""
        if self._approach is None:
            return []
        ordered = self._approach.watch(self._frame, now_us, time_unix_us, time_s)
        if not ordered:
            return []
        return self._obeyed(ordered, time_unix_us) + self.decide(now_us, time_unix_us)

    def _obeyed(self, ordered: list[Event | Ordered], time_unix_us: int) -> list[Output]:
        """The procedure's orders; its hand-over is a request to land as any other."""
        out: list[Output] = []
        for entry in ordered:
            out.append(entry)
            if isinstance(entry, Ordered) and entry.order.kind is OrderKind.LAND:
                text = "the place below is fit for landing"
                out += self._events_of(self._command.request(time_unix_us), text)
                out.append(LandRequest(self._frame, time_unix_us, text))
        return out

    @property
    def _landing(self) -> bool:
        """Whether the autopilot lands at our request, under the permission that stood then."""
        return self._command.busy and self._consent.permission.phase is Phase.USED

    def no_frames(self, now_us: int, time_unix_us: int) -> list[Output]:
        """The camera went silent: what was last seen says nothing of what is below now."""
        out: list[Output] = []
        reasons = (Reason(Code.NO_FRAMES),)
        if self._verdict.verdict != "unknown":
            said = in_words(reasons)
            details = {"verdict": "unknown", "reasons": list(said)}
            out.append(event("decision_changed", None, time_unix_us, f"surface unknown: {said[0]}", details))
            self._since_us = time_unix_us
        self._verdict = Verdict("unknown", reasons, self._verdict.since_s, False)
        return out + self.decide(now_us, time_unix_us)

    def follow(self, sample: Followed, now_us: int, time_unix_us: int) -> list[Output]:
        """Take what the autopilot says of itself, of its pilot and of the command."""
        self._consent.feed(sample, now_us)
        self._health.radio_lost = self._consent.radio_lost
        vehicle = self._consent.vehicle
        changes = self._command.feed(sample, vehicle.failsafe is True)
        if vehicle.pilot_took_over:
            changes += self._command.took_over(sample.arrival_us)
        out = self._ended(changes, time_unix_us)
        return [*out, *self.decide(now_us, time_unix_us)] if out else []

    def forget_autopilot(self, time_unix_us: int) -> list[Output]:
        """The autopilot rebooted: nothing it said of itself holds any more, nor what was permitted."""
        self._consent.reboot()
        return self._ended(self._command.reboot(time_unix_us), time_unix_us)

    def _ended(self, changes: list[CommandChange], time_unix_us: int) -> list[Output]:
        """The events of the command's changes, and of what they make of the permission."""
        out: list[Output] = [*self._events_of(changes)]
        for change in changes:
            if change.code in ENDS:
                self._consent.permission.end(ENDS[change.code])
        if self._consent.permission.phase is Phase.OFF:
            self._command.reset()
        return out + self._permission_change(time_unix_us)

    def _permission_change(self, time_unix_us: int) -> list[Output]:
        """The event of a permission that began or ended; none where it is given by hand."""
        against = self._consent.against_enabling if self._by_pilot else ""
        if against == self._against:
            return []
        self._against = against
        name = "landing_disabled" if against else "landing_enabled"
        return [event(name, None, time_unix_us, against)]

    def decide(
        self, now_us: int, time_unix_us: int, *, seen: bool = False, always: bool = False
    ) -> list[Output]:
        """Check the permission and publish the decision when it is due.

        Only an estimate that was just ``seen`` flat makes a request.
        """
        out: list[Output] = []
        withheld = self._consent.objections(now_us, command_busy=self._command.busy)
        out += self._permission_change(time_unix_us)
        permitted = not withheld
        flown = self._approach is not None and self._approach.kind == "offboard"
        if permitted and seen and self._verdict.verdict == "fit" and not flown:
            self._consent.permission.use()
            text = "the surface below is fit for landing"
            out += self._events_of(self._command.request(time_unix_us), text)
            out.append(LandRequest(self._frame, time_unix_us, text))
        decision = Decision(
            frame=self._frame,
            time_unix_us=time_unix_us,
            verdict=self._verdict.verdict,
            reasons=in_words(self._verdict.reasons),
            reason_codes=codes(self._verdict.reasons),
            since_unix_us=self._since_us,
            permitted=permitted,
            withheld=tuple(map(str, withheld)),
            withheld_codes=tuple(objection.code.value for objection in withheld),
            requested=self._requested,
            command=self._command.state,
            command_code=self._command.code.value,
            procedure=msgspec.UNSET if self._approach is None else self._approach.state or msgspec.UNSET,
        )
        last = self._reported
        if always or last is None or _gist(decision) != _gist(last) or _due(decision, last):
            self._reported = decision
            out.append(decision)
        return out

    @property
    def _requested(self) -> bool:
        """Whether a landing was requested under the present permission, which may have ended since."""
        return self._consent.permission.used

    def _believed(self, verdict: Verdict) -> Verdict:
        """Without a calibration no slope is known: such a camera may say unfit, never fit."""
        if self._health.calibrated or verdict.verdict != "fit":
            return verdict
        reasons = (Reason(Code.UNCALIBRATED),)
        changed = (self._verdict.verdict, codes(self._verdict.reasons)) != ("unknown", codes(reasons))
        return replace(verdict, verdict="unknown", reasons=reasons, changed=changed)

    def _events_of(self, changes: list[CommandChange], text: str = "") -> list[Event]:
        return [
            Event(
                event=change.event,
                frame=self._frame,
                time_unix_us=change.time_us,
                severity=change.severity,
                text=text or f"command to land: {change.state}",
            )
            for change in changes
        ]


def _gist(decision: Decision) -> tuple[object, ...]:
    """The part of a decision that is published at once when it changes."""
    d = decision
    procedure = () if isinstance(d.procedure, msgspec.UnsetType) else (d.procedure.state, d.procedure.code)
    return d.verdict, d.permitted, d.withheld, d.requested, d.command, procedure


def _due(decision: Decision, last: Decision) -> bool:
    return abs(decision.time_unix_us - last.time_unix_us) >= SECOND_US
