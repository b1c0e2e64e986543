"""What drivers tell beside samples: something that happened, once."""

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class DriverEvent:
    """One happening; ``severity`` is "info", "warning" or "error"; ``arrival_us`` the companion's clock."""

    event: str
    severity: str
    text: str
    arrival_us: int
    details: dict[str, Any] = field(default_factory=dict)
