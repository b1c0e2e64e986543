"""CURRENT_MODE (436), which pymavlink's ardupilotmega dialect does not know: added to its table of messages.

Only PX4 sends it. The definition is that of MAVLink's standard dialect (common.xml since 2024).
"""

import struct
from typing import Any, ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

CURRENT_MODE_ID = 436


class CurrentModeMessage(dialect.MAVLink_message):
    """``custom_mode`` is flown, ``intended_custom_mode`` was asked for last; 0: not reported."""

    id = CURRENT_MODE_ID
    msgname = name = "CURRENT_MODE"
    fieldnames: ClassVar[list[str]] = ["standard_mode", "custom_mode", "intended_custom_mode"]
    ordered_fieldnames: ClassVar[list[str]] = ["custom_mode", "intended_custom_mode", "standard_mode"]
    fieldtypes: ClassVar[list[str]] = ["uint8_t", "uint32_t", "uint32_t"]
    fielddisplays_by_name: ClassVar[dict[str, str]] = {}
    fieldenums_by_name: ClassVar[dict[str, str]] = {}
    fieldunits_by_name: ClassVar[dict[str, str]] = {}
    native_format = bytearray(b"<IIB")
    orders: ClassVar[list[int]] = [2, 0, 1]
    lengths: ClassVar[list[int]] = [1, 1, 1]
    array_lengths: ClassVar[list[int]] = [0, 0, 0]
    crc_extra = 193
    unpacker = struct.Struct("<IIB")
    instance_field = None
    instance_offset = -1

    def __init__(self, standard_mode: int, custom_mode: int, intended_custom_mode: int) -> None:
        super().__init__(self.id, self.msgname)
        self._fieldnames = self.fieldnames
        self._instance_field = self.instance_field
        self._instance_offset = self.instance_offset
        self.standard_mode = standard_mode
        self.custom_mode = custom_mode
        self.intended_custom_mode = intended_custom_mode

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        """The frame that ``mav`` sends."""
        payload = self.unpacker.pack(self.custom_mode, self.intended_custom_mode, self.standard_mode)
        return bytes(self._pack(mav, self.crc_extra, payload, force_mavlink1=force_mavlink1))


dialect.mavlink_map.setdefault(CURRENT_MODE_ID, CurrentModeMessage)
