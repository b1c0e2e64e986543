"""Settings as others may see them: without the secrets that stand in URLs."""

import dataclasses
from typing import Any, TypeVar

from drivers.secrets import masked

T = TypeVar("T")


def without_secrets(settings: T) -> T:
    """The same dataclass with every text masked, sections and lists included."""
    assert dataclasses.is_dataclass(settings)
    assert not isinstance(settings, type)
    values = {field.name: _value(getattr(settings, field.name)) for field in dataclasses.fields(settings)}
    return dataclasses.replace(settings, **values)


def _value(value: Any) -> Any:
    if isinstance(value, str):
        return masked(value)
    if isinstance(value, tuple):
        return tuple(_value(item) for item in value)
    return without_secrets(value) if dataclasses.is_dataclass(value) else value
