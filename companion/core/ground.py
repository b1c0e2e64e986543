"""The ground map's messages, at their own rates of sample time."""

import math

from companion.messages.ground import Ground, ground_message
from landing.estimate import SurfaceEstimate
from landing.ground.ground import Ground as GroundBelow

PERIOD_S = 0.5
MAP_EVERY = 4
"""Messages from map to map."""


class GroundReporter:
    """Reports what can be landed on twice a second, with the map every other second."""

    def __init__(self, ground: GroundBelow) -> None:
        self._ground = ground
        self._due_s = -math.inf
        self._count = 0

    def step(self, estimate: SurfaceEstimate, time_unix_us: int, time_boot_s: float | None) -> list[Ground]:
        """The message at a frame, when one is due."""
        if estimate.time_s < self._due_s:
            return []
        # in step with the frames, and not catching up after a silence
        self._due_s = max(self._due_s + PERIOD_S, estimate.time_s + PERIOD_S / 2)
        view = self._ground.view() if self._count % MAP_EVERY == 0 else None
        self._count += 1
        return [ground_message(self._ground.report(estimate.frame), time_unix_us, time_boot_s, view)]
