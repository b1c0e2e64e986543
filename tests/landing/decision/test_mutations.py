"""Every rule of the decision, of the permission and of the command, removed once, is missed by some test."""

import importlib.util
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from types import ModuleType
from typing import Any

import mutation
import pytest
from places import REPOSITORY

import companion.core.command as command
import companion.core.consent as consent
import companion.core.decision_logic as decision_logic
import companion.core.pilot as pilot
import companion.core.vehicle_state as vehicle_state
import landing.decision.arrival as arrival
import landing.decision.decision as decision
import landing.decision.looking as looking
import landing.decision.permission as permission


def table_of(path: str) -> ModuleType:
    """A test module, for its tables."""
    spec = importlib.util.spec_from_file_location(path.replace("/", "_"), REPOSITORY / "tests" / f"{path}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_every_rule_of_the_permission_is_needed() -> None:
    table = table_of("landing/decision/test_permission")
    tests = [
        getattr(table, name)
        for name in (
            "test_every_rule_that_stands_against_it_is_reported",
            "test_whether_it_was_used_is_kept_until_the_switch_is_off",
        )
    ]

    def passes() -> bool:
        for switch, steps, expected in table.TRANSITIONS:
            if table.state(table.after(switch, *steps)) != expected:
                return False
        for switch, steps, code in table.OBJECTIONS:
            table.test_what_the_permission_objects(switch, steps, code)
        for change, words in table.RULES:
            table.test_each_rule_of_the_gate_withholds_by_itself_and_says_so(change, words)
        for change in table.OPEN:
            table.test_the_gate_is_open(change)
        for test in tests:
            test()
        return True

    assert mutation.survivors(permission, passes) == []


def _named(names: str | tuple[str, ...], rows: Iterable[Any]) -> Iterator[dict[str, object]]:
    """The arguments by name of every row of a ``parametrize``."""
    split = [name.strip() for name in names.split(",")] if isinstance(names, str) else list(names)
    for row in rows:
        yield dict(zip(split, (row,) if len(split) == 1 else row, strict=True))


def cases(module: ModuleType) -> list[Callable[[], None]]:
    """The tests of a module with all their parameters, but for those of random input."""
    found: list[Callable[[], None]] = []
    for name, test in vars(module).items():
        if not name.startswith("test_") or hasattr(test, "hypothesis"):
            continue
        given: list[dict[str, object]] = [{}]
        for mark in getattr(test, "pytestmark", ()):
            if mark.name == "parametrize":
                given = [{**values, **more} for values in given for more in _named(*mark.args[:2])]
        found += [partial(test, **values) for values in given]
    return found


def test_every_rule_of_the_decision_is_needed() -> None:
    tests = cases(table_of("landing/decision/test_decision"))
    tests += cases(table_of("landing/decision/test_touchdown"))

    def passes() -> bool:
        for test in tests:
            test()
        return True

    assert mutation.survivors(decision, passes) == []


@pytest.mark.parametrize(
    ("module", "tests"),
    [
        (consent, ("companion/core/test_consent",)),
        (decision_logic, ("landing/decision/test_decision_rules",)),
        (vehicle_state, ("companion/core/test_consent", "companion/core/test_vehicle_state")),
        (pilot, ("companion/core/test_consent",)),
        (arrival, ("landing/decision/test_arrival",)),
        (looking, ("landing/decision/test_arrival",)),
    ],
)
def test_every_rule_of_what_permission_and_procedure_ask_is_needed(
    module: ModuleType, tests: tuple[str, ...]
) -> None:
    found = [case for path in tests for case in cases(table_of(path))]

    def passes() -> bool:
        for test in found:
            test()
        return True

    assert mutation.survivors(module, passes) == []


def test_every_rule_of_the_command_is_needed() -> None:
    table = table_of("companion/core/test_command_state")

    def passes() -> bool:
        for samples, states in table.STORIES:
            if table.followed(*samples) != states:
                return False
        table.test_a_command_under_way_is_never_forgotten()
        table.test_only_what_went_wrong_is_a_warning()
        return command.CommandState().feed(table.answer("ACCEPTED")) == []

    assert mutation.survivors(command, passes) == []
