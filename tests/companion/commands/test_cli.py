"""The command line itself: what it says of its commands and of itself."""

import importlib.metadata

import pytest

from companion.cli import COMMANDS, main


def test_the_version_is_that_of_the_package(capsys: pytest.CaptureFixture[str]):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"landslope {importlib.metadata.version('landslope')}\n"


@pytest.mark.parametrize(("words", "code"), [([], 2), (["--help"], 0), (["help"], 0)])
def test_without_a_command_all_are_listed(words: list[str], code: int, capsys: pytest.CaptureFixture[str]):
    assert main(words) == code
    reported = capsys.readouterr().out
    assert all(f"\n  {name} " in reported for name in COMMANDS)


def test_a_command_that_is_not_there_is_reported_with_those_that_are(capsys: pytest.CaptureFixture[str]):
    assert main(["fly"]) == 2
    reported = capsys.readouterr().err
    assert reported.startswith("landslope: there is no command 'fly'")
    assert "replay" in reported


@pytest.mark.parametrize(
    ("typed", "meant"), [("replai", "replay"), ("calibration", "calibrate"), ("docter", "doctor")]
)
def test_a_command_that_is_nearly_one_is_answered_with_it(
    typed: str, meant: str, capsys: pytest.CaptureFixture[str]
):
    assert main([typed]) == 2
    assert capsys.readouterr().err.splitlines()[0] == (
        f"landslope: there is no command '{typed}'; did you mean '{meant}'?"
    )
