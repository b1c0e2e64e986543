"""The ground map in plan view, heights as colours: one panel for each flight.

    landslope replay sitl_logs/rubble_a --ground rubble.jsonl
    python tests/tools/plan_view.py docs/pictures/plan_view.png rubble.jsonl stairs.jsonl

Drawn is the map of each file with the most cells off its median: north up, heights over their median in metres, unknown
cells white, disputed ones hatched.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from companion.messages.ground_cells import NO_HEIGHT, cells_of
from landing.ground.ground import CellState

PANEL_IN = 4.5
RELIEF_M = 0.05


def most_relief(path: Path) -> tuple[dict[str, Any], np.ndarray, np.ndarray]:
    """The message with the most relief, its states and heights (rows, columns) in m, NaN where unknown."""
    best, most = None, -1
    for line in path.read_text(encoding="utf-8").splitlines():
        message = json.loads(line)
        cells = cells_of(message) if message.get("map") else None
        if cells is None:
            continue
        state, height = cells
        metres = np.where(height != NO_HEIGHT, height * 1e-3, np.nan)
        count = int(np.count_nonzero(np.abs(metres - np.nanmedian(metres)) > RELIEF_M))
        if count > most:
            best, most = (message, state, metres), count
    if best is None:
        raise SystemExit(f"{path}: no message has a map")
    return best


def draw(axes: Any, path: Path) -> None:
    """One panel."""
    message, state, metres = most_relief(path)
    grid = message["map"]
    rows, columns = state.shape
    left, bottom, cell = grid["east0_m"], grid["north0_m"], grid["cell_m"]
    extent = (left, left + columns * cell, bottom, bottom + rows * cell)
    over = metres - np.nanmedian(metres)
    reach = max(0.1, float(np.nanpercentile(np.abs(over), 98)))
    shown = axes.imshow(
        over, origin="lower", extent=extent, cmap="RdBu_r", vmin=-reach, vmax=reach, interpolation="nearest"
    )
    hatch = np.where(state == CellState.DISPUTED, 1.0, np.nan)
    axes.contourf(hatch, levels=[0.5, 1.5], origin="lower", extent=extent, hatches=["////"], colors=["none"])
    axes.plot(message["east_m"], message["north_m"], "k^", markersize=7)
    axes.set_title(f"{path.name.split('.')[0]}, frame {message['frame']}", fontsize=9)
    axes.set_xlabel("east, m")
    axes.set_ylabel("north, m")
    axes.set_aspect("equal")
    plt.colorbar(shown, ax=axes, shrink=0.7, label="height, m")


def main() -> None:
    """Draw all files into one picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("picture", type=Path)
    parser.add_argument("ground", type=Path, nargs="+")
    args = parser.parse_args()
    count = len(args.ground)
    figure, panels = plt.subplots(1, count, figsize=(PANEL_IN * count, 2 * PANEL_IN), squeeze=False)
    for axes, path in zip(panels[0], args.ground, strict=True):
        draw(axes, path)
    figure.tight_layout()
    figure.savefig(args.picture, dpi=80)


if __name__ == "__main__":
    main()
