"""Velocities through MAVSDK's Offboard, behind the link's gate: nothing leaves after a takeover, also no word of ours.

Of MAVSDK's source: ``set_velocity_ned`` sends at once and then every 50 ms until ``stop()``, which asks for hold, or
until the plugin is gone, which asks for nothing. After a takeover it must be the latter.
"""

import math
import threading
import time
from typing import TYPE_CHECKING

from mavsdk.plugins.offboard import Offboard, OffboardError, OffboardResult, VelocityNedYaw

from drivers.autopilot.outcome import ENDED, NO_ANSWER, Outcome
from drivers.commands import CONTROL_MODES, HOLD_MODES
from drivers.mavlink.link import Link
from drivers.samples import Vector3

if TYPE_CHECKING:
    from mavsdk.system import System

STREAM_FIRST_S = 0.3
"""PX4 takes OFFBOARD only while setpoints come (OffboardChecks of its commander)."""
INSIST_S = 1.5
"""So long a refused mode is asked for again: PX4's checks lag behind the first setpoint."""
RETRY_S = 0.3
REFUSED = (OffboardResult.COMMAND_DENIED, OffboardResult.BUSY)


class OffboardControl:
    """Setpoints of one system. ``velocity`` may be called from another thread than the rest."""

    def __init__(self, system: "System", link: Link) -> None:
        self._system = system
        self._gate = link.gate
        self._plugin: Offboard | None = None
        self._using = threading.Lock()
        self._yaw_deg = 0.0

    def start(self, given_in: str, yaw: float, limit_m_s: float, lease_s: float) -> Outcome:
        """Take over from flight mode ``given_in``, standing still, and hold the heading ``yaw`` (rad).

        Velocities above ``limit_m_s`` never pass; nor does any when ``velocity`` was not called for ``lease_s``, which
        ends the taking over too.
        """
        if not math.isfinite(yaw) or not self._gate.expect(given_in, CONTROL_MODES):
            return Outcome(ENDED, (), "not called")
        self._yaw_deg = math.degrees(yaw)
        self._gate.open(limit_m_s, lease_s)
        deadline = time.monotonic() + INSIST_S
        with self._using:
            self._plugin = self._plugin or Offboard(self._system)
        self.velocity((0.0, 0.0, 0.0))
        time.sleep(STREAM_FIRST_S)
        while True:
            if not self._gate.is_open:
                return Outcome(ENDED, (), "not called")
            result = self._start()
            if self._gate.ended:
                return Outcome(ENDED, (), result.name)
            if result not in REFUSED or time.monotonic() > deadline:
                return _outcome(result)
            time.sleep(RETRY_S)

    def velocity(self, velocity_ned: Vector3) -> bool:
        """Fly with a velocity (m/s) from now on; False when the gate is shut."""
        if not self._gate.renew():
            return False
        with self._using:
            if self._plugin is None:
                return False
            try:
                self._plugin.set_velocity_ned(VelocityNedYaw(*velocity_ned, self._yaw_deg))
            except OffboardError:
                return False
        return True

    def stop(self) -> Outcome:
        """End by ourselves: no setpoint from now on, and the autopilot is asked to hold; not after a takeover."""
        if self._plugin is None or not self._gate.expect(None, CONTROL_MODES | HOLD_MODES, after=True):
            self.drop()
            return Outcome(ENDED, (), "not called")
        try:
            result = OffboardResult(self._plugin.stop())
        except OffboardError as error:
            result = OffboardResult(error.result)
        self.drop()
        return _outcome(result)

    def drop(self) -> None:
        """End without a word: MAVSDK forgets its setpoint and asks for no mode. Not while ``start`` runs."""
        self._gate.shut()
        with self._using:
            plugin, self._plugin = self._plugin, None
            if plugin is not None:
                plugin.destroy()

    def _start(self) -> OffboardResult:
        assert self._plugin is not None
        try:
            return OffboardResult(self._plugin.start())
        except OffboardError as error:
            return OffboardResult(error.result)


def _outcome(result: OffboardResult) -> Outcome:
    if result == OffboardResult.SUCCESS:
        return Outcome("ACCEPTED", (), result.name)
    return Outcome(NO_ANSWER if result == OffboardResult.TIMEOUT else result.name, (), result.name)
