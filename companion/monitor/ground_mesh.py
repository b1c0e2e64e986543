"""The ground map as a mesh for the page's script: the cells around the vehicle, and where the vehicle is."""

import base64
import json
import math
from typing import Any

import numpy as np

from companion.messages.ground_cells import NO_HEIGHT, cells_of

REACH_CELLS = 36
"""Cells to each side of the vehicle that are drawn: a phone draws them ten times a second."""
MOST_SPOTS = 8
DISC_M = 0.5
FURTHEST_M = 1e6


def mesh_of(ground: dict[str, Any] | None, mapped: dict[str, Any] | None) -> str:
    """JSON of the heights around the vehicle (int16, mm, base64; rows northwards); "" without a map."""
    cells = None if mapped is None else cells_of(mapped)
    if ground is None or mapped is None or cells is None:
        return ""
    grid, height = mapped["map"], cells[1]
    corner = [_number(value) for value in (grid.get("north0_m"), grid.get("east0_m"), grid.get("cell_m"))]
    vehicle = [_number(value) for value in (ground.get("north_m"), ground.get("east_m"))]
    if None in corner or None in vehicle or not corner[2] > 0:  # type: ignore[operator]
        return ""
    north0, east0, cell = (float(value) for value in corner if value is not None)
    row, column = (
        math.floor((place - start) / cell)
        for place, start in zip((v for v in vehicle if v is not None), (north0, east0), strict=True)
    )
    rows = slice(max(0, row - REACH_CELLS), max(0, row + REACH_CELLS + 1))
    columns = slice(max(0, column - REACH_CELLS), max(0, column + REACH_CELLS + 1))
    part = height[rows, columns]
    known = part[part != NO_HEIGHT]
    if min(part.shape) < 2 or not known.size:
        return ""
    return json.dumps(
        {
            "rows": part.shape[0],
            "columns": part.shape[1],
            "cell": cell,
            "n0": round(north0 + rows.start * cell, 3),
            "e0": round(east0 + columns.start * cell, 3),
            "middle": round(float(np.median(known)) * 1e-3, 3),
            "height": base64.b64encode(np.ascontiguousarray(part, "<i2").tobytes()).decode(),
        },
        separators=(",", ":"),
    )


def pose_of(ground: dict[str, Any] | None) -> str:
    """JSON of the vehicle in the map's axes, the disc where it comes down and the spots; "" without a place."""
    if ground is None:
        return ""
    north, east, down = (_number(ground.get(key)) for key in ("north_m", "east_m", "down_m"))
    if north is None or east is None or down is None:
        return ""
    spots = ground.get("spots")
    rings = [_ring(spot) for spot in (spots if isinstance(spots, list) else [])[:MOST_SPOTS]]
    return json.dumps(
        {
            "n": north,
            "e": east,
            "up": -down,
            "disc": _ring(ground.get("touchdown")),
            "spots": [ring for ring in rings if ring is not None],
        },
        separators=(",", ":"),
    )


def _ring(place: Any) -> list[float] | None:
    if not isinstance(place, dict):
        return None
    north, east = _number(place.get("north_m")), _number(place.get("east_m"))
    radius = _number(place.get("radius_m"))
    if north is None or east is None:
        return None
    return [north, east, radius if radius is not None and 0 < radius < 100 else DISC_M]


def _number(value: Any) -> float | None:
    """A finite number that can be drawn, else None."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if math.isfinite(value) and abs(value) < FURTHEST_M else None
