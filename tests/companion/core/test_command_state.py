"""The command to land, followed from the request to the ground: pure, no sockets."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.core.command import NAV_LAND, CommandState
from drivers.samples import CommandAnswer, Heartbeat, LandedState, Sample


def answer(result: str, at_s: float = 1.0, command: int = NAV_LAND) -> CommandAnswer:
    return CommandAnswer(int(at_s * 1e6), command, result)


def beat(mode: str, at_s: float = 1.0, armed: bool = True) -> Heartbeat:
    return Heartbeat(int(at_s * 1e6), armed, mode, "ardupilot", 4)


def ground(at_s: float = 1.0) -> LandedState:
    return LandedState(int(at_s * 1e6), "on_ground")


def followed(*samples: Sample) -> list[str]:
    state = CommandState(mode_timeout_s=5.0)
    changes = state.request(0)
    for sample in samples:
        changes += state.feed(sample)
    assert changes[-1].state == state.state
    return [change.state for change in changes[1:]]


@pytest.mark.parametrize(
    ("samples", "states"),
    [
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
        # Others' commands and the ground before the landing mean nothing.
        ((answer("DENIED", command=511), ground(), answer("ACCEPTED")), ["accepted"]),
    ],
)
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
