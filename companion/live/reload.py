"""What of new settings a running daemon can take over, and what needs a restart."""

from dataclasses import dataclass, replace
from typing import Any

from companion.settings.settings import Settings
from companion.settings.settings_file import entries, value_of

RELOADABLE = (
    "decision.",
    "record.",
    "preview.",
    "mavlink.status_text",
    "mavlink.named_value_rate_hz",
    "mavlink.optical_flow",
)
"""Beginnings of the paths that a running daemon takes over: limits of the decision, publishing, recording."""


@dataclass(frozen=True, slots=True)
class Reload:
    """The settings in force from now on, the paths that changed, and those that a restart alone changes."""

    settings: Settings
    changed: tuple[str, ...]
    refused: tuple[str, ...]

    @property
    def text(self) -> str:
        """What became of it, in one line."""
        parts = [f"changed: {', '.join(self.changed)}" if self.changed else "nothing changed"]
        if self.refused:
            parts.append(f"a restart is needed for {', '.join(self.refused)}")
        return "; ".join(parts)


def reloaded(present: Settings, wanted: Settings) -> Reload:
    """The present settings with what may be changed while running taken from the wanted ones."""
    settings = present
    changed: list[str] = []
    refused: list[str] = []
    for entry in entries():
        value = value_of(wanted, entry.path)
        if value == value_of(present, entry.path):
            continue
        if entry.path.startswith(RELOADABLE) and entry.path != "record.mcap":
            changed.append(entry.path)
            settings = _with(settings, entry.path, value)
        else:
            refused.append(entry.path)
    return Reload(settings, tuple(changed), tuple(refused))


def _with(settings: Settings, path: str, value: Any) -> Settings:
    section, _, name = path.partition(".")
    return replace(settings, **{section: replace(getattr(settings, section), **{name: value})})
