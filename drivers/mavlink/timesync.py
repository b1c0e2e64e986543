"""TIMESYNC requests and the recognition of their answers. Time is given, none is read."""

from collections import deque

OUTSTANDING = 16
"""Requests whose answers are still recognised."""


class TimeSync:
    """Makes requests every ``interval_s``; knows an answer to one of them from answers to others."""

    def __init__(self, interval_s: float = 0.2) -> None:
        self._interval_us = int(interval_s * 1e6)
        self._next_us = 0
        self._sent: deque[int] = deque(maxlen=OUTSTANDING)

    def due(self, now_us: int) -> int | None:
        """The ``ts1`` (ns) of a request to send now with ``tc1`` 0; None before the next one is due."""
        if now_us < self._next_us:
            return None
        self._next_us = now_us + self._interval_us
        self._sent.append(now_us * 1000)
        return now_us * 1000

    def answers_us(self, tc1_ns: int, ts1_ns: int) -> bool:
        """Whether a TIMESYNC message answers one of our requests (each is answered once)."""
        if tc1_ns <= 0 or ts1_ns not in self._sent:
            return False
        self._sent.remove(ts1_ns)
        return True
