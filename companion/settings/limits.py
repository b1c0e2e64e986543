"""Bounds of options that come from the command line: the same ``Limits`` as the settings file's."""

from typing import Any, TypeVar

from companion.errors import LandslopeError
from companion.settings.settings_file import entries

T = TypeVar("T")


def within_limits(options: T) -> T:
    """The options, if every number lies within its ``Limits``; LandslopeError names the first that does not."""
    kind: Any = type(options)
    for entry in entries(kind):
        value, limits = getattr(options, entry.path), entry.limits
        if limits is not None and not limits.low <= value <= limits.high:
            raise LandslopeError(
                f"{entry.path} is {value:g}; it must be from {limits.low:g} to {limits.high:g} {limits.unit}".rstrip()
            )
    return options
