"""Asks the autopilot for messages at rates, and looks whether they come. Time is given, none is read."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import ardupilotmega as dialect

IDS = {message.msgname: number for number, message in dialect.mavlink_map.items()}


@dataclass(slots=True)
class _Stream:
    wanted_hz: float
    count: int = 0
    rate_hz: float | None = None
    asked: int = 0
    ask_at_us: int = 0


@dataclass(frozen=True, slots=True)
class RateRequest:
    """One MAV_CMD_SET_MESSAGE_INTERVAL to send."""

    name: str
    message_id: int
    interval_us: int


@dataclass(slots=True)
class MessageRates:
    """What was asked for and what comes.

    ``wanted_hz`` maps message names to rates. Every ``window_s`` the real rates are taken; a message under ``enough``
    of its rate is asked for again, at intervals that double up to ``longest_wait_s``.
    """

    wanted_hz: Mapping[str, float]
    window_s: float = 2.0
    enough: float = 0.5
    longest_wait_s: float = 30.0
    _streams: dict[str, _Stream] = field(init=False)
    _window_from_us: int | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self._streams = {name: _Stream(hz) for name, hz in self.wanted_hz.items()}

    def want(self, wanted_hz: Mapping[str, float]) -> None:
        """Ask for these messages instead."""
        self.wanted_hz = wanted_hz
        self.forget()

    def forget(self) -> None:
        """The autopilot rebooted, or is another one: ask for everything again."""
        self._streams = {name: _Stream(hz) for name, hz in self.wanted_hz.items()}
        self._window_from_us = None

    def seen(self, name: str) -> None:
        """A message came."""
        stream = self._streams.get(name)
        if stream is not None:
            stream.count += 1

    def due(self, now_us: int) -> list[RateRequest]:
        """Close the window when it is over; what is to be asked for now."""
        if self._window_from_us is None:
            self._window_from_us = now_us
        elapsed_s = (now_us - self._window_from_us) / 1e6
        if elapsed_s >= self.window_s:
            for stream in self._streams.values():
                stream.rate_hz, stream.count = stream.count / elapsed_s, 0
            self._window_from_us = now_us
        requests = []
        for name, stream in self._streams.items():
            slow = stream.rate_hz is None or stream.rate_hz < self.enough * stream.wanted_hz
            if not slow:
                stream.asked = 1
            elif now_us >= stream.ask_at_us:
                wait_s = min(2 * self.window_s * 2**stream.asked, self.longest_wait_s)
                stream.ask_at_us = now_us + int(wait_s * 1e6)
                stream.asked += 1
                requests.append(RateRequest(name, IDS[name], round(1e6 / stream.wanted_hz)))
        return requests

    @property
    def rates_hz(self) -> dict[str, float]:
        """The rates of the last whole window."""
        return {name: s.rate_hz for name, s in self._streams.items() if s.rate_hz is not None}

    @property
    def slow(self) -> dict[str, float]:
        """Messages that came too rarely although they were asked for twice: name -> rate."""
        return {
            name: s.rate_hz
            for name, s in self._streams.items()
            if s.rate_hz is not None and s.asked > 1 and s.rate_hz < self.enough * s.wanted_hz
        }
