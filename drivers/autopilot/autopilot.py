"""Commands to the autopilot through MAVSDK: land, hold, and velocity setpoints (``offboard``).

MAVSDK has no port of its own. Its raw connection exchanges bytes with our ``Link``, which owns the port, so that every
command passes the link's gate: none goes out after the pilot changed the flight mode.
"""

import logging
import threading
import time
from collections.abc import Callable

import mavsdk
from mavsdk.plugins.action import Action, ActionError, ActionResult
from pymavlink.dialects.v20 import ardupilotmega as dialect

from drivers.autopilot.offboard import OffboardControl
from drivers.autopilot.outcome import ENDED, NO_ANSWER, NO_AUTOPILOT, Outcome
from drivers.commands import DO_SET_MODE, HOLD_MODES, LAND_MODES, NAV_LAND
from drivers.errors import DriverError
from drivers.mavlink.link import Link
from drivers.samples import CommandAnswer
from drivers.system.host_clock import now_us

log = logging.getLogger(__name__)

PX4_PRECLAND = (4, 9)
"""Main and sub mode of PX4's AUTO/PRECLAND."""
ASK_S, ASKS = 0.5, 3
"""Seconds until an unanswered request for a mode is repeated, and how many requests are sent in all."""
LEVELS = {
    mavsdk.LogLevel.DEBUG: logging.DEBUG,
    mavsdk.LogLevel.INFO: logging.DEBUG,  # MAVSDK reports every discovered component at this level
    mavsdk.LogLevel.WARN: logging.INFO,
    mavsdk.LogLevel.ERROR: logging.WARNING,
}
SUBSCRIBED_FIRST = "No raw connection available"
"""MAVSDK logs this when bytes are subscribed to before there is a connection, as ``_start`` does on purpose."""
FIRST_AUTOPILOT_S = 2.0
"""How long ``connect`` waits for MAVSDK to find the vehicle."""


