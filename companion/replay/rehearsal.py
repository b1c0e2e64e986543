"""A rehearsal on the bench: a recorded flight decides, the connected autopilot gets the real command."""

import queue
import time
from dataclasses import replace

from companion.core.command import WAITING, Command, CommandState
from companion.core.core import LandRequest
from companion.errors import LandslopeError
from companion.live.commander import LONGEST_COMMAND_S, Commander
from companion.settings.link_options import link_options
from companion.settings.settings import Settings
from drivers.mavlink.link import Link
from drivers.samples import CommandAnswer, Heartbeat, LandedState, Sample
from drivers.system.host_clock import now_us

FIND_S = 10.0
FOLLOW_S = 10.0
"""How long after the answer the mode is still followed when the recording has ended."""

Followed = CommandAnswer | Heartbeat | LandedState


class Rehearsal:
    """The autopilot at ``connection``.

    Its answers, heartbeats and landed state replace the recorded ones from the request on, at the recording's time.
    Raises LandslopeError when no autopilot is heard.
    """

    def __init__(self, connection: str, settings: Settings) -> None:
        self._samples: queue.SimpleQueue[Sample] = queue.SimpleQueue()
        self._shift_us: int | None = None
        self._state = CommandState(settings.landing.mode_timeout_s)
        self._followed_until = 0.0
        self._link = Link(link_options(settings, connection), self._take)
        self._commander = Commander(self._link, self._take)
        self._link.start()
        self._commander.start()
        deadline = time.monotonic() + FIND_S
        while not self._commander.connected:
            if time.monotonic() > deadline:
                self.close()
                raise LandslopeError(
                    f"no autopilot was heard on {connection} within {FIND_S:g} s: "
                    "check the connection, the baud rate and vehicle.system_id"
                )
            time.sleep(0.05)

    def request(self, request: LandRequest) -> None:
        """Send the command; returns at once."""
        while not self._samples.empty():
            self._samples.get_nowait()  # of the time before the request
        self._shift_us = request.time_unix_us - now_us()
        self._state.request(request.time_unix_us)
        self._followed_until = time.monotonic() + LONGEST_COMMAND_S + FOLLOW_S
        self._commander.request(request)

    def replaces(self, sample: Sample) -> bool:
        """Whether a recorded sample gives way to the connected autopilot's own."""
        return self._shift_us is not None and isinstance(sample, Followed)

    def samples(self) -> list[Sample]:
        """What the autopilot said since the last call, at the recording's time; nothing before the request."""
        taken = []
        while not self._samples.empty():
            sample = self._samples.get_nowait()
            if self._shift_us is not None:
                sample = replace(sample, arrival_us=sample.arrival_us + self._shift_us)
                self._state.feed(sample)
                taken.append(sample)
        return taken

    @property
    def busy(self) -> bool:
        """Whether the command still waits for its answer, or for the mode to follow it."""
        waiting = self._state.code in WAITING or self._state.code is Command.ACCEPTED
        return self._commander.busy or (waiting and time.monotonic() < self._followed_until)

    def close(self) -> None:
        """End the link, a command under way first."""
        self._commander.close()
        self._link.close()

    def _take(self, samples: list[Sample]) -> None:
        for sample in samples:
            if isinstance(sample, Followed):
                self._samples.put(sample)
