"""A simulated autopilot, the link to it, MAVSDK and the decision logic in a thread of its own.

The companion's clock is the rig's: it goes on by what has passed since the last step, and by no more than MOST_S, so
that a machine that is busy elsewhere makes no input old.
"""

import queue
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace

from estimates import FLAT
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.core.decision_logic import DecisionLogic, Followed, LandRequest
from companion.core.health import HealthMonitor
from companion.live.commander import Commander
from companion.messages.messages import Decision, Event, Message
from companion.settings.link_options import link_options
from companion.settings.settings import LandingSettings, MavlinkSettings, Settings, VehicleSettings
from drivers.mavlink.link import Link
from drivers.samples import Frame, Sample
from drivers.simulated.vehicle.autopilot import SimulatedAutopilot
from drivers.simulated.vehicle.firmware import Firmware
from drivers.simulated.vehicle.vehicle import Multirotor
from drivers.system import host_clock
from drivers.system.host_clock import now_us
from landing.estimate import SurfaceEstimate

PATIENCE_S = 600.0
STEP_S, MOST_S = 0.03, 0.1
LAND = mavlink.MAV_CMD_NAV_LAND
STEEP = replace(FLAT, inclination_deg=30.0, flat=False)
SILENCE_US = 2_000_000
"""On the rig's clock: twice as long as a verdict has to stand."""


class LiveRig:
    """``step`` is called some thirty times a second with what the link gave; ``where`` says how far a test has come."""

    link: Link
    commander: Commander
    logic: DecisionLogic

    def __init__(self, firmware: Firmware, mode: str, height_m: float) -> None:
        self.vehicle = Multirotor()
        self.vehicle.place(0.0, 0.0, height=height_m)
        self.autopilot = SimulatedAutopilot("udpin:127.0.0.1:0", self.vehicle)
        self.controller = self.autopilot.controller
        self.controller.firmware = firmware
        self.controller.start_airborne(mode)
        self.mavlink = MavlinkSettings(connection=f"udpout:127.0.0.1:{self.autopilot.port}")
        self.codes: tuple[str, ...] = ()
        self.events: list[str] = []
        self._samples: queue.SimpleQueue[Sample] = queue.SimpleQueue()
        self._stop = threading.Event()
        self._clock_us = host_clock.now_us()
        self._driven = ExitStack()
        self._driven.enter_context(host_clock.driven(lambda: self._clock_us))
        self._thread = threading.Thread(target=self._run, daemon=True)

    def put(self, samples: Sequence[Sample]) -> None:
        """Where the link's samples and the commander's answers go."""
        for sample in samples:
            self._samples.put(sample)

    def start(self, ready: Callable[[], object]) -> None:
        """Start everything, and wait for MAVSDK and for what the test needs."""
        self.autopilot.start()
        self.link.start()
        self.commander.start()
        self._thread.start()
        self.wait(lambda: self.commander.connected and ready(), "MAVSDK and a decision")

    def close(self) -> None:
        self._stop.set()
        self._thread.join(timeout=5)
        self.commander.close()
        self.link.close()
        self.autopilot.stop()
        self._driven.close()

    def wait(self, condition: Callable[[], object], what: str) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline, f"no {what}: {self.where()}"
            time.sleep(0.01)

    def orders(self, command: int) -> int:
        """How often the autopilot was sent a command."""
        return len([c for c in self.autopilot.commands if c.command == command])

    def where(self) -> object:
        raise NotImplementedError

    def step(self, samples: list[Sample]) -> None:
        raise NotImplementedError

    def _run(self) -> None:
        before_s = time.monotonic()
        while not self._stop.wait(STEP_S):
            now_s = time.monotonic()
            self._clock_us += round(min(now_s - before_s, MOST_S) * 1e6)
            before_s = now_s
            samples = []
            while not self._samples.empty():
                samples.append(self._samples.get())
            self.step(samples)


class Flight(LiveRig):
    """Everything between the autopilot and the decision, with a surface that the test chooses."""

    def __init__(self, firmware: Firmware, mode: str, **landing: object) -> None:
        super().__init__(firmware, mode, 30.0)
        settings = Settings(
            vehicle=VehicleSettings(system_id=1),
            mavlink=self.mavlink,
            landing=LandingSettings(**landing),
        )
        self.settings = settings
        self.surface = STEEP
        self.command = "none"
        self._frame = 0
        self.link = Link(link_options(settings), self.put)
        self.commander = Commander(self.link, self.put)
        self._health = HealthMonitor(settings.health, True)
        self.logic = DecisionLogic(settings, self._health, by_pilot=True)

    def where(self) -> object:
        return self.codes, self.command, self.events

    @property
    def lands(self) -> int:
        return self.orders(LAND)

    def silent(self) -> None:
        """No command to land in a while over the best of surfaces."""
        lands, self.surface = self.lands, FLAT
        self.later(SILENCE_US)
        assert self.lands == lands, self.events

    def published(self, message: Message) -> None:
        """What is published comes here, for tests that look further."""

    def seen(self, at_us: int) -> SurfaceEstimate:
        """The surface of the next frame."""
        return self.surface

    def later(self, duration_us: int) -> None:
        """Let that much time of the rig's clock pass."""
        until_us = now_us() + duration_us
        self.wait(lambda: now_us() >= until_us, "time")

    def step(self, samples: list[Sample]) -> None:
        now = now_us()
        self._frame += 1
        self._health.count(Frame(self._frame, now, now, None), now)
        out: list[object] = []
        for sample in samples:
            self._health.count(sample, now)
            if isinstance(sample, Followed):
                out += self.logic.follow(sample, now, now)
        out += self.logic.see(replace(self.seen(now), frame=self._frame, time_s=now * 1e-6), now, now)
        for each in out:
            if isinstance(each, LandRequest):
                self.commander.request(each)
            elif isinstance(each, Event):
                self.events.append(each.event)
            elif isinstance(each, Decision):
                self.codes, self.command = each.withheld_codes or ("none",), each.command_code
            if isinstance(each, Decision | Event):
                self.published(each)
