"""Fixtures that several subjects share."""

import one_thread  # noqa: F401  before anything loads NumPy

# isort: split

import itertools
import os
import shutil
import signal
from pathlib import Path

import examples
import folder_edits
import pytest

# where the tests run in the background of a shell, SIGINT comes ignored, also for the processes they start
signal.signal(signal.SIGINT, signal.default_int_handler)


_states = itertools.count()


def pytest_addoption(parser: pytest.Parser) -> None:
    """More examples of each property than the suite has time for."""
    text = "try so many times the examples of each property, other ones in every run"
    parser.addoption("--examples", type=int, default=1, metavar="TIMES", help=text)


def pytest_configure(config: pytest.Config) -> None:
    """Before a test module is imported."""
    examples.chosen(config.getoption("--examples"))


@pytest.fixture(autouse=True)
def state_directory(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a daemon keeps for its next start does not reach another test, nor the user's own place for it."""
    folder = tmp_path_factory.getbasetemp() / f"state_{next(_states)}"
    monkeypatch.setenv("STATE_DIRECTORY", str(folder))


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first three seconds of a recorded flight; not to be changed."""
    return folder_edits.short_flight(tmp_path_factory.mktemp("recorded") / "flight")


@pytest.fixture
def flight(recorded: Path, tmp_path: Path) -> Path:
    """A copy of the recorded flight, to be changed at will."""
    return Path(shutil.copytree(recorded, tmp_path / "flight"))


@pytest.fixture(scope="session")
def replay_cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where replays are kept for all tests of a run, whichever worker asks for them."""
    base = tmp_path_factory.getbasetemp()
    return (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "replays"
