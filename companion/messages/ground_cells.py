"""A ground message as something to draw: the map's cells, the vehicle, the discs and the spots."""

import base64
import binascii
from typing import Any

import numpy as np
from numpy.typing import NDArray

NO_HEIGHT = -32768
"""Packed heights are little-endian int16 in millimetres; this one is unknown."""
MOST_CELLS = 250_000


def cells_of(message: dict[str, Any]) -> "tuple[NDArray[np.uint8], NDArray[np.int16]] | None":
    """State (rows, columns) and height in mm (rows, columns), rows northwards; None where there is no such map."""
    grid = message.get("map")
    if not isinstance(grid, dict):
        return None
    rows, columns = grid.get("rows"), grid.get("columns")
    if not (isinstance(rows, int) and isinstance(columns, int) and 0 < rows * columns <= MOST_CELLS):
        return None
    state, height = (
        _unpacked(grid.get("state"), rows * columns),
        _unpacked(grid.get("height"), 2 * rows * columns),
    )
    if state is None or height is None:
        return None
    return (
        np.frombuffer(state, np.uint8).reshape(rows, columns),
        np.frombuffer(height, "<i2").reshape(rows, columns).astype(np.int16),
    )


def drawable(message: dict[str, Any]) -> dict[str, Any] | None:
    """The message with its map's cells as lists, for the page's script; None without a place of the vehicle."""
    if message.get("north_m") is None or message.get("east_m") is None:
        return None
    shown = {key: message.get(key) for key in ("north_m", "east_m", "below", "touchdown", "spots")}
    cells = cells_of(message)
    if cells is not None:
        grid = message["map"]
        shown["map"] = {
            **{key: grid[key] for key in ("north0_m", "east0_m", "cell_m", "rows", "columns")},
            "state": base64.b64encode(cells[0].tobytes()).decode(),
            "height": base64.b64encode(cells[1].astype("<i2").tobytes()).decode(),
        }
    return shown


def _unpacked(packed: Any, size: int) -> bytes | None:
    """The bytes of a packed field (base64); None unless they are ``size`` bytes."""
    if not isinstance(packed, str):
        return None
    try:
        raw = base64.b64decode(packed, validate=True)
    except (binascii.Error, ValueError):
        return None
    return raw if len(raw) == size else None
