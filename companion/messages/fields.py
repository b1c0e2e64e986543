"""What the fields of the messages have in common: meaning, unit, and how unknown numbers are written."""

import math
from enum import StrEnum
from typing import Any

import msgspec


def about(meaning: str, unit: str = "", *, one_of: type[StrEnum] | None = None) -> msgspec.Meta:
    """What a field means and its unit; goes into the JSON Schema and the documentation.

    ``one_of``: the table that the values (of a tuple: its items) come from. The schema lists them; readers take
    others too, since a newer vehicle may know more.
    """
    extra: dict[str, Any] = {"unit": unit} if unit else {}
    if one_of is not None:
        extra["one_of"] = [str(value) for value in one_of]
    return msgspec.Meta(description=meaning, extra_json_schema=extra or None)


def known(value: float, digits: int) -> float | None:
    """A number for a message: rounded, None where unknown."""
    return round(float(value), digits) if math.isfinite(value) else None
