"""What became of a command to land: followed from the request to the ground. Time comes from the samples."""

from dataclasses import dataclass
from enum import StrEnum

from drivers.autopilot.outcome import NO_ANSWER, NO_AUTOPILOT
from drivers.commands import DO_SET_MODE, HOLD_MODES, LAND_MODES, NAV_LAND
from drivers.samples import CommandAnswer, CurrentMode, Heartbeat, LandedState, Sample


class Command(StrEnum):
    """State of a command; the value is the code that messages carry."""

    NONE = "none"
    REQUESTED = "requested"
    IN_PROGRESS = "in_progress"
    ACCEPTED = "accepted"
    LANDING = "landing"
    LANDED = "landed"
    DENIED = "denied"
    TEMPORARILY_REJECTED = "temporarily_rejected"
    UNSUPPORTED = "unsupported"
    FAILED = "failed"
    CANCELLED = "cancelled"
    NO_ANSWER = "no_answer"
    NO_AUTOPILOT = "no_autopilot"
    AMBIGUOUS_VEHICLE = "ambiguous_vehicle"
    TOO_LATE = "too_late"
    OTHER_RESULT = "other_result"
    NO_MODE_CHANGE = "no_mode_change"
    REBOOTED = "rebooted"
    HELD = "held"
    FAILSAFE = "failsafe"
    TAKEN_OVER = "taken_over"


WORDS = {
    Command.NONE: "none",
    Command.REQUESTED: "requested",
    Command.IN_PROGRESS: "in progress",
    Command.ACCEPTED: "accepted",
    Command.LANDING: "landing",
    Command.LANDED: "landed",
    Command.DENIED: "refused: denied",
    Command.TEMPORARILY_REJECTED: "refused: temporarily rejected",
    Command.UNSUPPORTED: "refused: the autopilot does not know the command",
    Command.FAILED: "failed: the autopilot could not do it",
    Command.CANCELLED: "failed: cancelled",
    Command.NO_ANSWER: "failed: no answer",
    Command.NO_AUTOPILOT: "failed: no autopilot",
    Command.AMBIGUOUS_VEHICLE: "failed: ambiguous vehicle",
    Command.TOO_LATE: "failed: too late",
    Command.OTHER_RESULT: "failed: an unknown answer",
    Command.NO_MODE_CHANGE: "failed: accepted, but the mode did not become LAND",
    Command.REBOOTED: "failed: the autopilot rebooted",
    Command.HELD: "held: landslope asked for hold",
    Command.FAILSAFE: "failsafe: the autopilot left LAND in a failsafe",
    Command.TAKEN_OVER: "taken over: the mode left LAND",
}
"""Code -> words, as in ``Decision.command``; the word before the colon names the event."""

ANSWERS = {
    "ACCEPTED": Command.ACCEPTED,
    "IN_PROGRESS": Command.IN_PROGRESS,
    "DENIED": Command.DENIED,
    "TEMPORARILY_REJECTED": Command.TEMPORARILY_REJECTED,
    "UNSUPPORTED": Command.UNSUPPORTED,
    "FAILED": Command.FAILED,
    "CANCELLED": Command.CANCELLED,
    NO_ANSWER: Command.NO_ANSWER,
    NO_AUTOPILOT: Command.NO_AUTOPILOT,
    "AMBIGUOUS_VEHICLE": Command.AMBIGUOUS_VEHICLE,
    "TOO_LATE": Command.TOO_LATE,
}
"""MAVLink's results and our own -> what they make of the command."""

WAITING = frozenset({Command.REQUESTED, Command.IN_PROGRESS})
"""States in which the answer is still to come."""

UNDER_WAY = WAITING | {Command.ACCEPTED, Command.LANDING}
GOOD = UNDER_WAY | {Command.LANDED}


@dataclass(frozen=True, slots=True)
class CommandChange:
    """One step of the command, for an event: the state it went to."""

    code: Command
    time_us: int

    @property
    def state(self) -> str:
        """In words."""
        return WORDS[self.code]

    @property
    def severity(self) -> str:
        """Of the event."""
        return "info" if self.code in GOOD or self.code is Command.HELD else "warning"

    @property
    def event(self) -> str:
        """Name of the event: landing_accepted, landing_refused, landing_failed, landing_landed..."""
        word = self.state.split(":")[0].replace(" ", "_")
        return "landing_started" if word == "landing" else f"landing_{word}"


