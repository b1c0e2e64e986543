"""The ground map from above as characters and colours, for a terminal of 80 columns."""

import math
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from companion.messages.ground import Ground
from companion.messages.ground_cells import cells_of
from landing.ground.ground import CellState

if TYPE_CHECKING:
    from rich.text import Text

_ROUNDING = 1e-6
"""Of a place on the edge between two cells."""
COLUMNS, ROWS = 77, 25
"""Characters across and down: one is a cell wide and two cells high, as characters are."""
LOOKS: dict[int, tuple[str, str]] = {
    CellState.UNKNOWN: (" ", ""),
    CellState.MEASURED: (".", "blue"),
    CellState.LANDABLE: ("+", "green"),
    CellState.DISPUTED: ("x", "red"),
}
VEHICLE, STOP = ("^", "bold white"), ("o", "bold yellow")
LEGEND = "+ landable . measured x disputed ^ vehicle o touchdown 1-5 spots, north up, "


def map_lines(ground: Ground, mapped: Ground) -> "list[Text]":
    """The map of ``mapped`` about the vehicle's place in ``ground``, a line each, and a legend."""
    from rich.text import Text

    cells = cells_of(msgspec.to_builtins(mapped))
    grid = mapped.map
    if cells is None or grid is None or not grid.cell_m > 0:
        return []
    state, cell_m = cells[0], grid.cell_m
    middle_row, middle_column = ROWS // 2, COLUMNS // 2
    row0 = math.floor((ground.north_m - grid.north0_m) / cell_m + _ROUNDING)
    column0 = math.floor((ground.east_m - grid.east0_m) / cell_m + _ROUNDING)
    shown = [[LOOKS[CellState.UNKNOWN]] * COLUMNS for _ in range(ROWS)]
    for line in range(ROWS):
        first = row0 + 2 * (middle_row - line)
        for column in range(COLUMNS):
            across = column0 + column - middle_column
            if not 0 <= across < state.shape[1]:
                continue
            both = state[max(first, 0) : max(first + 2, 0), across]
            shown[line][column] = LOOKS.get(_of(both), LOOKS[CellState.UNKNOWN])

    def put(north_m: float | None, east_m: float | None, look: tuple[str, str]) -> None:
        if north_m is None or east_m is None:
            return
        line = middle_row - round(north_m / (2 * cell_m))
        column = middle_column + round(east_m / cell_m)
        if 0 <= line < ROWS and 0 <= column < COLUMNS:
            shown[line][column] = look

    for number, spot in reversed(list(enumerate(ground.spots[:5], 1))):
        put(spot.north_m, spot.east_m, (str(number), "bold white on green"))
    put(ground.touchdown.north_m, ground.touchdown.east_m, STOP)
    put(0.0, 0.0, VEHICLE)
    lines = []
    for line_of_looks in shown:
        text = Text(no_wrap=True)
        for character, style in line_of_looks:
            text.append(character, style)
        lines.append(text)
    lines.append(Text(f"{LEGEND}{COLUMNS * cell_m:.1f} m across", "dim"))
    return lines


def _of(states: np.ndarray) -> int:
    """One state of the cells under a character: the one that speaks most against landing."""
    if not len(states):
        return CellState.UNKNOWN
    for state in (CellState.DISPUTED, CellState.UNKNOWN, CellState.MEASURED):
        if (states == state).any():
            return state
    return CellState.LANDABLE
