"""The landing procedure's orders on their way to the autopilot: velocities, targets, taking over and giving back."""

import math

from companion.live.commander import Commander
from companion.settings.settings import Settings
from drivers.autopilot.landing_target import LandingTarget
from drivers.mavlink.link import Link
from drivers.samples import Attitude, Sample
from drivers.system.host_clock import now_us
from landing.decision.orders import ORDER_MAX_AGE_S, Order, OrderKind

LIMIT_SLACK = 1.001
"""The link carries velocities in single precision."""


class Steering:
    """Carries out one order at a time; what is too old, or was given in a mode that is not named, is not sent."""

    def __init__(self, settings: Settings, link: Link, commander: Commander) -> None:
        self._modes = frozenset(settings.landing.takeover_modes)
        self._limit_m_s = math.sqrt(2.0) * settings.landing.max_speed_m_s * LIMIT_SLACK
        self._link, self._commander = link, commander
        self._target = LandingTarget()
        self._yaw = math.nan

    def feed(self, samples: list[Sample]) -> None:
        """Take what the vehicle says: its heading, and where it is."""
        for sample in samples:
            if isinstance(sample, Attitude):
                self._yaw = sample.yaw
            self._target.feed(sample)

    def carry_out(self, order: Order, time_unix_us: int) -> None:
        """Take the order that was given on what was seen at ``time_unix_us``; never waits."""
        late = not 0 <= now_us() - time_unix_us <= ORDER_MAX_AGE_S * 1e6
        if order.kind is OrderKind.NONE:
            self._commander.let_go()
        elif order.kind is OrderKind.STOP:
            self._commander.give_back()
        elif late:
            return
        elif order.kind is OrderKind.START:
            mode = self._link.gate.mode
            if mode in self._modes and math.isfinite(self._yaw):
                self._commander.take_over(mode, self._yaw, self._limit_m_s, ORDER_MAX_AGE_S)
        elif order.kind is OrderKind.VELOCITY:
            self._commander.velocity(order.velocity_ned)
        elif order.kind is OrderKind.TARGET:
            message = self._target.message(order.target_ned, time_unix_us, now_us())
            if message is not None:
                self._link.send(message)
