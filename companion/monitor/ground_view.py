"""The ground map from above, the vehicle in the middle, north up, as SVG."""

import base64
import math
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from companion.messages.ground_cells import NO_HEIGHT, cells_of
from companion.messages.messages import ProcedureState
from landing.ground.ground import CellState

SIDE = 400
"""Of the picture, in its own units."""
VIEW_M = 8.0
"""Half side of what is shown."""
DISC_M = 0.5
COLOURS: dict[int, tuple[int, int, int]] = {
    CellState.UNKNOWN: (120, 120, 120),
    CellState.MEASURED: (40, 130, 200),
    CellState.LANDABLE: (70, 150, 40),
    CellState.DISPUTED: (50, 30, 190),
}
"""BGR of a cell at the map's mean height: measured but not landable, landable, looks that disagree."""
RELIEF_M = 0.5
MOST_SPOTS = 20
Place = tuple[float, float]
JUMP_M = 3.0
"""A place so far from the one before it is in other axes: the map began anew."""


def way_on(path: Sequence[Place], ground: dict[str, Any]) -> list[Place]:
    """The path (north, east in the map's axes) with the place of another ground message, or anew after a jump."""
    north, east = ground.get("north_m"), ground.get("east_m")
    if north is None or east is None or not (_finite(north) and _finite(east)):
        return list(path)
    place = (float(north), float(east))
    return [*path, place] if path and math.dist(path[-1], place) <= JUMP_M else [place]


def ground_svg(
    ground: dict[str, Any] | None,
    mapped: dict[str, Any] | None,
    procedure: ProcedureState | None = None,
    path: Sequence[Place] = (),
) -> str:
    """Map (of the newest message that has one), vehicle, disc where it comes down, spots; "" without a place.

    With a landing procedure, the way that was flown, the place that is chosen and the way there.
    """
    if ground is None or not (_finite(ground.get("north_m")) and _finite(ground.get("east_m"))):
        return ""
    scale = SIDE / (2 * VIEW_M)
    parts = [_map(ground, mapped, scale)] if mapped is not None else []
    spots = ground.get("spots")
    for spot in (spots if isinstance(spots, list) else [])[:MOST_SPOTS]:
        parts.append(_ring(spot, "spot", scale))
    parts.append(_ring(ground.get("touchdown"), "disc", scale))
    middle = SIDE / 2
    parts += _procedure(ground, procedure, path, scale)
    parts.append(f'<path class="craft" d="M{middle} {middle - 11}l8 20l-8 -5l-8 5Z"/>')
    parts.append(f'<text x="8" y="22">N ↑</text><path class="grid" d="M10 {SIDE - 12}h{2 * scale:.0f}"/>')
    parts.append(f'<text x="10" y="{SIDE - 18}">2 m</text>')
    head = f'<svg class="ground" viewBox="0 0 {SIDE} {SIDE}" role="img" aria-label="{_words(ground)}">'
    return f"{head}{''.join(parts)}</svg>"


def _procedure(
    ground: dict[str, Any], procedure: ProcedureState | None, path: Sequence[Place], scale: float
) -> list[str]:
    parts, middle = [], SIDE / 2
    if len(path) > 1:
        away = ((n - ground["north_m"], e - ground["east_m"]) for n, e in path)
        points = " ".join(f"{middle + e * scale:.1f},{middle - n * scale:.1f}" for n, e in away)
        parts.append(f'<polyline class="path" points="{points}"/>')
    north = procedure.spot_north_m if procedure is not None else None
    east = procedure.spot_east_m if procedure is not None else None
    if north is not None and east is not None and _finite(north) and _finite(east):
        place = {"north_m": north, "east_m": east}
        x, y = middle + east * scale, middle - north * scale
        parts.append(f'<path class="chosen" d="M{middle} {middle}L{x:.1f} {y:.1f}"/>')
        parts.append(_ring(place, "chosen", scale))
    return parts


def _words(ground: dict[str, Any]) -> str:
    below = ground.get("below")
    verdict = below.get("verdict") if isinstance(below, dict) else None
    return f"ground from above; below: {verdict if verdict in ('landable', 'hazard') else 'unknown'}"


def _map(ground: dict[str, Any], mapped: dict[str, Any], scale: float) -> str:
    cells = cells_of(mapped)
    grid = mapped.get("map") or {}
    if cells is None or not all(_finite(grid.get(key)) for key in ("north0_m", "east0_m", "cell_m")):
        return ""
    state, height = cells
    known = height != NO_HEIGHT
    metres = np.where(known, height * 1e-3, np.nan)
    middle = float(np.nanmean(metres)) if known.any() else 0.0
    light = np.nan_to_num(np.clip((metres - middle) / RELIEF_M, -1, 1))[..., None]
    picture = np.zeros((*state.shape, 4), np.uint8)
    for value, colour in COLOURS.items():
        picture[state == value, :3] = colour
    picture[..., :3] = np.clip(picture[..., :3] * (1 + 0.35 * light), 0, 255).astype(np.uint8)
    picture[..., 3] = np.where((state == CellState.UNKNOWN) & ~known, 0, 255)
    done, png = cv2.imencode(".png", picture[::-1])
    if not done:
        return ""
    cell = float(grid["cell_m"]) * scale
    x = SIDE / 2 + (float(grid["east0_m"]) - float(ground["east_m"])) * scale
    top_m = float(grid["north0_m"]) + state.shape[0] * float(grid["cell_m"])
    y = SIDE / 2 - (top_m - float(ground["north_m"])) * scale
    return (
        f'<image x="{x:.1f}" y="{y:.1f}" width="{state.shape[1] * cell:.1f}" height="{state.shape[0] * cell:.1f}"'
        f' href="data:image/png;base64,{base64.b64encode(png.tobytes()).decode()}" style="image-rendering:pixelated"/>'
    )


def _ring(place: Any, look: str, scale: float) -> str:
    if not isinstance(place, dict) or not (_finite(place.get("north_m")) and _finite(place.get("east_m"))):
        return ""
    given: Any = place.get("radius_m")
    r = float(given) if _finite(given) and given > 0 else DISC_M
    x, y = SIDE / 2 + place["east_m"] * scale, SIDE / 2 - place["north_m"] * scale
    return f'<circle class="{look}" cx="{x:.1f}" cy="{y:.1f}" r="{r * scale:.1f}"/>'


def _finite(value: Any) -> bool:
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and math.isfinite(value)
        and abs(value) < 1e7
    )
