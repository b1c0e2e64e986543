"""Flight folders that lie elsewhere: paths of fsspec, as s3://bucket/flights, gs:// or sftp://."""

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from drivers.errors import DriverError


def is_remote(text: str) -> bool:
    """Whether a flight is named by an address rather than a path."""
    return "://" in text


def folders_with(address: str, names: Sequence[str]) -> list[str]:
    """The folder at ``address`` if one of the files ``names`` is in it, else the folders in it that have one.

    Raises DriverError when it cannot be read.
    """
    system, path = _opened(address)
    scheme = address.split("://", 1)[0]
    try:
        files = system.find(path, maxdepth=2)
    except Exception as error:  # noqa: BLE001 - every file system of fsspec has errors of its own
        raise _unreadable(address, error) from None
    top = path.rstrip("/")
    found = sorted({file.rpartition("/")[0] for file in files if file.rpartition("/")[2] in names})
    if top in found:
        return [address]
    return [f"{scheme}://{folder}" for folder in found] or [address]


@contextmanager
def fetched(address: str) -> Iterator[Path]:
    """A copy of a folder or file on this machine, for as long as it is used. Raises DriverError."""
    system, path = _opened(address)
    with tempfile.TemporaryDirectory(prefix="landslope_") as folder:
        copy = Path(folder) / path.rstrip("/").rpartition("/")[2]
        try:
            system.get(path.rstrip("/"), str(copy), recursive=True)
        except Exception as error:  # noqa: BLE001 - every file system of fsspec has errors of its own
            raise _unreadable(address, error) from None
        yield copy


def _opened(address: str) -> tuple[Any, str]:
    try:
        from fsspec.core import url_to_fs
    except ImportError:
        raise DriverError(f"{address}: needs fsspec: pip install 'landslope[scale]'") from None
    try:
        system, path = url_to_fs(address)
    except (ImportError, ValueError, OSError) as error:
        raise _unreadable(address, error) from None
    return system, str(path)


def _unreadable(address: str, error: Exception) -> DriverError:
    what = str(error).splitlines()[0] if str(error) else type(error).__name__
    return DriverError(f"{address}: cannot be read: {what}")
