"""Flights as rows of a Parquet table: written as they end, with settings and version, resumed where it was cut off."""

import importlib.metadata
import json
import time
import uuid
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from types import TracebackType
from typing import Any

from companion.errors import LandslopeError
from companion.simulation.monte_carlo import Run

ROWS_A_PART = 200
LONGEST_S = 20.0
"""A part is written at least so often: what a cut costs."""


def require_pyarrow() -> None:
    """Raise LandslopeError with the remedy when pyarrow is missing."""
    try:
        import pyarrow  # noqa: F401
    except ImportError:
        raise LandslopeError(
            "tables need pyarrow, which is not installed: pip install 'landslope[scale]'"
        ) from None


class ResultTable:
    """A folder of Parquet files that every reader of Parquet takes as one table.

    A flight that broke the software is a row with its error. Raises LandslopeError when the folder holds flights of
    other settings: a table is of one kind.
    """

    def __init__(self, path: Path, config: Path | None, overrides: Sequence[str]) -> None:
        require_pyarrow()
        text = config.read_text(encoding="utf-8") if config is not None else ""
        self._same = {
            "settings": json.dumps({"config": text, "set": list(overrides)}),
            "version": importlib.metadata.version("landslope"),
        }
        self.path = path
        path.mkdir(parents=True, exist_ok=True)
        self.before = read_rows(path) if any(path.glob("*.parquet")) else []
        """The rows of an earlier run that was cut off."""
        for row in self.before:
            if row["settings"] != self._same["settings"]:
                raise LandslopeError(f"{path}: holds flights of other settings; give another folder")
        self._rows: list[dict[str, Any]] = []
        self._written_s = time.monotonic()

    def runs_before(self, seeds: Sequence[int]) -> list[Run]:
        """The flights of an earlier run, of these seeds."""
        names, wanted = [field.name for field in fields(Run)], set(seeds)
        return [
            Run(**{name: row[name] for name in names if name in row})
            for row in self.before
            if row["seed"] in wanted
        ]

    def add(self, run: Run) -> None:
        """One flight that ended."""
        self._rows.append(asdict(run) | self._same)
        if len(self._rows) >= ROWS_A_PART or time.monotonic() - self._written_s >= LONGEST_S:
            self.flush()

    def flush(self) -> None:
        """Write the rows that wait, as a file that is complete under its own name."""
        self._written_s = time.monotonic()
        if not self._rows:
            return
        import pyarrow as pa
        import pyarrow.parquet as pq

        name = f"part-{uuid.uuid4().hex}.parquet"
        hidden = self.path / f".{name}"
        pq.write_table(pa.Table.from_pylist(self._rows, schema=_schema(pa)), hidden)
        hidden.rename(self.path / name)
        self._rows.clear()

    def __enter__(self) -> "ResultTable":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        self.flush()


def read_rows(path: Path) -> list[dict[str, Any]]:
    """All rows of a table, by seed. Raises LandslopeError when there is none."""
    require_pyarrow()
    import pyarrow as pa
    import pyarrow.parquet as pq

    files = sorted(path.glob("*.parquet")) if path.is_dir() else [path]
    if not files or not files[0].is_file():
        raise LandslopeError(
            f"{path}: there is no Parquet table; make one by 'landslope sim --runs N --table'"
        )
    try:
        rows = [row for file in files for row in pq.read_table(file).to_pylist()]
    except (pa.ArrowException, OSError) as error:
        raise LandslopeError(f"{path}: is no Parquet table: {error}") from None
    if not all({"seed", "ground", "outcome"} <= row.keys() for row in rows):
        raise LandslopeError(f"{path}: is no table of flights: seed, ground and outcome are missing")
    return sorted(rows, key=lambda row: row["seed"])


def _schema(pa: Any) -> Any:
    kinds = {"int": pa.int64(), "str": pa.string(), "bool": pa.bool_()}
    columns = [
        (f.name, kinds.get(str(getattr(f.type, "__name__", f.type)), pa.float64())) for f in fields(Run)
    ]
    return pa.schema([*columns, ("settings", pa.string()), ("version", pa.string())])
