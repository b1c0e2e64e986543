"""``landslope watch --map``: characters and colours at the right places."""

from pathlib import Path

import msgspec
import numpy as np
from rich.console import Console

from companion.commands.watch import View
from companion.commands.watched_map import COLUMNS, ROWS, map_lines
from companion.messages.ground import Ground, ground_message
from companion.messages.messages import encode
from drivers.bus import Delivery
from landing.ground.ground import GroundReport, MapView
from landing.ground.spots import Disc, Spot


def message(state: np.ndarray, view: bool = True, stop: tuple[float, float] = (0.4, 0.0)) -> Ground:
    """The vehicle at north 10 m, east 20 m; the map's corner is 1 m south and 2 m west of it."""
    report = GroundReport(
        1,
        1.0,
        np.array((10.0, 20.0, -3.0)),
        Disc("landable", (), 1.0, 0.2, 0.01, 1.0),
        Disc("landable", (), 1.0, 0.2, 0.01, 1.0),
        *stop,
        (Spot(0.0, 1.0, 0.5, 1.0, 0.01, 0.3),),
    )
    shown = MapView(9.0, 18.0, np.zeros(state.shape), state) if view else None
    return ground_message(report, 1_000_000, 1.0, shown)


def lines(ground: Ground, mapped: Ground) -> list[str]:
    return [line.plain for line in map_lines(ground, mapped)]


def test_places_are_where_they_are_from_the_vehicle() -> None:
    state = np.full((20, 40), 2, np.uint8)
    state[:, 0] = 3
    state[0, 39] = 1
    shown = lines(message(state), message(state))
    assert len(shown) == ROWS + 1
    assert all(len(line) == COLUMNS for line in shown[:ROWS])
    row, column = ROWS // 2, COLUMNS // 2
    assert shown[row][column] == "^"
    assert shown[row - 2][column] == "o"  # 0.4 m north: two lines of 0.2 m
    assert shown[row][column + 10] == "1"
    assert shown[row][column - 20] == "x"  # the map's western column, 2 m away
    south = max(k for k, line in enumerate(shown[:ROWS]) if line.strip())
    assert south - row == 5  # 1 m to the south
    assert shown[south][column + 19] == "."
    assert shown[south][column + 18] == "+"


def test_a_character_over_two_cells_shows_the_worse_one() -> None:
    state = np.full((20, 40), 2, np.uint8)
    state[10, 25] = 0
    shown = lines(message(state), message(state))
    assert shown[ROWS // 2][COLUMNS // 2 + 5] == " "


def test_the_map_of_an_earlier_message_moves_under_the_vehicle() -> None:
    state = np.full((20, 40), 2, np.uint8)
    later = msgspec.structs.replace(message(state, view=False), east_m=20.5)
    shown = lines(later, message(state))
    assert shown[ROWS // 2].index("+") == COLUMNS // 2 - 25


def test_the_table_fits_80_columns_and_needs_no_colour(tmp_path: Path) -> None:
    view = View()
    state = np.full((128, 128), 2, np.uint8)
    view.take(Delivery("vehicle1", "ground", encode(message(state))), 0.0)
    with (tmp_path / "out").open("w", encoding="utf-8") as out:
        Console(width=80, file=out, force_terminal=False).print(view.table(0.1))
    text = (tmp_path / "out").read_text(encoding="utf-8")
    assert max(map(len, text.splitlines())) <= 80
    assert "+++++" in text
    assert "\x1b" not in text
    assert "ground below" in text
