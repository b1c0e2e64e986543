"""Asks the autopilot for messages at rates, and looks whether they come. Time is given, none is read."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from drivers.mavlink import current_mode as current_mode  # before the ids are taken from the table

IDS = {message.msgname: number for number, message in dialect.mavlink_map.items()}


@dataclass(slots=True)
class _Stream:
    wanted_hz: float
    window_us: int
    count: int = 0
    from_us: int | None = None
    rate_hz: float | None = None
    asked: int = 0
    ask_at_us: int = 0
    slow_since_us: int | None = None
    reported_slow: bool = False
    came: bool = False
    reached: bool = False


@dataclass(frozen=True, slots=True)
class RateRequest:
    """One MAV_CMD_SET_MESSAGE_INTERVAL to send."""

    name: str
    message_id: int
    interval_us: int

    def command(self, system: int | None, component: int) -> Any:
        """The COMMAND_LONG to that component."""
        interval = dialect.MAV_CMD_SET_MESSAGE_INTERVAL
        return dialect.MAVLink_command_long_message(
            system, component, interval, 0, self.message_id, self.interval_us, 0, 0, 0, 0, 0
        )


@dataclass(slots=True)
class MessageRates:
    """What was asked for and what comes.

    ``wanted_hz`` maps message names to rates. A rate is counted over ``messages`` expected messages, over
    ``shortest_s`` at least, so that a rate somebody took away is asked for again within a second. What stays under
    ``enough`` of its rate is asked for at intervals that double up to ``longest_wait_s``, and is slow after
    ``patience_s``. One that came at its rate before can be had: it is asked for every ``first_wait_s``, since another
    program's request may stand for good (PX4).
    """

    wanted_hz: Mapping[str, float]
    shortest_s: float = 0.5
    messages: float = 4.0
    enough: float = 0.5
    first_wait_s: float = 4.0
    longest_wait_s: float = 30.0
    patience_s: float = 3.0
    _streams: dict[str, _Stream] = field(init=False)

    def __post_init__(self) -> None:
        self.forget()

    def want(self, wanted_hz: Mapping[str, float]) -> None:
        """Ask for these messages instead."""
        self.wanted_hz = wanted_hz
        self.forget()

    def forget(self) -> None:
        """The autopilot rebooted, or is another one: ask for everything again."""
        self._streams = {
            name: _Stream(hz, round(1e6 * max(self.shortest_s, self.messages / hz)))
            for name, hz in self.wanted_hz.items()
        }

    def seen(self, name: str) -> None:
        """A message came."""
        stream = self._streams.get(name)
        if stream is not None:
            stream.count += 1
            stream.came = True

    def due(self, now_us: int) -> list[RateRequest]:
        """Close the windows that are over; what is to be asked for now."""
        requests = []
        for name, stream in self._streams.items():
            self._close(stream, now_us)
            if stream.slow_since_us is None and stream.rate_hz is not None:
                continue
            if now_us >= stream.ask_at_us:
                doubled = 1 if stream.reached else 2**stream.asked
                wait_s = min(self.first_wait_s * doubled, self.longest_wait_s)
                stream.ask_at_us = now_us + int(wait_s * 1e6)
                stream.asked += 1
                requests.append(RateRequest(name, IDS[name], round(1e6 / stream.wanted_hz)))
        return requests

    def _close(self, stream: _Stream, now_us: int) -> None:
        if stream.from_us is None:
            stream.from_us = now_us
        elapsed_us = now_us - stream.from_us
        if elapsed_us < stream.window_us:
            return
        stream.rate_hz = stream.count / (elapsed_us * 1e-6)
        stream.count, stream.from_us = 0, now_us
        if stream.rate_hz >= self.enough * stream.wanted_hz:
            # asked for at once when it is lost again
            stream.asked = stream.ask_at_us = 0
            stream.slow_since_us, stream.reached = None, True
        elif stream.slow_since_us is None:
            stream.slow_since_us = now_us
        since_us = stream.slow_since_us
        stream.reported_slow = since_us is not None and now_us - since_us >= self.patience_s * 1e6

    @property
    def rates_hz(self) -> dict[str, float]:
        """The rates of the last whole windows."""
        return {name: s.rate_hz for name, s in self._streams.items() if s.rate_hz is not None}

    @property
    def slow(self) -> dict[str, float]:
        """Messages that have come too rarely for ``patience_s`` although they were asked for: name -> rate.

        One that never came is missing, not slow: ArduCopter sends no LOCAL_POSITION_NED until its estimator has an
        origin, half a minute after the boot.
        """
        return {
            name: s.rate_hz
            for name, s in self._streams.items()
            if s.reported_slow and s.came and s.rate_hz is not None
        }
