"""Checks options from the command line against the ``Limits`` of their fields, as the settings file's are checked."""

from typing import Any, TypeVar

from companion.errors import LandslopeError
from companion.settings.settings_file import entries

T = TypeVar("T")


def within_limits(options: T) -> T:
    """The same options (a dataclass whose fields have ``Limits``), if every number lies within its limits.

    Raises LandslopeError, which names the first value outside, the limits and their unit.
    """
    kind: Any = type(options)
    for entry in entries(kind):
        value, limits = getattr(options, entry.path), entry.limits
        if limits is not None and not limits.low <= value <= limits.high:
            raise LandslopeError(
                f"{entry.path} is {value:g}; it must be from {limits.low:g} to {limits.high:g} {limits.unit}".rstrip()
            )
    return options
