"""The autopilot's parameters, read by name over the link (PARAM_REQUEST_READ); nothing here writes one."""

import struct
import threading
from collections.abc import Iterable

from pymavlink.dialects.v20 import ardupilotmega as dialect

from drivers.mavlink.framing import MARKER_V2
from drivers.mavlink.link import Link

PARAM_VALUE_ID = dialect.MAVLINK_MSG_ID_PARAM_VALUE
ASK_EVERY_US = 400_000
_WHOLE = {
    dialect.MAV_PARAM_TYPE_UINT8: "<B3x",
    dialect.MAV_PARAM_TYPE_INT8: "<b3x",
    dialect.MAV_PARAM_TYPE_UINT16: "<H2x",
    dialect.MAV_PARAM_TYPE_INT16: "<h2x",
    dialect.MAV_PARAM_TYPE_UINT32: "<I",
    dialect.MAV_PARAM_TYPE_INT32: "<i",
}
"""MAV_PARAM_TYPE -> how PX4 puts an integer into the float's four bytes; ArduPilot sends its value as a float."""


class ParameterReader:
    """Asks for ``names`` until each was answered. ``look`` is called now and then, ``frame`` with every frame."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._codec = dialect.MAVLink(None)
        self._lock = threading.Lock()
        self._asked_us = -ASK_EVERY_US
        self._values: dict[str, float] = {}

    @property
    def values(self) -> dict[str, float]:
        """Those that came so far."""
        with self._lock:
            return dict(self._values)

    def look(self, names: Iterable[str], now_us: int) -> None:
        """Ask for those that are missing, not too often."""
        if self._link.system_id is None or now_us - self._asked_us < ASK_EVERY_US:
            return
        self._asked_us = now_us
        known = self.values
        for name in names:
            if name not in known:
                self._link.send(
                    dialect.MAVLink_param_request_read_message(
                        self._link.system_id, self._link.options.autopilot_component, name.encode(), -1
                    )
                )

    def frame(self, arrival_us: int, data: bytes) -> None:
        """A frame of the link, either way."""
        ours = data[0] == MARKER_V2 and int.from_bytes(data[7:10], "little") == PARAM_VALUE_ID
        if not ours or data[6] != self._link.options.autopilot_component:
            return
        try:
            message = self._codec.decode(bytearray(data))
        except dialect.MAVError:
            return
        form = _WHOLE.get(message.param_type) if self._link.autopilot == "px4" else None
        value = message.param_value
        if form is not None:
            value = struct.unpack(form, struct.pack("<f", value))[0]
        with self._lock:
            self._values[message.param_id.rstrip("\0")] = float(value)