class CommandState:
    """Follows one MAV_CMD_NAV_LAND: requested, answered, mode LAND seen, landed; or refused or failed, why.

    Nothing here repeats a command. ``mode_timeout_s``: how long an accepted one may take to change the mode. What
    ends a landing in the air is distinguished: our own hold, a failsafe, or else the pilot.
    """

    def __init__(self, mode_timeout_s: float = 5.0) -> None:
        self.code = Command.NONE
        self._mode_timeout_us = int(mode_timeout_s * 1e6)
        self._since_us = 0
        self._holding = False
        self._hold_accepted = False
        self._mode_heard = self._given_in = ""

    @property
    def state(self) -> str:
        """The state in words."""
        return WORDS[self.code]

    @property
    def busy(self) -> bool:
        """Whether a command is under way: another one must not go out."""
        return self.code in UNDER_WAY

    def request(self, time_us: int) -> list[CommandChange]:
        """A request to land went out."""
        self._holding = self._hold_accepted = False
        self._given_in = self._mode_heard
        return self._go(Command.REQUESTED, time_us)

    def hold(self) -> None:
        """We ask for hold ourselves."""
        self._holding = self.busy

    def reset(self) -> None:
        """Forget a command that ended; one under way is never forgotten."""
        if not self.busy:
            self.code = Command.NONE

    def reboot(self, time_us: int) -> list[CommandChange]:
        """The autopilot rebooted: a command under way is gone with it."""
        return self._go(Command.REBOOTED, time_us) if self.busy else []

    def took_over(self, time_us: int) -> list[CommandChange]:
        """The autopilot says in words that the pilot took over."""
        return self._go(Command.TAKEN_OVER, time_us) if self.busy else []

    def feed(self, sample: Sample, failsafe: bool = False) -> list[CommandChange]:
        """Take one sample, ``failsafe``: whether the autopilot is in one; returns what changed, in order."""
        if isinstance(sample, CommandAnswer):
            return self._answer(sample)
        if isinstance(sample, Heartbeat):
            return self._mode(sample.mode, sample.armed, sample.arrival_us, failsafe)
        if isinstance(sample, CurrentMode):
            return self._mode(sample.mode, True, sample.arrival_us, failsafe)
        if isinstance(sample, LandedState):
            return self._landed(sample)
        return []

    def _answer(self, answer: CommandAnswer) -> list[CommandChange]:
        if answer.command == DO_SET_MODE and self._holding and answer.result == "ACCEPTED":
            self._hold_accepted = True
            return []
        # An answer that comes after the wait was given up is still true.
        if answer.command != NAV_LAND or not (self.code in WAITING or self.code is Command.NO_ANSWER):
            return []
        code = ANSWERS.get(answer.result, Command.OTHER_RESULT)
        if code is self.code or (code is Command.IN_PROGRESS and self.code is not Command.REQUESTED):
            return []
        return self._go(code, answer.arrival_us)

    def _landed(self, sample: LandedState) -> list[CommandChange]:
        if self.code is Command.LANDING:
            if sample.state == "on_ground":
                return self._go(Command.LANDED, sample.arrival_us)
            if sample.state == "in_air" and self._hold_accepted:
                return self._go(Command.HELD, sample.arrival_us)
        elif self.code is Command.ACCEPTED and sample.state == "landing":
            # PX4's HEARTBEAT comes once a second: a takeover within that second would go unseen
            return self._go(Command.LANDING, sample.arrival_us)
        return []

    def _mode(self, mode: str, armed: bool, time_us: int, failsafe: bool) -> list[CommandChange]:
        lands, self._mode_heard = mode in LAND_MODES, mode
        if self.code is Command.LANDING:
            if not armed:
                return self._go(Command.LANDED, time_us)
            return [] if lands else self._go(self._who_ended_it(mode, failsafe), time_us)
        # The mode speaks even when the answer was lost on the way.
        if lands and (self.busy or self.code in (Command.NO_ANSWER, Command.NO_MODE_CHANGE)):
            changes = self._go(Command.LANDING, time_us)
            return changes if armed else changes + self._go(Command.LANDED, time_us)
        if self.code is Command.ACCEPTED:
            if self._holding and mode in HOLD_MODES:
                return self._go(Command.HELD, time_us)
            if self._given_in and mode not in (self._given_in, *HOLD_MODES):
                # PX4's HEARTBEAT comes once a second: LAND came and went unseen. HOLD is also where a procedure stops.
                return self._go(self._who_ended_it(mode, failsafe), time_us)
            if time_us - self._since_us > self._mode_timeout_us:
                return self._go(Command.NO_MODE_CHANGE, time_us)
        return []

    def _who_ended_it(self, mode: str, failsafe: bool) -> Command:
        if failsafe:
            return Command.FAILSAFE
        ours = self._holding and (mode in HOLD_MODES or self._hold_accepted)
        return Command.HELD if ours else Command.TAKEN_OVER

    def _go(self, code: Command, time_us: int) -> list[CommandChange]:
        self.code = code
        self._since_us = time_us
        return [CommandChange(code, time_us)]
