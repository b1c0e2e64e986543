"""A message out of a frame whose checksum has been checked already: pymavlink's own decoder checks it again."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from drivers.mavlink.framing import MARKER_V1, SIGNATURE_LENGTH, WireFrame

PLAIN = frozenset(i for i, kind in dialect.mavlink_map.items() if all(length == 1 for length in kind.lengths))
"""Ids of the messages without arrays and texts."""
_HEADER_V1, _HEADER_V2, _CHECKSUM = 6, 10, 2


class Unpacker:
    """Messages of plain numbers are unpacked here; those with arrays or texts are left to pymavlink."""

    def __init__(self) -> None:
        self._parser = dialect.MAVLink(None)

    def unpack(self, frame: WireFrame) -> Any:
        """The pymavlink message of a frame of the dialect. Raises MAVError when it cannot be decoded."""
        kind = dialect.mavlink_map[frame.message_id]
        if frame.message_id not in PLAIN:
            return self._parser.decode(bytearray(frame.data))
        data, size = frame.data, kind.unpacker.size
        version_1 = data[0] == MARKER_V1
        start = _HEADER_V1 if version_1 else _HEADER_V2
        payload = data[start : len(data) - _CHECKSUM - (SIGNATURE_LENGTH if frame.signed else 0)]
        # MAVLink 2 leaves out zeros at the end; a longer payload has fields that this dialect does not know.
        values = kind.unpacker.unpack(payload[:size].ljust(size, b"\0"))
        message = kind(*[values[place] for place in kind.orders])
        flags = (0, 0) if version_1 else (data[2], data[3])
        message._header = dialect.MAVLink_header(
            frame.message_id, *flags, data[1], frame.sequence, frame.system, frame.component
        )
        return message
