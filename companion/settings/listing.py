"""What a settings file says: the settings in force with their origin, files that are missing, the table of all."""

from collections.abc import Iterator
from pathlib import Path

from companion.settings.settings_file import (
    DEFAULT,
    Entry,
    LoadedSettings,
    entries,
    type_name,
    value_of,
    written,
)
from drivers.secrets import is_key, masked


def missing_files(loaded: LoadedSettings) -> Iterator[str]:
    """One line for each file that the settings name and that is not there."""
    for entry in entries():
        value = value_of(loaded.settings, entry.path)
        is_path = entry.is_file and value and not (entry.or_key and is_key(value))
        if is_path and entry.must_exist and not Path(value).exists():
            yield f"{loaded.origins[entry.path]}: {entry.path} = {written(value)}: there is no such file"


def in_force(loaded: LoadedSettings, internal: bool = False) -> Iterator[str]:
    """The settings as TOML, secrets masked; each with its unit, its meaning and its origin behind it.

    Of the internal settings only those that a file or an override sets, or all with ``internal``.
    """
    section = ""
    for entry in entries():
        if entry.internal and not internal and loaded.origins[entry.path] == DEFAULT:
            continue
        if (head := entry.path.rpartition(".")[0]) != section:
            yield f"{'' if not section else chr(10)}[{head}]"
            section = head
        value = f"{entry.path.rpartition('.')[2]} = {masked(written(value_of(loaded.settings, entry.path)))}"
        origin = loaded.origins[entry.path]
        remarks = [entry.unit, entry.meaning, "internal" if entry.internal else ""]
        remarks += [origin if origin == DEFAULT else f"from {origin}"]
        yield f"{value:<36}  # {'; '.join(filter(None, remarks))}"


def markdown_table(internal: bool = False) -> Iterator[str]:
    """The users' settings, or the internal ones, one row each, as docs/settings.md shows them."""
    yield "| setting | default | allowed values | meaning |"
    yield "|---|---|---|---|"
    for entry in entries():
        if entry.internal != internal:
            continue
        default = written(entry.default) or "(none)"
        yield f"| `{entry.path}` | `{default}` | {_allowed(entry)} | {entry.meaning} |"


def _allowed(entry: Entry) -> str:
    if entry.limits is None:
        return type_name(entry)
    unit = f" {entry.unit}" if entry.unit else ""
    return f"{type_name(entry)}, {entry.limits.low:.10g} to {entry.limits.high:.10g}{unit}"