class Autopilot:
    """MAVSDK on ``link``. Commands block their caller until the answer (12 s at most), one at a time.

    ``close`` waits for a running command. MAVSDK sends heartbeats as an onboard controller once it is connected. Every
    command returns an ``Outcome``: the result, the autopilot's own answers in order, and MAVSDK's name for it.
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self._mavsdk: mavsdk.Mavsdk | None = None
        self._action: Action | None = None
        self.offboard: OffboardControl | None = None
        """Setpoints; None until connected."""
        self._busy = threading.Lock()

    @property
    def connected(self) -> bool:
        """Whether MAVSDK has found the vehicle."""
        return self._action is not None

    def connect(self, timeout_s: float = FIRST_AUTOPILOT_S) -> bool:
        """Wait up to ``timeout_s`` for MAVSDK to find the vehicle that the link knows; True when it has. May be
        repeated.

        Raises DriverError when MAVSDK does not open its connection.
        """
        if self.connected:
            return True
        system_id = self._link.system_id
        if system_id is None:
            return False
        if self._mavsdk is None:
            self._mavsdk = self._start(system_id)
        system = self._mavsdk.first_autopilot(timeout_s)
        if system is None:
            return False
        self.offboard = OffboardControl(system, self._link)
        self._action = Action(system)
        return True

    def land(self, given_in: str | None = None) -> Outcome:
        """Send MAV_CMD_NAV_LAND, once, and wait for its end (MAVSDK repeats it only while no answer comes).

        ``given_in`` is the flight mode in which the order was given (None: the present one); in another mode nothing
        is sent. MAVSDK calls both denials by one name; the autopilot's own answers, read on the link, distinguish them.
        """
        return self._command(NAV_LAND, lambda action: action.land(), given_in, LAND_MODES)

    def land_on_target(self, given_in: str | None = None) -> Outcome:
        """PX4: ask for the mode PRECLAND, which follows LANDING_TARGET; where that is refused, ``land``.

        ArduCopter's LAND follows LANDING_TARGET by itself.
        """
        if self._link.autopilot != "px4":
            return self.land(given_in)
        with self._busy:
            answer = self._ask_for_mode(given_in)
        if answer == "ACCEPTED":
            return Outcome("ACCEPTED", (), "own request for PRECLAND")
        log.warning("precision landing: %s; landing where it is", answer.lower().replace("_", " "))
        return self.land(given_in)

    def hold(self) -> Outcome:
        """Ask for hold (PX4) or the mode that MAVSDK takes for it (ArduPilot: BRAKE)."""
        return self._command(None, lambda action: action.hold(), None, HOLD_MODES)

    def close(self) -> None:
        """Let a command end, then release MAVSDK."""
        with self._busy:
            self._action = self.offboard = None
            instance, self._mavsdk = self._mavsdk, None
            self._link.raw_out = None
            if instance is not None:
                instance.destroy()

    def _start(self, system_id: int) -> mavsdk.Mavsdk:
        configuration = mavsdk.Configuration.create_with_component_type(
            mavsdk.ComponentType.COMPANION_COMPUTER
        )
        configuration.system_id = system_id
        configuration.component_id = self._link.options.own_component
        mavsdk.log_subscribe(_log)
        instance = mavsdk.Mavsdk(configuration)
        # In this order, since the first heartbeat goes out with the connection.
        instance.subscribe_raw_bytes_to_be_sent(self._link.send_raw)
        result = instance.add_any_connection("raw://")
        if result != mavsdk.ConnectionResult.SUCCESS:
            instance.destroy()
            raise DriverError(f"MAVSDK does not open its raw connection: {result.name}")
        self._link.raw_out = instance.pass_received_raw_bytes
        return instance

    def _ask_for_mode(self, given_in: str | None) -> str:
        """Request PRECLAND of PX4, up to ``ASKS`` times; the answer's MAV_RESULT by name, or why there is none."""
        if not self._link.gate.expect(given_in or self._link.gate.mode, LAND_MODES):
            return ENDED
        began_us, system = now_us(), self._link.system_id
        message = dialect.MAVLink_command_long_message(
            system, self._link.options.autopilot_component, DO_SET_MODE, 0,
            dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, *PX4_PRECLAND, 0, 0, 0, 0,
        )  # fmt: skip
        for _ in range(ASKS):
            if self._link.gate.ended:
                return ENDED
            self._link.send(message)
            deadline = time.monotonic() + ASK_S
            while time.monotonic() < deadline:
                for answer in tuple(self._link.answers):
                    if answer.command == DO_SET_MODE and answer.arrival_us >= began_us:
                        return answer.result
                time.sleep(0.01)
        return NO_ANSWER

    def _command(
        self,
        command: int | None,
        call: Callable[[Action], object],
        given_in: str | None,
        goal: frozenset[str],
    ) -> Outcome:
        """Carry out ``call`` while the vehicle is in the mode ``given_in`` or one of ``goal``.

        ``command`` is the MAV_CMD whose answers count; None: every command's.
        """
        with self._busy:
            if self._action is None:
                return Outcome(NO_AUTOPILOT, (), "NO_SYSTEM")
            if not self._link.gate.expect(given_in or self._link.gate.mode, goal):
                return Outcome(ENDED, (), "not called")
            began_us = now_us()
            try:
                call(self._action)
                result = ActionResult.SUCCESS
            except ActionError as error:
                result = ActionResult(error.result)
            answers = tuple(
                answer.result
                for answer in tuple(self._link.answers)
                if _answers(answer, command) and answer.arrival_us >= began_us
            )
            return Outcome(_result(result, answers), answers, result.name)


def _answers(answer: CommandAnswer, command: int | None) -> bool:
    return command is None or answer.command == command


def _result(result: ActionResult, answers: tuple[str, ...]) -> str:
    """The autopilot's last answer where there is one: MAVSDK has one name for both kinds of denial."""
    if result == ActionResult.SUCCESS:
        return "ACCEPTED"
    final = [answer for answer in answers if answer != "IN_PROGRESS"]
    if final:
        return final[-1]
    if result == ActionResult.NO_SYSTEM:
        return NO_AUTOPILOT
    if result in (ActionResult.TIMEOUT, ActionResult.CONNECTION_ERROR):
        return NO_ANSWER
    return result.name


def _log(level: mavsdk.LogLevel, message: str, file: str | None, line: int) -> bool:
    if not message.startswith(SUBSCRIBED_FIRST):
        log.log(LEVELS[level], "mavsdk: %s", message)
    return True
