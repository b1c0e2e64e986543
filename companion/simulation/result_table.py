"""Simulated flights as rows of a Parquet table, with settings and version, resumed where it was cut off."""

import importlib.metadata
import json
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from companion.errors import LandslopeError
from companion.simulation.monte_carlo import Run
from drivers.files import row_table


class ResultTable(row_table.RowTable):
    """A row a flight; one that broke the software has its error. DriverError where the folder is of other settings."""

    def __init__(self, path: Path, config: Path | None, overrides: Sequence[str]) -> None:
        text = config.read_text(encoding="utf-8") if config is not None else ""
        same = {
            row_table.SETTINGS: json.dumps({"config": text, "set": list(overrides)}),
            row_table.VERSION: importlib.metadata.version("landslope"),
        }
        super().__init__(path, Run, same)

    def runs_before(self, seeds: Sequence[int]) -> list[Run]:
        """The flights of an earlier run, of these seeds."""
        names, wanted = [field.name for field in fields(Run)], set(seeds)
        return [
            Run(**{name: row[name] for name in names if name in row})
            for row in self.before
            if row["seed"] in wanted
        ]


def read_rows(path: Path) -> list[dict[str, Any]]:
    """All rows of a table of simulated flights, by seed. Raises an error of the packages when it is none."""
    rows = row_table.read_rows(path)
    if not all({"seed", "ground", "outcome"} <= row.keys() for row in rows):
        raise LandslopeError(f"{path}: is no table of flights: seed, ground and outcome are missing")
    return sorted(rows, key=lambda row: row["seed"])
