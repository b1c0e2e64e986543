"""Shares of flights with their confidence intervals."""

import math
from dataclasses import dataclass

Z95 = 1.959964


@dataclass(frozen=True, slots=True)
class Share:
    """A share with its 95 % confidence interval."""

    count: int
    total: int

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's interval."""
        return wilson(self.count, self.total)

    def __str__(self) -> str:
        if not self.total:
            return "none of 0"
        low, high = self.interval
        share = 100 * self.count / self.total
        return f"{self.count} of {self.total} ({share:.1f} %; 95 % confidence {100 * low:.1f} to {100 * high:.1f} %)"


def wilson(count: int, total: int) -> tuple[float, float]:
    """Wilson's 95 % score interval of a share (Wilson 1927)."""
    if total == 0:
        return 0.0, 1.0
    p, z2 = count / total, Z95 * Z95
    middle = (p + z2 / (2 * total)) / (1 + z2 / total)
    half = Z95 / (1 + z2 / total) * math.sqrt(p * (1 - p) / total + z2 / (4 * total * total))
    # Rounding must not put the share itself outside.
    return max(0.0, min(p, middle - half)), min(1.0, max(p, middle + half))
