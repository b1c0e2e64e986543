"""Copies of messages: two links of one vehicle in one log carry everything twice, the slower one later."""

from collections import deque

from drivers.samples import Attitude, Imu, Velocity

KEPT_US = 2_000_000
"""How much later than its first copy a message may come; after a reboot the same boot time comes later."""


class Copies:
    """Knows a message by its kind, source and boot time among those that came within ``KEPT_US`` before it."""

    def __init__(self) -> None:
        self._seen: dict[tuple[str, int], int] = {}
        self._order: deque[tuple[int, tuple[str, int]]] = deque()

    def is_copy(self, sample: Attitude | Imu | Velocity) -> bool:
        """Whether this message came before; a first one is kept."""
        while self._order and abs(sample.arrival_us - self._order[0][0]) > KEPT_US:
            self._seen.pop(self._order.popleft()[1], None)
        kind = sample.source if isinstance(sample, Imu) else type(sample).__name__
        key = kind, sample.boot_us
        if key in self._seen:
            return True
        self._seen[key] = sample.arrival_us
        self._order.append((sample.arrival_us, key))
        return False
