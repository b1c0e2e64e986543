"""A folder of Parquet files that every reader of Parquet takes as one table; rows are written soon after they come."""

import dataclasses
import time
import uuid
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from drivers.errors import DriverError

ROWS_A_PART = 200
LONGEST_S = 20.0
"""A part is written at least so often: what a cut costs."""
SETTINGS, VERSION = "settings", "version"


def require_pyarrow() -> None:
    """Raise DriverError with the remedy when pyarrow is missing."""
    try:
        import pyarrow  # noqa: F401
    except ImportError:
        raise DriverError(
            "tables need pyarrow, which is not installed: pip install 'landslope[scale]'"
        ) from None


class RowTable:
    """Rows of one dataclass, each with the settings and the version it was made with.

    ``before`` are the rows of an earlier run that was cut off. Raises DriverError when the folder holds rows of other
    settings: a table is of one kind.
    """

    def __init__(self, path: Path, row: type[Any], same: Mapping[str, str]) -> None:
        """``same``: the ``settings`` and the ``version`` that go with every row."""
        require_pyarrow()
        self.path, self._row, self._same = path, row, dict(same)
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DriverError(f"{path}: cannot be made: {error.strerror}; choose another folder") from None
        self.before = read_rows(path) if any(path.glob("*.parquet")) else []
        for before in self.before:
            if before.get(SETTINGS) != self._same[SETTINGS]:
                raise DriverError(f"{path}: holds flights of other settings; give another folder")
        self._rows: list[dict[str, Any]] = []
        self._written_s = time.monotonic()

    def add(self, row: Any) -> None:
        """One row: an object of the dataclass."""
        self._rows.append(dataclasses.asdict(row) | self._same)
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
        try:
            pq.write_table(pa.Table.from_pylist(self._rows, schema=_schema(pa, self._row)), hidden)
            hidden.rename(self.path / name)
        except OSError as error:
            raise DriverError(f"{self.path}: cannot be written: {error.strerror or error}") from None
        self._rows.clear()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        self.flush()


def read_rows(path: Path) -> list[dict[str, Any]]:
    """All rows of a table. Raises DriverError when there is none."""
    require_pyarrow()
    import pyarrow as pa
    import pyarrow.parquet as pq

    files = sorted(path.glob("*.parquet")) if path.is_dir() else [path]
    if not files or not files[0].is_file():
        raise DriverError(
            f"{path}: there is no Parquet table; make one by '--table' of 'landslope sim --runs N' or 'replay'"
        )
    try:
        return [row for file in files for row in pq.read_table(file).to_pylist()]
    except (pa.ArrowException, OSError) as error:
        raise DriverError(f"{path}: is no Parquet table: {error}") from None


def _schema(pa: Any, row: type[Any]) -> Any:
    kinds = {"int": pa.int64(), "str": pa.string(), "bool": pa.bool_()}
    columns = [
        (field.name, kinds.get(str(getattr(field.type, "__name__", field.type)), pa.float64()))
        for field in dataclasses.fields(row)
    ]
    return pa.schema([*columns, (SETTINGS, pa.string()), (VERSION, pa.string())])
