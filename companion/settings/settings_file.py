"""Reading settings: TOML file and ``--set`` overrides in, checked settings and their origins out.

The dataclasses of ``companion/settings/settings.py`` are the only table there is: a field added there, of whatever
section, is read, bounded, explained and overridable without further code.
"""

import dataclasses
import difflib
import functools
import math
import types
import typing
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import msgspec

from companion.errors import SettingsError
from companion.settings.marks import FilePath, UserSettings
from companion.settings.mode_names import MODE_SETTINGS, flight_modes
from companion.settings.moved import MOVED
from companion.settings.settings import Settings
from companion.settings.toml_text import line_numbers, parse_toml, read_text, shown, written
from drivers.secrets import is_key
from landing.options import Limits

T = typing.TypeVar("T")
DEFAULT = "default"
OVERRIDE = "--set"


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
    or_key: bool = False

    @property
    def unit(self) -> str:
        """The unit, empty where there is none."""
        return self.limits.unit if self.limits else ""


@dataclass(frozen=True, slots=True)
class LoadedSettings:
    """The settings in force, and for each path where it came from ("default", "FILE:LINE", "--set").

    ``notes`` has one line for each setting that was given under a name of an earlier version.
    """

    settings: Settings
    origins: dict[str, str]
    file: Path | None
    notes: tuple[str, ...] = ()


def entries(
    section: type = Settings, prefix: str = "", users: Collection[str] | None = None
) -> Iterator[Entry]:
    """Every setting there is, in the order of the dataclasses.

    ``users`` names the fields of ``section`` that are for users; None: all are.
    """
    hints = _hints(section)
    for field in dataclasses.fields(section):
        hint = hints[field.name]
        path = prefix + field.name
        kind = _bare(hint)
        if dataclasses.is_dataclass(kind):
            mark = _mark(hint, UserSettings)
            yield from entries(typing.cast(type, kind), path + ".", mark.names if mark else None)
        else:
            internal = users is not None and field.name not in users
            yield _entry(path, hint, _default(field), internal)


def load(file: Path | None, overrides: Sequence[str] = ()) -> LoadedSettings:
    """The settings of a file (None: defaults) with ``section.key=value`` overrides on top.

    Relative paths in the file are taken relative to the file. Raises SettingsError with one line for
    every fault there is, not only the first.
    """
    known = {entry.path: entry for entry in entries()}
    values: dict[str, Any] = {}
    origins = dict.fromkeys(known, DEFAULT)
    faults: list[str] = []
    notes: list[str] = []

    def take(given: str, raw: Any, directory: Path, origin: str, where: str) -> None:
        path = given
        if given not in known and given in MOVED:
            path = MOVED[given].now
            notes.append(f"{where}: {given} {MOVED[given].note}")
            if not path:
                return
        try:
            values[path] = _checked(known, path, raw, directory)
            origins[path] = origin
        except ValueError as fault:
            faults.append(f"{where}: {fault}")

    if file is not None:
        text = read_text(file)
        lines = line_numbers(text)
        for path, raw in _flatten(parse_toml(text, file), known):
            where = f"{file}:{lines[path]}" if path in lines else str(file)
            take(path, raw, file.parent, where, where)
    for override in overrides:
        where = f"{OVERRIDE} {override}"
        try:
            path, raw = _override(override, known)
        except ValueError as fault:
            faults.append(f"{where}: {fault}")
        else:
            take(path, raw, Path(), OVERRIDE, where)
    if faults:
        raise SettingsError("\n".join(faults))
    return LoadedSettings(_build(Settings, "", values), origins, file, tuple(notes))


def read_section(section: type[T], table: dict[str, Any], where: str, directory: Path = Path()) -> T:
    """Any dataclass of bounded fields from a TOML table, checked as the settings are.

    Raises SettingsError with one line for every fault, each beginning with ``where``.
    """
    known = {entry.path: entry for entry in entries(section)}
    values: dict[str, Any] = {}
    faults: list[str] = []
    for path, raw in _flatten(table, known):
        try:
            values[path] = _checked(known, path, raw, directory)
        except ValueError as fault:
            faults.append(f"{where}: {fault}")
    if faults:
        raise SettingsError("\n".join(faults))
    return typing.cast(T, _build(section, "", values))


def value_of(settings: Settings, path: str) -> Any:
    """The value at a dotted path."""
    value: Any = settings
    for name in path.split("."):
        value = getattr(value, name)
    return value


def type_name(entry: Entry) -> str:
    """What may be written there, in words."""
    origin = typing.get_origin(entry.type)
    if origin is Literal:
        return "one of " + ", ".join(map(written, typing.get_args(entry.type)))
    if origin is tuple:
        return "a list of " + {str: "strings", int: "integers", float: "numbers"}.get(
            _bare(typing.get_args(entry.type)[0]), "values"
        )
    names = {bool: "true or false", int: "an integer", float: "a number", str: "a string"}
    members = [t for t in _members(entry.type) if t is not type(None)]
    words = (written(typing.get_args(t)[0]) if typing.get_origin(t) is Literal else None for t in members)
    return " or ".join(word or names.get(t, str(t)) for word, t in zip(words, members, strict=True))


