"""AVAILABLE_MODES (435) and CURRENT_MODE (436), added to pymavlink's ardupilotmega dialect, which lacks them.

ArduPilot (since 4.7) and PX4 (since 1.15) list their flight modes with the former; only PX4 sends the latter. The
definitions are those of MAVLink's standard dialect (common.xml since 2024).
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


AVAILABLE_MODES_ID = 435
NOT_SELECTABLE = 2
"""MAV_MODE_PROPERTY_NOT_USER_SELECTABLE of ``properties``."""


class AvailableModesMessage(dialect.MAVLink_message):
    """One of ``number_modes`` modes; ``mode_index`` from 1. ``mode_name`` is empty where the mode is a standard one."""

    id = AVAILABLE_MODES_ID
    msgname = name = "AVAILABLE_MODES"
    fieldnames: ClassVar[list[str]] = [
        "number_modes", "mode_index", "standard_mode", "custom_mode", "properties", "mode_name",
    ]  # fmt: skip
    ordered_fieldnames: ClassVar[list[str]] = [
        "custom_mode", "properties", "number_modes", "mode_index", "standard_mode", "mode_name",
    ]  # fmt: skip
    fieldtypes: ClassVar[list[str]] = ["uint8_t", "uint8_t", "uint8_t", "uint32_t", "uint32_t", "char"]
    fielddisplays_by_name: ClassVar[dict[str, str]] = {}
    fieldenums_by_name: ClassVar[dict[str, str]] = {}
    fieldunits_by_name: ClassVar[dict[str, str]] = {}
    native_format = bytearray(b"<IIBBBc")
    orders: ClassVar[list[int]] = [2, 3, 4, 0, 1, 5]
    lengths: ClassVar[list[int]] = [1, 1, 1, 1, 1, 1]
    array_lengths: ClassVar[list[int]] = [0, 0, 0, 0, 0, 35]
    crc_extra = 134
    unpacker = struct.Struct("<IIBBB35s")
    instance_field = None
    instance_offset = -1

    def __init__(
        self,
        number_modes: int,
        mode_index: int,
        standard_mode: int,
        custom_mode: int,
        properties: int,
        mode_name: bytes,
    ) -> None:
        super().__init__(self.id, self.msgname)
        self._fieldnames = self.fieldnames
        self._instance_field = self.instance_field
        self._instance_offset = self.instance_offset
        self.number_modes, self.mode_index = number_modes, mode_index
        self.standard_mode, self.custom_mode, self.properties = standard_mode, custom_mode, properties
        self._mode_name_raw = mode_name
        self.mode_name = mode_name.split(b"\0", 1)[0].decode("ascii", errors="replace")

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        """The frame that ``mav`` sends."""
        payload = self.unpacker.pack(
            self.custom_mode, self.properties, self.number_modes, self.mode_index, self.standard_mode,
            self._mode_name_raw,
        )  # fmt: skip
        return bytes(self._pack(mav, self.crc_extra, payload, force_mavlink1=force_mavlink1))


dialect.mavlink_map.setdefault(AVAILABLE_MODES_ID, AvailableModesMessage)
