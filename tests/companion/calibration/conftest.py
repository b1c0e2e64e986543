"""The film of a board that several tests calibrate from, made once."""

from pathlib import Path

import pytest
from board_support import film, tour

from companion.calibration.board import Board


@pytest.fixture(scope="session")
def charuco_film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("charuco")
    film(folder, Board(), tour())
    return folder