def _entry(path: str, hint: Any, default: Any, internal: bool) -> Entry:
    marks: tuple[Any, ...] = getattr(hint, "__metadata__", ())
    words = (mark if isinstance(mark, str) else getattr(mark, "meaning", "") for mark in marks)
    meaning = next(filter(None, words), "")
    file = _mark(hint, FilePath)
    must_exist = file is not None and file.must_exist
    or_key = file is not None and file.or_key
    limits = _mark(hint, Limits)
    return Entry(path, _bare(hint), default, limits, meaning, file is not None, must_exist, internal, or_key)


@functools.cache
def _hints(section: type) -> dict[str, Any]:
    return typing.get_type_hints(section, include_extras=True)


def _mark(hint: Any, kind: type[T]) -> T | None:
    """The first annotation of that kind behind a type."""
    return next((mark for mark in getattr(hint, "__metadata__", ()) if isinstance(mark, kind)), None)


def _default(field: "dataclasses.Field[Any]") -> Any:
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    return field.default


def _bare(hint: Any) -> Any:
    return typing.get_args(hint)[0] if hasattr(hint, "__metadata__") else hint


def _members(kind: Any) -> tuple[Any, ...]:
    return typing.get_args(kind) if typing.get_origin(kind) in (typing.Union, types.UnionType) else (kind,)


def _flatten(table: dict[str, Any], known: dict[str, Entry], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Leaves of the file by dotted path; a table where a setting is known stays whole."""
    for name, value in table.items():
        path = prefix + name
        if isinstance(value, dict) and path not in known and value:
            yield from _flatten(value, known, path + ".")
        elif value != {} or path in known or not _is_section(path, known):
            yield path, value


def _is_section(path: str, known: dict[str, Entry]) -> bool:
    return any(name.startswith(path + ".") for name in known)


def _override(text: str, known: dict[str, Entry]) -> tuple[str, Any]:
    """``section.key=value``: a TOML value, or, where a string or list of strings is wanted, bare text."""
    path, equals, raw = text.partition("=")
    path, raw = path.strip(), raw.strip()
    if not equals:
        raise ValueError("write section.key=value")
    try:
        value = parse_toml(f"v = {raw}", path)["v"]
    except SettingsError:
        value = raw
    kind = known[path].type if path in known else None
    if typing.get_origin(kind) is tuple and not isinstance(value, list):
        value = [word.strip() for word in raw.split(",") if word.strip()]
    elif str in _members(kind) and not isinstance(value, str):
        value = raw
    return path, value


def _checked(known: dict[str, Entry], path: str, raw: Any, directory: Path) -> Any:
    """The value in its own type, within its limits; ValueError says what is wrong."""
    if path not in known:
        raise ValueError(_unknown(path, known))
    entry = known[path]
    try:
        value = msgspec.convert(raw, entry.type, strict=True)
    except (msgspec.ValidationError, OverflowError):
        near = _nearest(shown(raw), [str(a) for a in typing.get_args(entry.type)])
        raise ValueError(f"{path} must be {type_name(entry)}, not {shown(raw)}{near}") from None
    for number in value if isinstance(value, tuple) else (value,):
        if isinstance(number, str):
            continue
        if entry.limits and number is not None and not entry.limits.low <= number <= entry.limits.high:
            unit = f" {entry.unit}" if entry.unit else ""
            low, high = entry.limits.low, entry.limits.high
            raise ValueError(f"{path} = {shown(number)} is outside its limits {low:g} to {high:g}{unit}")
        if isinstance(number, float) and not math.isfinite(number):
            raise ValueError(f"{path} = {number} is not a finite number")
    if path in MODE_SETTINGS:
        return flight_modes(path, value, _nearest)
    if entry.is_file and value and not (entry.or_key and is_key(value)):
        return str((directory / Path(value).expanduser()).absolute())
    return value


def _unknown(path: str, known: dict[str, Entry]) -> str:
    section = path.rpartition(".")[0]
    sections = {name.rpartition(".")[0] for name in known}
    if path in sections:
        return f"{path} is a section: write [{path}] and its settings below"
    if section and section not in sections:
        head = path.partition(".")[0]
        if head in known:
            return f"{head} is a setting, not a section"
        return f"there is no section [{section}]{_nearest(section, sections)}"
    return f"there is no setting {path}{_nearest(path, known)}"


def _nearest(word: str, names: typing.Iterable[str]) -> str:
    near = difflib.get_close_matches(word, list(names), 1)
    return f"; did you mean {near[0]}?" if near else ""


def _build(section: type, prefix: str, values: dict[str, Any]) -> Any:
    hints = _hints(section)
    chosen = {}
    for field in dataclasses.fields(section):
        path = prefix + field.name
        kind = _bare(hints[field.name])
        if dataclasses.is_dataclass(kind):
            chosen[field.name] = _build(typing.cast(type, kind), path + ".", values)
        elif path in values:
            chosen[field.name] = values[path]
    return section(**chosen)
