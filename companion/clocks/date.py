"""The date: what must be added to the companion's clock, which never jumps, to have the true time.

The companion's clock takes the wall clock's time once, at the start; a board without a hardware clock then lives in the
past. The wall clock is believed as soon as something speaks for it, the autopilot's (GPS) time while nothing does. All
intervals stay those of the companion's clock; only what leaves the program carries the date.
"""

from collections import deque
from typing import TypeVar

import msgspec

from companion.messages.events import EVENTS
from companion.messages.messages import Health, Message
from drivers.events import DriverEvent
from drivers.samples import SystemTime
from drivers.system.host_clock import EARLIEST_UNIX_S
from drivers.system.wall_clock import WallClock

STEP_US = 500_000
"""A date that is this close is left alone: what was published stays steady."""
WITNESSES = 3
AGREE_US = 2_000_000
"""So many times of the autopilot in a row must agree so well: messages come late."""
LATEST_UNIX_US = 4_102_444_800_000_000
"""The year 2100."""
AUTOPILOT = "autopilot"

_Dated = TypeVar("_Dated", bound=Message)


class Date:
    """Takes the wall clock's state and the autopilot's times; knows what to add to times of the companion's clock."""

    def __init__(self) -> None:
        self.offset_us = 0
        """True time minus companion clock; 0 while it is not known."""
        self.source = ""
        """What the date is from; empty while it is not known."""
        self._heard: deque[int] = deque(maxlen=WITNESSES)

    @property
    def known(self) -> bool:
        """Whether the date is known."""
        return bool(self.source)

    def wall(self, clock: WallClock, now_us: int) -> DriverEvent | None:
        """Look at the wall clock; an event when the date changes by it."""
        return self._take(clock.offset_us, clock.source, now_us) if clock.source else None

    def autopilot(self, sample: SystemTime) -> DriverEvent | None:
        """A time that the autopilot sent; it counts while nothing speaks for the wall clock."""
        if not EARLIEST_UNIX_S * 1_000_000 <= sample.unix_us < LATEST_UNIX_US:
            self._heard.clear()
            return None
        self._heard.append(sample.unix_us - sample.arrival_us)
        if self.source not in ("", AUTOPILOT) or len(self._heard) < WITNESSES:
            return None
        if max(self._heard) - min(self._heard) > AGREE_US:
            return None
        # the least delayed of them is nearest to the truth
        return self._take(max(self._heard), AUTOPILOT, sample.arrival_us, AGREE_US)

    def dated(self, message: _Dated) -> _Dated:
        """The message with the true time, as far as it is known."""
        if self.offset_us:
            message = msgspec.structs.replace(message, time_unix_us=message.time_unix_us + self.offset_us)
        if isinstance(message, Health):
            offset_s = self.offset_us * 1e-6 if self.known else None
            message = msgspec.structs.replace(
                message, date_source=self.source or None, date_offset_s=offset_s
            )
        return message

    def _take(self, offset_us: int, source: str, now_us: int, step_us: int = STEP_US) -> DriverEvent | None:
        known, self.source = self.known, source
        moved = abs(offset_us - self.offset_us) > step_us
        if moved:
            self.offset_us = offset_us
        if known and not moved:
            return None
        offset_s = self.offset_us * 1e-6
        name = "date_corrected" if known else "date_known"
        text = f"the companion's clock stood {offset_s:.1f} s behind the date ({source})"
        if not known and not moved:
            text = f"the date is right ({source})"
        details = {"offset_s": round(offset_s, 3), "source": source}
        return DriverEvent(name, EVENTS[name][0], text, now_us, details)
