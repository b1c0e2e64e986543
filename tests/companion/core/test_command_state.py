"""The command to land, followed from the request to the ground: pure, no sockets."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.core.command import NAV_LAND, Command, CommandChange, CommandState
from drivers.samples import CommandAnswer, CurrentMode, Heartbeat, LandedState, RcChannels, Sample


def answer(result: str, at_s: float = 1.0, command: int = NAV_LAND) -> CommandAnswer:
    return CommandAnswer(int(at_s * 1e6), command, result)


def beat(mode: str, at_s: float = 1.0, armed: bool = True) -> Heartbeat:
    return Heartbeat(int(at_s * 1e6), armed, mode, "ardupilot", 4)


def ground(at_s: float = 1.0) -> LandedState:
    return LandedState(int(at_s * 1e6), "on_ground")


def landed(state: str, at_s: float = 1.0) -> LandedState:
    return LandedState(int(at_s * 1e6), state)


def current(mode: str, at_s: float = 1.0) -> CurrentMode:
    return CurrentMode(int(at_s * 1e6), mode, "")


def followed(*steps: Sample | str) -> list[str]:
    """States in words after a request; a step in words is something that we do, or "failsafe" from here on."""
    state = CommandState(mode_timeout_s=5.0)
    changes, failsafe = state.request(0), False
    for step in steps:
        if step == "hold":
            state.hold()
        elif step == "request":
            changes += state.request(0)
        elif step == "reset":
            state.reset()
        elif step == "failsafe":
            failsafe = True
        elif isinstance(step, str):
            changes += state.reboot(1) if step == "reboot" else state.took_over(1)
        else:
            changes += state.feed(step, failsafe)
    assert state.code is Command.NONE or changes[-1].state == state.state
    return [change.state for change in changes[1:]]


STORIES = [
    ((answer("ACCEPTED"), beat("LAND"), ground()), ["accepted", "landing", "landed"]),
    ((answer("ACCEPTED"), beat("LAND"), beat("LAND", armed=False)), ["accepted", "landing", "landed"]),
    ((answer("IN_PROGRESS"), answer("ACCEPTED"), beat("LAND")), ["in progress", "accepted", "landing"]),
    ((answer("IN_PROGRESS"), answer("NO_ANSWER")), ["in progress", "failed: no answer"]),
    ((answer("DENIED"),), ["refused: denied"]),
    ((answer("TEMPORARILY_REJECTED"),), ["refused: temporarily rejected"]),
    ((answer("UNSUPPORTED"),), ["refused: the autopilot does not know the command"]),
    ((answer("NO_ANSWER"),), ["failed: no answer"]),
    ((answer("NO_AUTOPILOT"),), ["failed: no autopilot"]),
    ((answer("AMBIGUOUS_VEHICLE"),), ["failed: ambiguous vehicle"]),
    # The answer was lost, but the mode tells; an answer that is late still counts.
    ((answer("NO_ANSWER"), beat("LAND")), ["failed: no answer", "landing"]),
    ((answer("NO_ANSWER"), answer("ACCEPTED")), ["failed: no answer", "accepted"]),
    ((beat("GUIDED"), beat("LAND")), ["landing"]),
    # Accepted, and then nothing.
    (
        (answer("ACCEPTED", 1), beat("GUIDED", 5.9), beat("GUIDED", 6.1)),
        ["accepted", "failed: accepted, but the mode did not become LAND"],
    ),
    (
        (answer("ACCEPTED"), beat("LAND"), beat("LOITER")),
        ["accepted", "landing", "taken over: the mode left LAND"],
    ),
    # What ended a landing in the air: our own hold, a failsafe, the pilot; each reported as what it was.
    (
        (answer("ACCEPTED"), beat("LAND"), "hold", beat("HOLD")),
        ["accepted", "landing", "held: landslope asked for hold"],
    ),
    (
        (answer("ACCEPTED"), beat("LAND"), "hold", beat("POSCTL")),
        ["accepted", "landing", "taken over: the mode left LAND"],
    ),
    (
        (answer("ACCEPTED"), beat("LAND"), "hold", answer("ACCEPTED", command=176), beat("POSCTL")),
        ["accepted", "landing", "held: landslope asked for hold"],
    ),
    (
        (answer("ACCEPTED"), beat("LAND"), "hold", answer("ACCEPTED", command=176), landed("in_air")),
        ["accepted", "landing", "held: landslope asked for hold"],
    ),
    (
        (answer("ACCEPTED"), beat("LAND"), "hold", answer("DENIED", command=176), landed("in_air")),
        ["accepted", "landing"],
    ),
    (
        (answer("ACCEPTED"), beat("LAND"), answer("ACCEPTED", command=176), landed("in_air")),
        ["accepted", "landing"],
    ),
    ((answer("ACCEPTED"), "hold", beat("BRAKE")), ["accepted", "held: landslope asked for hold"]),
    ((answer("ACCEPTED"), "hold", beat("GUIDED")), ["accepted"]),
    ((answer("ACCEPTED"), beat("HOLD")), ["accepted"]),
    (
        (answer("ACCEPTED"), beat("LAND"), "failsafe", beat("RTL")),
        ["accepted", "landing", "failsafe: the autopilot left LAND in a failsafe"],
    ),
    ((answer("ACCEPTED"), beat("LAND"), "failsafe", beat("LAND")), ["accepted", "landing"]),
    # Accepted, and the next mode that is heard is neither LAND nor the one before nor a stop: LAND came and went.
    (
        (beat("POSCTL"), "request", answer("ACCEPTED"), beat("ALTCTL")),
        ["requested", "accepted", "taken over: the mode left LAND"],
    ),
    (
        (beat("POSCTL"), "request", answer("ACCEPTED"), "failsafe", current("RTL")),
        ["requested", "accepted", "failsafe: the autopilot left LAND in a failsafe"],
    ),
    (
        (beat("POSCTL"), "request", answer("ACCEPTED"), beat("POSCTL"), beat("HOLD")),
        ["requested", "accepted"],
    ),
    ((answer("ACCEPTED"), beat("ALTCTL")), ["accepted"]),
    # A takeover within one heartbeat is seen by the landed state; CURRENT_MODE tells the mode earlier.
    (
        (answer("ACCEPTED"), landed("landing"), landed("in_air"), beat("POSCTL")),
        ["accepted", "landing", "taken over: the mode left LAND"],
    ),
    ((answer("ACCEPTED"), current("LAND"), ground()), ["accepted", "landing", "landed"]),
    ((landed("landing"), beat("GUIDED")), []),
    (
        (answer("ACCEPTED"), beat("LAND"), beat("LAND", armed=False), answer("DENIED")),
        ["accepted", "landing", "landed"],
    ),
    ((answer("ACCEPTED"), beat("LAND", armed=False)), ["accepted", "landing", "landed"]),
    (
        (answer("ACCEPTED"), beat("LAND"), "took over"),
        ["accepted", "landing", "taken over: the mode left LAND"],
    ),
    ((answer("DENIED"), "took over"), ["refused: denied"]),
    ((answer("ACCEPTED"), beat("LAND"), "reboot"), ["accepted", "landing", "failed: the autopilot rebooted"]),
    ((answer("DENIED"), "reboot"), ["refused: denied"]),
    ((answer("DENIED"), answer("ACCEPTED"), beat("LAND")), ["refused: denied"]),
    ((answer("IN_PROGRESS"), answer("IN_PROGRESS")), ["in progress"]),
    ((answer("NO_ANSWER"), answer("IN_PROGRESS")), ["failed: no answer"]),
    ((answer("NO_ANSWER"), answer("NO_ANSWER")), ["failed: no answer"]),
    ((answer("WHATEVER"),), ["failed: an unknown answer"]),
    (
        (answer("ACCEPTED"), beat("GUIDED", 6.1), beat("LAND", 7)),
        ["accepted", "failed: accepted, but the mode did not become LAND", "landing"],
    ),
    (("reset", answer("ACCEPTED"), "reset", beat("LAND")), ["accepted", "landing"]),
    ((answer("DENIED"), "hold", "reset", beat("LAND")), ["refused: denied"]),
    ((answer("ACCEPTED"), ground()), ["accepted"]),
    ((beat("GUIDED", 9.0),), []),
    ((answer("ACCEPTED"), beat("LAND"), RcChannels(0, ())), ["accepted", "landing"]),
    (
        (answer("ACCEPTED"), beat("LAND"), "hold", answer("ACCEPTED", command=511), landed("in_air")),
        ["accepted", "landing"],
    ),
    (
        (answer("ACCEPTED"), beat("LAND"), "hold", answer("ACCEPTED", command=176), landed("landing")),
        ["accepted", "landing"],
    ),
    # Others' commands and the ground before the landing mean nothing.
    ((answer("DENIED", command=511), ground(), answer("ACCEPTED")), ["accepted"]),
]


@pytest.mark.parametrize(("samples", "states"), STORIES)
def test_follows(samples, states) -> None:
    assert followed(*samples) == states


@pytest.mark.parametrize("mode", ["LAND", "AUTO.LAND", "QLAND"])
def test_every_autopilots_land_mode_counts(mode) -> None:
    assert followed(answer("ACCEPTED"), beat(mode))[-1] == "landing"


def test_a_command_under_way_is_never_forgotten() -> None:
    state = CommandState()
    state.request(0)
    state.reset()
    assert state.busy
    state.feed(answer("DENIED"))
    assert not state.busy
    state.reset()
    assert state.state == "none"


def test_only_what_went_wrong_is_a_warning() -> None:
    severity = {code: CommandChange(code, 0).severity for code in Command}
    assert severity[Command.LANDED] == severity[Command.HELD] == severity[Command.ACCEPTED] == "info"
    assert severity[Command.TAKEN_OVER] == severity[Command.DENIED] == "warning"
    assert CommandChange(Command.LANDING, 0).event == "landing_started"
    assert CommandChange(Command.TAKEN_OVER, 0).event == "landing_taken_over"


SAMPLES = st.one_of(
    st.builds(answer, st.sampled_from(["ACCEPTED", "DENIED", "IN_PROGRESS", "NO_ANSWER", "FAILED", "X"])),
    st.builds(beat, st.sampled_from(["LAND", "GUIDED"]), armed=st.booleans()),
    st.builds(ground),
)


@given(st.lists(SAMPLES, max_size=12))
def test_nothing_but_a_request_starts_a_command(samples) -> None:
    state = CommandState()
    for sample in samples:
        assert state.feed(sample) == []
    assert state.state == "none"


@given(st.lists(SAMPLES, max_size=20))
def test_landed_follows_landing_only_and_is_the_end(samples) -> None:
    states = ["requested", *followed(*samples)] if samples else ["requested"]
    for before, after in pairwise(states):
        assert before != "landed"
        assert after != "landed" or before == "landing"
