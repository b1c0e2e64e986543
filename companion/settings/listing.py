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


def missing_files(loaded: LoadedSettings) -> Iterator[str]:
    """One line for each file that the settings name and that is not there."""
    for entry in entries():
        value = value_of(loaded.settings, entry.path)
        if entry.is_file and value and entry.must_exist and not Path(value).exists():
            yield f"{loaded.origins[entry.path]}: {entry.path} = {written(value)}: there is no such file"


def in_force(loaded: LoadedSettings) -> Iterator[str]:
    """The settings as TOML; each with its unit, its meaning and its origin behind it."""
    section = ""
    for entry in entries():
        if (head := entry.path.rpartition(".")[0]) != section:
            yield f"{'' if not section else chr(10)}[{head}]"
            section = head
        name, known = entry.path.rpartition(".")[2], value_of(loaded.settings, entry.path)
        value = f"# {name} is not set" if known is None else f"{name} = {written(known)}"
        origin = loaded.origins[entry.path]
        remarks = [entry.unit, entry.meaning, origin if origin == DEFAULT else f"from {origin}"]
        yield f"{value:<36}  # {'; '.join(filter(None, remarks))}"


def markdown_table() -> Iterator[str]:
    """All settings, one row each, as docs/settings.md shows them."""
    yield "| setting | default | what may be written | meaning |"
    yield "|---|---|---|---|"
    for entry in entries():
        default = written(entry.default) or "(none)"
        yield f"| `{entry.path}` | `{default}` | {_allowed(entry)} | {entry.meaning} |"


def _allowed(entry: Entry) -> str:
    if entry.limits is None:
        return type_name(entry)
    unit = f" {entry.unit}" if entry.unit else ""
    return f"{type_name(entry)}, {entry.limits.low:.10g} to {entry.limits.high:.10g}{unit}"
