"""Events that drivers report beside samples: something that happened, once."""

from dataclasses import dataclass, field
from typing import Any

from drivers.secrets import masked


@dataclass(frozen=True, slots=True)
class DriverEvent:
    """One happening; ``severity`` is "info", "warning" or "error"; ``arrival_us`` the companion's clock.

    Secrets in the text are masked: events go to every subscriber.
    """

    event: str
    severity: str
    text: str
    arrival_us: int
    details: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "text", masked(self.text))
