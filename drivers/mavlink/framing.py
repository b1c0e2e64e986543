"""MAVLink frames out of a byte stream, byte for byte: what is no frame is handed out too, as garbage.

pymavlink's own stream parser swallows up to 280 bytes behind a stray start marker, valid frames with them; here a
frame that fails its checksum costs one byte and the search goes on behind it.
"""

import re
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as dialect

from drivers.mavlink import current_mode as current_mode  # before anything reads the table of messages

MARKER_V1 = 0xFE
MARKER_V2 = 0xFD
SIGNED = 0x01
"""Incompatibility flag: the frame ends with a signature."""
SIGNATURE_LENGTH = 13
_MARKER = re.compile(b"[\xfd\xfe]")
_HEADER_V1 = 6
_HEADER_V2 = 10
_CHECKSUM = 2


def checksum(frame: bytes, header_to: int, crc_extra: int) -> int:
    """CRC-16/MCRF4XX over a frame's bytes 1 to ``header_to`` and the message's extra byte."""
    return int(dialect.x25crc(frame[1:header_to] + bytes((crc_extra,))).crc)


def crc_extra_of(message_id: int) -> int | None:
    """The extra checksum byte of a message of the dialect; None for one it does not know."""
    message = dialect.mavlink_map.get(message_id)
    return None if message is None else message.crc_extra


@dataclass(frozen=True, slots=True)
class WireFrame:
    """One MAVLink frame as it came, with the header fields that decide what becomes of it."""

    data: bytes
    message_id: int
    system: int
    component: int
    sequence: int
    signed: bool
    known: bool
    """Whether the dialect knows the message, so that the checksum was checked."""


@dataclass(frozen=True, slots=True)
class Garbage:
    """Bytes that are no frame, and whether one of them looked like a frame with a wrong checksum."""

    data: bytes
    bad_checksum: bool


class FrameSplitter:
    """Cuts one byte stream into frames and garbage; every byte that was fed comes out once, in order."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._in_step = True

    def feed(self, data: bytes) -> list[WireFrame | Garbage]:
        """The frames and the garbage completed by ``data``; an unfinished frame waits for the rest."""
        if not self._buffer and (whole := _whole_frame(data)) is not None:
            self._in_step = True
            return [whole]
        self._buffer += data
        buffer = self._buffer
        pieces: list[WireFrame | Garbage] = []
        start = 0  # of the garbage that was not handed out yet
        at = 0
        bad = False
        while at < len(buffer):
            if buffer[at] not in (MARKER_V1, MARKER_V2):
                self._in_step = False
                following = _MARKER.search(buffer, at)
                at = following.start() if following else len(buffer)
                continue
            length = _frame_length(buffer, at)
            if length is None or at + length > len(buffer):
                break
            frame = _frame(bytes(buffer[at : at + length]))
            # Of a message that is not known nothing can be checked: it counts only right behind another frame.
            if frame is None or not (frame.known or (self._in_step and _boundary(buffer, at + length))):
                bad = True
                self._in_step = False
                at += 1
                continue
            self._in_step = True
            if start < at:
                pieces.append(Garbage(bytes(buffer[start:at]), bad))
                bad = False
            pieces.append(frame)
            at += length
            start = at
        if start < at:
            pieces.append(Garbage(bytes(buffer[start:at]), bad))
        del buffer[:at]
        return pieces


def _whole_frame(data: bytes) -> WireFrame | None:
    """The frame of a message that is known where ``data`` is exactly one, as most datagrams are."""
    if not data or data[0] not in (MARKER_V1, MARKER_V2) or _frame_length(data, 0) != len(data):
        return None
    frame = _frame(data)
    return frame if frame is not None and frame.known else None


def _frame_length(buffer: bytes | bytearray, at: int) -> int | None:
    """Length of the frame that begins at ``at``; None while too little of it is there."""
    if len(buffer) - at < 3:
        return None
    payload = buffer[at + 1]
    if buffer[at] == MARKER_V1:
        return _HEADER_V1 + payload + _CHECKSUM
    return _HEADER_V2 + payload + _CHECKSUM + (SIGNATURE_LENGTH if buffer[at + 2] & SIGNED else 0)


def _boundary(buffer: bytearray, at: int) -> bool:
    """Whether a frame may end here: the stream ends or another one begins."""
    return at >= len(buffer) or buffer[at] in (MARKER_V1, MARKER_V2)


def _frame(data: bytes) -> WireFrame | None:
    """The frame, or None when its flags or its checksum are wrong."""
    if data[0] == MARKER_V1:
        sequence, system, component, message_id = data[2:6]
        signed, end = False, len(data) - _CHECKSUM
    else:
        if data[2] & ~SIGNED:
            return None
        sequence, system, component = data[4:7]
        message_id = int.from_bytes(data[7:10], "little")
        signed = bool(data[2] & SIGNED)
        end = len(data) - _CHECKSUM - (SIGNATURE_LENGTH if signed else 0)
    extra = crc_extra_of(message_id)
    if extra is not None and checksum(data, end, extra) != int.from_bytes(data[end : end + 2], "little"):
        return None
    return WireFrame(data, message_id, system, component, sequence, signed, extra is not None)
