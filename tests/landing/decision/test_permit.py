"""The gate before the command: every rule by itself, and one request to a permission."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from landing.decision.permit import Permit, PermitInputs

GOOD = PermitInputs(
    1.0, verdict_fit=True, enabled=True, armed=True, in_air=True, mode_allowed=True, fresh=True
)

RULES = [
    ({"enabled": False}, "landing is not enabled"),
    ({"armed": False}, "vehicle not armed"),
    ({"armed": None}, "not known whether armed"),
    ({"in_air": False}, "vehicle not in the air"),
    ({"in_air": None}, "not known whether in the air"),
    ({"mode_allowed": False}, "flight mode not allowed"),
    ({"mode_allowed": None}, "flight mode unknown"),
    ({"fresh": False}, "stale inputs"),
    ({"fresh": False, "stale": ("attitude", "frames")}, "stale inputs: attitude, frames"),
    ({"command_busy": True}, "a command is under way"),
]


def test_all_conditions_together_request_a_landing():
    state = Permit().step(GOOD)
    assert (state.permitted, state.withheld, state.request) == (True, (), True)


@pytest.mark.parametrize(("change", "words"), RULES)
def test_each_rule_withholds_by_itself_and_says_so(change: dict, words: str):
    permit = Permit()
    state = permit.step(replace(GOOD, **change))
    assert (state.permitted, state.withheld, state.request) == (False, (words,), False)
    assert not permit.requested
    # nothing is left behind: the same gate opens once the rule is met
    assert permit.step(GOOD).request


def test_a_surface_that_is_not_fit_is_not_requested_although_permitted():
    state = Permit().step(replace(GOOD, verdict_fit=False))
    assert (state.permitted, state.withheld, state.request) == (True, (), False)


def test_every_rule_that_stands_against_it_is_told():
    bad = PermitInputs(1.0, True, False, None, False, None, False, ("attitude",), True)
    state = Permit().step(bad)
    assert len(state.withheld) == 6


def test_one_request_to_a_permission():
    permit = Permit()
    assert permit.step(GOOD).request
    for _ in range(3):
        state = permit.step(GOOD)
        assert not state.request
        assert state.withheld == ("already requested under this permission",)
    # landed, disarmed, armed again: the same permission
    permit.step(replace(GOOD, armed=False, in_air=False))
    assert not permit.step(GOOD).request
    # taken back and given anew
    permit.step(replace(GOOD, enabled=False))
    assert not permit.requested
    assert permit.step(GOOD).request


flag = st.sampled_from((True, False, None))
inputs = st.builds(
    PermitInputs,
    st.just(1.0),
    st.booleans(),
    st.booleans(),
    flag,
    flag,
    flag,
    st.booleans(),
    st.just(()),
    st.booleans(),
)


@settings(max_examples=200, deadline=None)
@given(st.lists(inputs, max_size=12))
def test_nothing_is_ever_requested_in_doubt_or_twice(steps: list[PermitInputs]):
    permit, requested = Permit(), 0
    for step in steps:
        if not step.enabled:
            requested = 0
        state = permit.step(step)
        known = step.armed is True and step.in_air is True and step.mode_allowed is True
        if state.request:
            requested += 1
            assert step.enabled
            assert known
            assert step.verdict_fit
            assert step.fresh
            assert not step.command_busy
        assert requested <= 1
        assert state.permitted == (not state.withheld)
