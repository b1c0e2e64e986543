"""TOML as text: read within reason, written, and its lines by the settings that they set."""

import re
import tomllib
from pathlib import Path
from typing import Any

from companion.errors import SettingsError

LONGEST_FILE = 1_000_000
DEEPEST = 20
LONGEST_SHOWN = 60
"""Characters of a wrong value that an error shows."""


def written(value: Any) -> str:
    """A value as TOML writes it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, (tuple, list)):
        return "[" + ", ".join(map(written, value)) + "]"
    return "" if value is None else str(value)


def shown(value: Any) -> str:
    """A value as TOML writes it, in one line that can be read."""
    try:
        text = written(value)
    except ValueError:  # an integer of more digits than Python writes
        return "a number of too many digits"
    text = " ".join(text.split())
    return text if len(text) <= LONGEST_SHOWN else text[:LONGEST_SHOWN] + "..."


def read_text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise SettingsError(f"{file}: there is no such settings file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise SettingsError(f"{file}: cannot be read as UTF-8 text: {error}") from None


def parse_toml(text: str, where: object) -> dict[str, Any]:
    """TOML as tables; SettingsError in one line for what is none, or is made to take long or to nest without end."""
    if len(text) > LONGEST_FILE:
        raise SettingsError(f"{where}: {len(text)} characters are no settings file, at most {LONGEST_FILE}")
    try:
        table = tomllib.loads(text)
        if _depth(table) > DEEPEST:
            raise RecursionError
    except RecursionError:
        raise SettingsError(f"{where}: is nested too deeply: at most {DEEPEST} levels") from None
    except ValueError as error:  # a TOMLDecodeError, or an integer of too many digits
        raise SettingsError(f"{where}: is not TOML: {error}") from None
    return table


def _depth(value: Any) -> int:
    """Levels of tables and lists, no further than what is too deep."""
    level, depth = [value], 0
    while level and depth <= DEEPEST:
        level = [
            child
            for item in level
            for child in (item.values() if isinstance(item, dict) else item if isinstance(item, list) else ())
        ]
        depth += 1
    return depth


def line_numbers(text: str) -> dict[str, int]:
    """Line numbers of ``key = value`` lines by dotted path (tomllib keeps none)."""
    found: dict[str, int] = {}
    section = ""
    for number, line in enumerate(text.splitlines(), 1):
        if header := re.match(r"\s*\[\s*([\w.\s\"'-]+?)\s*\]", line):
            section = re.sub(r"[\s\"']", "", header[1]) + "."
        elif key := re.match(r"\s*([\w.\s\"'-]+?)\s*=", line):
            found.setdefault(section + re.sub(r"[\s\"']", "", key[1]), number)
    return found
