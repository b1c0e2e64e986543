"""STATUSTEXT: few, at most 50 characters by design, the reason first, longer ones in chunks."""

from itertools import pairwise, product
from typing import Any

import msgspec
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from companion.core.command import WORDS as COMMAND_WORDS
from companion.core.command import Command, CommandChange
from companion.live.status_texts import (
    AGAIN_US,
    PREFIX,
    SHORT_CONDITIONS,
    SHORT_PROCEDURE,
    SHORT_REASONS,
    TEXT_LENGTH,
    StatusTexts,
)
from companion.messages.conditions import Code as ConditionCode
from companion.messages.conditions import Condition, condition, state_of
from companion.messages.messages import Decision, Event, Health
from landing.decision.orders import State, Why
from landing.decision.withheld import WORDS, Withheld
from landing.reasons import Code

LOST = condition(ConditionCode.VITAL_INPUT_STALE, "frames", "2.0 s")
GONE = condition(ConditionCode.VITAL_INPUT_MISSING, "attitude")


def decision(at_s: float, verdict: str, *codes: str) -> Decision:
    return Decision(
        frame=1,
        time_unix_us=round(at_s * 1e6),
        verdict=verdict,
        reasons=codes,
        reason_codes=codes,
        since_unix_us=0,
        permitted=True,
        withheld=(),
        requested=False,
        command="none",
    )


def health(at_s: float, *conditions: Condition) -> Health:
    return Health(
        time_unix_us=round(at_s * 1e6),
        state=state_of(conditions),
        problems=tuple(c.text for c in conditions),
        conditions=conditions,
        inputs={},
        counters={},
        clock_offset_s=None,
        clock_std_s=None,
        camera_late_s=None,
        camera_late_std_s=None,
        pipeline_ms=None,
    )


def event(name: str, text: str, at_s: float = 0.0) -> Event:
    return Event(event=name, frame=1, time_unix_us=round(at_s * 1e6), severity="warning", text=text)


def said(*messages: Decision | Health | Event) -> list[str]:
    texts, found = StatusTexts(), []
    for message in messages:
        found += feed(texts, message)
    return [m.text.removeprefix(PREFIX) for m in found]


def feed(texts: StatusTexts, message: Decision | Health | Event) -> list[Any]:
    if isinstance(message, Decision):
        return texts.decision(message)
    return texts.health(message) if isinstance(message, Health) else texts.event(message)


def test_a_verdict_is_reported_when_it_has_stood_and_only_once() -> None:
    reported = said(
        decision(0, "unknown", "nothing_seen"),
        *(decision(2 + i * 0.3, "fit") for i in range(10)),
        *(decision(10 + i * 0.5, "unfit", "too_steep") for i in range(10)),
    )
    assert reported == ["surface fit", "too steep, unfit"]


def test_a_verdict_that_flickers_is_not_told_at_every_change() -> None:
    reported = said(*(decision(i * 0.1, ("fit", "unfit")[i // 3 % 2], "too_rough") for i in range(200)))
    assert reported == []


def test_a_problem_is_reported_once_however_its_seconds_run() -> None:
    reported = said(
        health(0),
        *(health(i, condition(ConditionCode.VITAL_INPUT_STALE, "frames", f"{i} s")) for i in range(1, 60)),
    )
    assert reported == ["frames: stopped"]


def test_health_is_reported_by_its_new_problems_and_when_all_is_well_to_stay() -> None:
    reported = said(
        health(1, LOST),
        health(2, LOST, GONE),
        health(3, GONE),
        health(4, GONE),
        *(health(5 + i) for i in range(4)),
    )
    assert reported == ["frames: stopped", "attitude: none came", "over: frames: stopped", "all well"]


def test_a_problem_that_comes_and_goes_is_reported_at_most_once_in_five_seconds() -> None:
    reported = said(*(health(i * 0.5, *((LOST,) if i % 2 else ())) for i in range(40)))
    assert reported.count("frames: stopped") <= 20 / (AGAIN_US * 1e-6)
    assert "all well" not in reported


def test_a_command_and_a_permission_are_reported() -> None:
    reported = said(
        event("landing_refused", "command to land: refused: denied"),
        event("landing_enabled", "landing is enabled"),
        event("landing_disabled", str(WORDS[Withheld.TAKEN_OVER])),
        event("landing_disabled", "landing is not enabled"),
        event("vehicle_found", "vehicle with system id 1 found"),
    )
    assert reported == [
        "land: refused: denied",
        "landing enabled",
        "the pilot took over, no landing",
        "no landing",
    ]


def test_the_procedure_is_reported_by_its_states_in_one_short_text_each() -> None:
    for state, why in product(State, Why):
        gave_back = state is State.GIVE_BACK
        texts = StatusTexts()
        changed = event(
            "procedure_gave_back" if gave_back else "procedure_changed", "landing procedure and so on"
        )
        changed = msgspec.structs.replace(changed, details={"state": state.value, "code": why.value})
        sent = texts.event(changed)
        assert len(sent) == (1 if gave_back or state.value in SHORT_PROCEDURE else 0)
        assert all(len(m.text) <= TEXT_LENGTH for m in sent)
        assert texts.event(changed) == [], "not again at once"
        if gave_back:
            assert why.value.replace("_", " ") in str(sent[0].text)


def test_everything_short_is_short_and_every_reason_has_one() -> None:
    room = TEXT_LENGTH - len(PREFIX)
    assert set(SHORT_REASONS) == set(Code)
    assert all(len(f"{words}, unknown") <= room for words in SHORT_REASONS.values())
    assert set(SHORT_CONDITIONS) == set(ConditionCode)
    longest = max(("landed_state", "LOCAL_POSITION_NED", "EXTENDED_SYS_STATE"), key=len)
    assert all(len(f"over: {words.format(subject=longest)}") <= room for words in SHORT_CONDITIONS.values())


@pytest.mark.parametrize("code", [c for c in Command if c is not Command.NONE])
def test_what_became_of_a_command_fits_in_one_text_or_is_chunked_whole(code: Command) -> None:
    change = CommandChange(code, 0)
    sent = StatusTexts().event(event(change.event, f"command to land: {COMMAND_WORDS[code]}"))
    assert all(len(m.text) <= TEXT_LENGTH for m in sent)
    assert len(sent) == 1 or code in (Command.NO_MODE_CHANGE, Command.UNSUPPORTED, Command.FAILED)


@examples(50)
@given(st.text(alphabet=st.characters(codec="ascii", min_codepoint=32), min_size=1, max_size=300))
def test_chunks_join_to_the_whole_text(words: str) -> None:
    texts = StatusTexts()
    sent = texts.event(event("surface_unfit", words))
    assert "".join(m.text for m in sent) == PREFIX + words
    assert [m.chunk_seq for m in sent] == list(range(len(sent)))
    assert {m.id for m in sent} == ({0} if len(sent) == 1 else {1})


@examples(50)
@given(st.lists(st.tuples(st.floats(0, 0.5), st.sampled_from(["fit", "unfit", "unknown"]))))
def test_never_more_than_one_verdict_in_five_seconds(steps: list[tuple[float, str]]) -> None:
    texts, at_s, reported = StatusTexts(), 1.0, []
    for step_s, verdict in steps:
        at_s += step_s
        reported += [at_s] * len(texts.decision(decision(at_s, verdict)))
    assert all(b - a >= AGAIN_US * 1e-6 - 1e-6 for a, b in pairwise(reported))
