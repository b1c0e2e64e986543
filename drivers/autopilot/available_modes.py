"""The flight modes that the autopilot itself lists (AVAILABLE_MODES), asked for over the link."""

import threading
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as dialect

from drivers.mavlink.current_mode import AVAILABLE_MODES_ID, NOT_SELECTABLE
from drivers.mavlink.flight_modes import mode_name
from drivers.mavlink.framing import MARKER_V2
from drivers.mavlink.link import Link

ASK_EVERY_US = 1_500_000
NUMBERS = {"ardupilot": dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, "px4": dialect.MAV_AUTOPILOT_PX4}


@dataclass(frozen=True, slots=True)
class ListedMode:
    """A mode by the name that heartbeats are read by, by the autopilot's own (may be empty), and who can choose it."""

    name: str
    own_name: str
    selectable: bool


class ModeReader:
    """Asks until the list is whole. ``look`` is called now and then, ``frame`` with every frame of the link.

    ``vehicle_type``: MAV_TYPE of the heartbeat, which the numbers of ArduPilot's modes depend on.
    """

    def __init__(self, link: Link, vehicle_type: int = dialect.MAV_TYPE_QUADROTOR) -> None:
        self._link = link
        self._type = vehicle_type
        self._codec = dialect.MAVLink(None)
        self._lock = threading.Lock()
        self._asked_us = -ASK_EVERY_US
        self._found: dict[int, tuple[int, int, str]] = {}
        self._total = 0

    def modes(self) -> tuple[ListedMode, ...] | None:
        """All of them; None until the list is whole, or for an autopilot whose numbers have no names here."""
        number = NUMBERS.get(self._link.autopilot or "")
        with self._lock:
            found, total = dict(self._found), self._total
        if number is None or not total or set(found) != set(range(1, total + 1)):
            return None
        return tuple(
            ListedMode(mode_name(number, self._type, custom), own, not properties & NOT_SELECTABLE)
            for custom, properties, own in found.values()
        )

    def look(self, now_us: int) -> None:
        """Ask for all of them, not too often."""
        system = self._link.system_id
        if system is None or self.modes() is not None or now_us - self._asked_us < ASK_EVERY_US:
            return
        self._asked_us = now_us
        self._link.send(
            dialect.MAVLink_command_long_message(
                system, self._link.options.autopilot_component, dialect.MAV_CMD_REQUEST_MESSAGE, 0,
                AVAILABLE_MODES_ID, 0, 0, 0, 0, 0, 0,
            )
        )  # fmt: skip

    def frame(self, arrival_us: int, data: bytes) -> None:
        """A frame of the link, either way."""
        ours = data[0] == MARKER_V2 and int.from_bytes(data[7:10], "little") == AVAILABLE_MODES_ID
        if not ours or (data[5], data[6]) != (self._link.system_id, self._link.options.autopilot_component):
            return
        try:
            message = self._codec.decode(bytearray(data))
        except dialect.MAVError:
            return
        with self._lock:
            if message.number_modes != self._total:
                self._found.clear()
                self._total = message.number_modes
            self._found[message.mode_index] = message.custom_mode, message.properties, message.mode_name
