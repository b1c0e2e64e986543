"""Every setting as the dataclasses declare it: path, type, default, limits, meaning."""

import dataclasses
import functools
import typing
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any

from companion.settings.marks import FilePath, UserSettings
from companion.settings.settings import Settings
from landing.options import Limits

T = typing.TypeVar("T")


@dataclass(frozen=True, slots=True)
class Entry:
    """One setting as the dataclasses declare it; ``path`` is ``section.key``, ``type`` without annotations."""

    path: str
    type: Any
    default: Any
    limits: Limits | None
    meaning: str
    is_file: bool
    must_exist: bool
    internal: bool = False

    @property
    def unit(self) -> str:
        """The unit, empty where there is none."""
        return self.limits.unit if self.limits else ""


def entries(
    section: type = Settings, prefix: str = "", users: Collection[str] | None = None
) -> Iterator[Entry]:
    """Every setting there is, in the order of the dataclasses.

    ``users`` names the fields of ``section`` that are for users; None: all are.
    """
    hints = hints_of(section)
    for field in dataclasses.fields(section):
        hint = hints[field.name]
        path = prefix + field.name
        kind = bare(hint)
        if dataclasses.is_dataclass(kind):
            mark = _mark(hint, UserSettings)
            yield from entries(typing.cast(type, kind), path + ".", mark.names if mark else None)
        else:
            internal = users is not None and field.name not in users
            yield _entry(path, hint, _default(field), internal)


def _entry(path: str, hint: Any, default: Any, internal: bool) -> Entry:
    marks: tuple[Any, ...] = getattr(hint, "__metadata__", ())
    words = (mark if isinstance(mark, str) else getattr(mark, "meaning", "") for mark in marks)
    meaning = next(filter(None, words), "")
    file = _mark(hint, FilePath)
    must_exist = file is not None and file.must_exist
    limits = _mark(hint, Limits)
    return Entry(path, bare(hint), default, limits, meaning, file is not None, must_exist, internal)


@functools.cache
def hints_of(section: type) -> dict[str, Any]:
    return typing.get_type_hints(section, include_extras=True)


def _mark(hint: Any, kind: type[T]) -> T | None:
    """The first annotation of that kind behind a type."""
    return next((mark for mark in getattr(hint, "__metadata__", ()) if isinstance(mark, kind)), None)


def _default(field: "dataclasses.Field[Any]") -> Any:
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    return field.default


def bare(hint: Any) -> Any:
    return typing.get_args(hint)[0] if hasattr(hint, "__metadata__") else hint
