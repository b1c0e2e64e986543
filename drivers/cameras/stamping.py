"""Capture times for streams that carry a presentation time but no clock of ours."""

from collections import deque
from itertools import pairwise

SECOND_US = 1_000_000

SHORT_US = 150_000
"""The newest frames: a few of them, over which made-up times do not run away far."""

LEAST_SLOPE = 0.002
"""Crystals differ by 200 ppm at most; presentation times that differ by ten times that from arrival are made up."""

LEAST_RISE_US = 20_000
"""A rise of the least delay above this, steady over ``RISING_SECONDS``, is none of the network's."""

RISING_SECONDS = 4


class MinimumDelayStamper:
    """Takes the network's jitter out of arrival times.

    The sender's presentation times are even; the least delayed frame of the last seconds ties them to our clock. The
    least delay itself stays in: that constant is what ``camera.time_offset_s`` takes out.

    A sender that counts frames at a nominal rate makes its times up: the delay then rises steadily. Frames are stamped
    with their arrival from then on (``made_up``). No stamp is earlier than the least
    delayed of the newest frames says by more than ``max_early_us``.
    """

    def __init__(
        self, window_us: int = 10_000_000, max_jitter_us: int = 500_000, max_early_us: int = 30_000
    ) -> None:
        self._window_us = window_us
        self._max_jitter_us = max_jitter_us
        self._max_early_us = max_early_us
        self._delays: deque[tuple[int, int]] = deque()
        self._recent: deque[tuple[int, int]] = deque()
        self._seconds: deque[list[int]] = deque(maxlen=RISING_SECONDS + 2)
        self._last_us: int | None = None
        self.made_up = False
        """Whether the presentation times do not hold against arrival."""

    def stamp(self, presented_us: int, arrival_us: int) -> int:
        """When a frame was sent, on our clock; its arrival when the presentation times make no sense."""
        delay_us = arrival_us - presented_us
        jumped = self._delays and abs(delay_us - self._delays[-1][1]) > self._max_jitter_us
        if jumped or (self._last_us is not None and presented_us <= self._last_us):
            self._delays.clear()
            self._recent.clear()
            self._seconds.clear()
        self._last_us = presented_us
        _keep_least(self._delays, arrival_us, delay_us, self._window_us)
        _keep_least(self._recent, arrival_us, delay_us, SHORT_US)
        self.made_up = self.made_up or self._rises(arrival_us, delay_us)
        if self.made_up:
            return arrival_us
        return presented_us + max(self._delays[0][1], self._recent[0][1] - self._max_early_us)

    def _rises(self, arrival_us: int, delay_us: int) -> bool:
        """Whether the least delays of the last full seconds rise steadily, by more than a crystal's drift."""
        second = arrival_us // SECOND_US
        if not self._seconds or self._seconds[-1][0] != second:
            self._seconds.append([second, delay_us])
        self._seconds[-1][1] = min(self._seconds[-1][1], delay_us)
        full = list(self._seconds)[:-1]
        if len(full) <= RISING_SECONDS:
            return False
        rises = [(b[1] - a[1]) / (b[0] - a[0]) for a, b in pairwise(full)]
        mean = sum(rises) / len(rises)
        steady = max(rises) <= 2 * mean and min(rises) >= mean / 2
        return steady and mean > LEAST_SLOPE * SECOND_US and full[-1][1] - full[0][1] > LEAST_RISE_US


def _keep_least(delays: deque[tuple[int, int]], arrival_us: int, delay_us: int, window_us: int) -> None:
    """Keep (arrival, delay) so that the first is the least of the window."""
    while delays and delays[-1][1] >= delay_us:
        delays.pop()
    delays.append((arrival_us, delay_us))
    while delays[0][0] < arrival_us - window_us:
        delays.popleft()
