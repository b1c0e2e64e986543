"""Capture times for streams that carry a presentation time but no clock of ours."""

from collections import deque


class MinimumDelayStamper:
    """Takes the network's jitter out of arrival times.

    The sender's presentation times are even; the least delayed frame of the last seconds ties them to our clock. The
    least delay itself stays in: that constant is what ``camera.time_offset_s`` takes out.
    """

    def __init__(self, window_us: int = 10_000_000, max_jitter_us: int = 500_000) -> None:
        self._window_us = window_us
        self._max_jitter_us = max_jitter_us
        self._delays: deque[tuple[int, int]] = deque()
        self._last_us: int | None = None

    def stamp(self, presented_us: int, arrival_us: int) -> int:
        """When a frame was sent, on our clock; its arrival when the presentation times make no sense."""
        delay_us = arrival_us - presented_us
        jumped = self._delays and abs(delay_us - self._delays[0][1]) > self._max_jitter_us
        if jumped or (self._last_us is not None and presented_us <= self._last_us):
            self._delays.clear()
        self._last_us = presented_us
        while self._delays and self._delays[-1][1] >= delay_us:
            self._delays.pop()
        self._delays.append((arrival_us, delay_us))
        while self._delays[0][0] < arrival_us - self._window_us:
            self._delays.popleft()
        return presented_us + self._delays[0][1]
