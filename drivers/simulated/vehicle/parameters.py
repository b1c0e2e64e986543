"""The simulated autopilot's parameters: those that the landing procedure depends on, with each firmware's defaults."""

import struct
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

COMMON = {"SYSID_THISMAV": 1.0, "FRAME_CLASS": 1.0, "LAND_SPEED": 50.0, "WPNAV_SPEED": 500.0}
ARDUPILOT = {
    "GUID_TIMEOUT": 3.0,
    "PLND_ENABLED": 0.0,
    "PLND_TYPE": 0.0,
    "PLND_EST_TYPE": 1.0,
    "PLND_XY_DIST_MAX": 2.5,
    "PLND_LAG": 0.02,
    "PLND_STRICT": 1.0,
}
"""ArduCopter's, with the defaults of its source (mode_guided.cpp, AC_PrecLand.cpp)."""
PX4 = {"COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 0, "COM_RC_OVERRIDE": 1, "PLD_BTOUT": 5.0, "PLD_HACC_RAD": 0.2}
"""PX4's, with the defaults of its source; whole numbers are its integers."""
Replies = list[tuple[float, Any]]


@dataclass(slots=True)
class Parameters:
    """Values by name, and the parameter protocol over those that the firmware has."""

    values: dict[str, float] = field(default_factory=lambda: dict(COMMON | ARDUPILOT | PX4))

    def names(self, px4: bool) -> list[str]:
        """Those of one firmware, in order."""
        others = ARDUPILOT if px4 else PX4
        return [name for name in self.values if name not in others]

    def all(self, px4: bool) -> Replies:
        """An answer to PARAM_REQUEST_LIST."""
        return [(0.005 * i, self._message(name, px4)) for i, name in enumerate(self.names(px4))]

    def read(self, m: Any, px4: bool) -> Replies:
        """An answer to PARAM_REQUEST_READ; none to a name that is not there."""
        names = self.names(px4)
        name = names[m.param_index] if 0 <= m.param_index < len(names) else _text(m.param_id)
        return [(0.0, self._message(name, px4))] if name in names else []

    def set(self, m: Any, px4: bool) -> Replies:
        """An answer to PARAM_SET."""
        name = _text(m.param_id)
        if name not in self.names(px4):
            return []
        whole = px4 and isinstance(self.values[name], int)
        self.values[name] = (
            struct.unpack("<i", struct.pack("<f", m.param_value))[0] if whole else m.param_value
        )
        return [(0.0, self._message(name, px4))]

    def _message(self, name: str, px4: bool) -> Any:
        """PX4 sends an integer's bytes in the place of the float."""
        names, value = self.names(px4), self.values[name]
        kind = mavlink.MAV_PARAM_TYPE_REAL32
        if px4 and isinstance(value, int):
            kind = mavlink.MAV_PARAM_TYPE_INT32
            value = struct.unpack("<f", struct.pack("<i", value))[0]
        return mavlink.MAVLink_param_value_message(name.encode(), value, kind, len(names), names.index(name))


def _text(value: str | bytes) -> str:
    return (value.decode("ascii", "replace") if isinstance(value, bytes) else value).rstrip("\0")
