"""From estimates to the decision and, rarely, the request to land; and what became of that request."""

from dataclasses import dataclass

from companion.core.command import CommandChange, CommandState
from companion.core.health import HealthMonitor
from companion.messages.events import event
from companion.messages.messages import Decision, Event
from companion.settings.settings import Settings
from drivers.samples import CommandAnswer, Heartbeat, LandedState
from landing.decision.decision import Decider, Verdict
from landing.decision.permit import Permit, PermitInputs, PermitState
from landing.estimate import SurfaceEstimate
from landing.ground.landing_area import LandingArea
from landing.reasons import Code, Reason, codes, in_words

SECOND_US = 1_000_000


@dataclass(frozen=True, slots=True)
class LandRequest:
    """The autopilot is to be told to land."""

    frame: int
    time_unix_us: int
    text: str


Judgement = Decision | Event | LandRequest


class Judge:
    """Keeps the verdict, the permit and the command's state; tells decisions on change and once a second.

    ``now_us`` is always the steady companion time, by which inputs age; ``time_unix_us`` the companion's clock as
    stamped, for the messages.
    """

    def __init__(self, settings: Settings, health: HealthMonitor, area: LandingArea | None = None) -> None:
        self._health = health
        self._allowed_modes = settings.landing.allowed_modes
        self._decider = Decider(settings.decision, area)
        self._permit = Permit()
        self._command = CommandState(settings.landing.mode_timeout_s)
        self._enabled = settings.landing.enabled
        self._heartbeat: Heartbeat | None = None
        self._landed: LandedState | None = None
        self._verdict = Verdict("unknown", (Reason(Code.NOTHING_SEEN),), 0.0, False)
        self._frame = 0
        self._since_us = 0
        self._told: Decision | None = None

    def set_enabled(self, enabled: bool, now_us: int) -> None:
        """The user's permission; taking it back and giving it again allows another request."""
        self._enabled = enabled
        if not enabled:
            self._step_permit(now_us, fit=False)
            self._command.reset()

    def see(self, estimate: SurfaceEstimate, now_us: int, time_unix_us: int) -> list[Judgement]:
        """Take the next estimate."""
        out: list[Judgement] = []
        self._verdict = verdict = self._decider.step(estimate)
        self._frame = estimate.frame
        self._since_us = time_unix_us - round((estimate.time_s - verdict.since_s) * 1e6)
        if verdict.changed:
            reasons = in_words(verdict.reasons)
            text = "; ".join(reasons)
            text = f"surface {verdict.verdict}: {text}" if text else f"surface {verdict.verdict} for landing"
            details = {"verdict": verdict.verdict, "reasons": list(reasons)}
            out.append(event("decision_changed", estimate.frame, time_unix_us, text, details))
        return out + self.decide(now_us, time_unix_us, seen=estimate.flat)

    def no_frames(self, now_us: int, time_unix_us: int) -> list[Judgement]:
        """The camera went silent: what was last seen says nothing of what is below now."""
        out: list[Judgement] = []
        reasons = (Reason(Code.NO_FRAMES),)
        if self._verdict.verdict != "unknown":
            said = in_words(reasons)
            details = {"verdict": "unknown", "reasons": list(said)}
            out.append(event("decision_changed", None, time_unix_us, f"surface unknown: {said[0]}", details))
            self._since_us = time_unix_us
        self._verdict = Verdict("unknown", reasons, self._verdict.since_s, False)
        return out + self.decide(now_us, time_unix_us)

    def follow(
        self, sample: Heartbeat | LandedState | CommandAnswer, now_us: int, time_unix_us: int
    ) -> list[Judgement]:
        """Take what the autopilot says of itself and of the command."""
        if isinstance(sample, Heartbeat):
            self._heartbeat = sample
        elif isinstance(sample, LandedState):
            self._landed = sample
        changes = self._command.feed(sample)
        if not changes:
            return []
        return [*self._events_of(changes), *self.decide(now_us, time_unix_us)]

    def forget_autopilot(self) -> None:
        """The autopilot rebooted: nothing it said of itself holds any more."""
        self._heartbeat = self._landed = None

    def decide(
        self, now_us: int, time_unix_us: int, *, seen: bool = False, always: bool = False
    ) -> list[Judgement]:
        """Ask the permit and tell the decision when that is due; only what was just ``seen`` flat makes a request."""
        out: list[Judgement] = []
        permit = self._step_permit(now_us, fit=seen and self._verdict.verdict == "fit")
        if permit.request:
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
            permitted=permit.permitted,
            withheld=permit.withheld,
            requested=self._permit.requested,
            command=self._command.state,
        )
        last = self._told
        if always or last is None or _gist(decision) != _gist(last) or _due(decision, last):
            self._told = decision
            out.append(decision)
        return out

    def _step_permit(self, now_us: int, *, fit: bool) -> PermitState:
        stale = self._health.stale(now_us)
        if self._health.vehicles_clash:
            stale = (*stale, "two vehicles on the link")
        heartbeat = None if "heartbeat" in stale else self._heartbeat
        landed = None if "landed_state" in stale or self._landed is None else self._landed.state
        return self._permit.step(
            PermitInputs(
                time_s=now_us * 1e-6,
                verdict_fit=fit,
                enabled=self._enabled,
                armed=None if heartbeat is None else heartbeat.armed,
                in_air=None if landed in (None, "undefined") else landed == "in_air",
                mode_allowed=None if heartbeat is None else heartbeat.mode in self._allowed_modes,
                fresh=not stale,
                stale=stale,
                command_busy=self._command.busy,
            )
        )

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
    """What of a decision is told at once when it changes."""
    d = decision
    return d.verdict, d.permitted, d.withheld, d.requested, d.command


def _due(decision: Decision, last: Decision) -> bool:
    return abs(decision.time_unix_us - last.time_unix_us) >= SECOND_US
