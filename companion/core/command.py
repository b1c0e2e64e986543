"""What became of a command to land: followed from the request to the ground. Time comes from the samples."""

from dataclasses import dataclass

from drivers.samples import CommandAnswer, Heartbeat, LandedState, Sample

NAV_LAND = 21
"""MAV_CMD_NAV_LAND."""

LAND_MODES = frozenset({"LAND", "AUTO.LAND", "AUTO_LAND", "QLAND"})
"""Flight modes that mean the autopilot is landing."""

NO_ANSWER = "NO_ANSWER"
NO_AUTOPILOT = "NO_AUTOPILOT"
"""Results that the companion gives itself, beside MAVLink's, when the autopilot said nothing."""

OUTCOMES = {
    "DENIED": "refused: denied",
    "TEMPORARILY_REJECTED": "refused: temporarily rejected",
    "UNSUPPORTED": "refused: the autopilot does not know the command",
    "FAILED": "failed: the autopilot could not do it",
    "CANCELLED": "failed: cancelled",
    NO_ANSWER: "failed: no answer",
    NO_AUTOPILOT: "failed: no autopilot",
}
"""What an answer other than ACCEPTED and IN_PROGRESS makes of the command."""

NO_MODE_CHANGE = "failed: accepted, but the mode did not become LAND"
TAKEN_OVER = "taken over: the mode left LAND"

WAITING = frozenset({"requested", "in progress"})
"""States in which the answer is still to come."""


@dataclass(frozen=True, slots=True)
class CommandChange:
    """One step of the command, for an event: the state it went to."""

    state: str
    time_us: int
    severity: str

    @property
    def event(self) -> str:
        """Name of the event: landing_accepted, landing_refused, landing_failed, landing_landed..."""
        word = self.state.split(":")[0].replace(" ", "_")
        return "landing_started" if word == "landing" else f"landing_{word}"


class CommandState:
    """Follows one MAV_CMD_NAV_LAND: requested, answered, mode LAND seen, landed; or refused or failed, why.

    Nothing here repeats a command. ``mode_timeout_s``: how long an accepted one may take to change the mode.
    """

    def __init__(self, mode_timeout_s: float = 5.0) -> None:
        self.state = "none"
        self._mode_timeout_us = int(mode_timeout_s * 1e6)
        self._since_us = 0

    @property
    def busy(self) -> bool:
        """Whether a command is under way: another one must not go out."""
        return self.state in WAITING or self.state in ("accepted", "landing")

    def request(self, time_us: int) -> list[CommandChange]:
        """A request to land went out."""
        return self._go("requested", time_us)

    def reset(self) -> None:
        """Forget a command that ended; one under way is never forgotten."""
        if not self.busy:
            self.state = "none"

    def feed(self, sample: Sample) -> list[CommandChange]:
        """Take one sample; returns what changed, in order."""
        if self.state == "none":
            return []
        if isinstance(sample, CommandAnswer):
            return self._answer(sample) if sample.command == NAV_LAND else []
        if isinstance(sample, Heartbeat):
            return self._heartbeat(sample)
        if isinstance(sample, LandedState) and self.state == "landing" and sample.state == "on_ground":
            return self._go("landed", sample.arrival_us)
        return []

    def _answer(self, answer: CommandAnswer) -> list[CommandChange]:
        # An answer that comes after the wait was given up still tells the truth.
        if self.state not in WAITING and self.state != OUTCOMES[NO_ANSWER]:
            return []
        if answer.result == "ACCEPTED":
            return self._go("accepted", answer.arrival_us)
        if answer.result == "IN_PROGRESS":
            return self._go("in progress", answer.arrival_us) if self.state == "requested" else []
        outcome = OUTCOMES.get(answer.result, f"failed: {answer.result.lower().replace('_', ' ')}")
        return [] if outcome == self.state else self._go(outcome, answer.arrival_us)

    def _heartbeat(self, heartbeat: Heartbeat) -> list[CommandChange]:
        landing = heartbeat.mode in LAND_MODES
        if self.state == "landing":
            if not heartbeat.armed:
                return self._go("landed", heartbeat.arrival_us)
            return [] if landing else self._go(TAKEN_OVER, heartbeat.arrival_us)
        # The mode speaks even when the answer was lost on the way.
        if landing and (self.busy or self.state in (OUTCOMES[NO_ANSWER], NO_MODE_CHANGE)):
            changes = self._go("landing", heartbeat.arrival_us)
            return changes if heartbeat.armed else changes + self._go("landed", heartbeat.arrival_us)
        if self.state == "accepted" and heartbeat.arrival_us - self._since_us > self._mode_timeout_us:
            return self._go(NO_MODE_CHANGE, heartbeat.arrival_us)
        return []

    def _go(self, state: str, time_us: int) -> list[CommandChange]:
        self.state = state
        self._since_us = time_us
        good = state in WAITING or state in ("accepted", "landing", "landed")
        return [CommandChange(state, time_us, "info" if good else "warning")]
