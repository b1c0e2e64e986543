"""A message out of a frame whose checksum has been checked already: pymavlink's own decoder checks it again."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from drivers.mavlink.framing import MARKER_V1, SIGNATURE_LENGTH, WireFrame

PLAIN = frozenset(
    i
    for i, kind in dialect.mavlink_map.items()
    if all(length == 1 for length in kind.lengths) and not any(kind.array_lengths)
)
"""Ids of the messages without arrays and texts."""
_HEADER_V1, _HEADER_V2, _CHECKSUM = 6, 10, 2


class Unpacker:
    """Messages of plain numbers are unpacked here; those with arrays or texts are left to pymavlink.

    Some hundred of them come a second: one is filled from a blank of its kind, without pymavlink's constructors.
    """

    def __init__(self) -> None:
        self._parser = dialect.MAVLink(None)
        self._blanks: dict[int, dict[str, Any]] = {}
        """Message id -> the attributes of an empty message."""

    def unpack(self, frame: WireFrame) -> Any:
        """The pymavlink message of a frame of the dialect. Raises MAVError when it cannot be decoded."""
        if frame.message_id not in PLAIN:
            return self._parser.decode(bytearray(frame.data))
        kind = dialect.mavlink_map[frame.message_id]
        blank = self._blanks.get(frame.message_id)
        if blank is None:
            blank = self._blanks[frame.message_id] = vars(kind(*[0] * len(kind.orders)))
        data, size = frame.data, kind.unpacker.size
        version_1 = data[0] == MARKER_V1
        start = _HEADER_V1 if version_1 else _HEADER_V2
        payload = data[start : len(data) - _CHECKSUM - (SIGNATURE_LENGTH if frame.signed else 0)]
        # MAVLink 2 leaves out zeros at the end; a longer payload has fields that this dialect does not know.
        values = kind.unpacker.unpack(payload[:size].ljust(size, b"\0"))
        message = kind.__new__(kind)
        content = vars(message)
        content.update(blank)
        content.update(zip(kind.ordered_fieldnames, values, strict=True))
        flags = (0, 0) if version_1 else (data[2], data[3])
        message._header = dialect.MAVLink_header(
            frame.message_id, *flags, data[1], frame.sequence, frame.system, frame.component
        )
        return message
