"""Fixtures that several subjects share."""

import shutil
from pathlib import Path

import folder_edits
import pytest


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first three seconds of a recorded flight; not to be changed."""
    return folder_edits.short_flight(tmp_path_factory.mktemp("recorded") / "flight")


@pytest.fixture
def flight(recorded: Path, tmp_path: Path) -> Path:
    """A copy of the recorded flight, to be changed at will."""
    return Path(shutil.copytree(recorded, tmp_path / "flight"))
