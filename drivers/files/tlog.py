"""Recorded telemetry: a tlog is a row of 8-byte big-endian microsecond stamps, each before one MAVLink packet."""

import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.errors import DriverError
from drivers.mavlink.telemetry import MESSAGE_IDS, TelemetryDecoder
from drivers.refusals import RefusalCode
from drivers.samples import Refusal, Sample

STAMP_RANGE_US = (946_684_800_000_000, 4_102_444_800_000_000)
"""The years 2000 to 2100: a stamp outside of them is no stamp."""

STAMP_OUTLIER_US = 1_000_000
"""A single stamp this far ahead of the next one is wrong; when the later ones follow it, the clock was set."""

GARBAGE = -1
"""The message id of bytes that are no packet."""

_V1, _V2, _SIGNED = 0xFE, 0xFD, 1
_MARKER = re.compile(b"[\xfd\xfe]")
_stamp = struct.Struct(">Q")
_parser = mavlink.MAVLink(None)


class Record(NamedTuple):
    """One packet of a tlog by its place: stamp at ``start``, packet behind it, payload at ``payload``.

    ``message_id`` GARBAGE: bytes that are no packet.
    """

    stamp_us: int
    start: int
    payload: int
    end: int
    message_id: int
    system: int = 0
    component: int = 0


def read_tlog(path: Path, decoder: TelemetryDecoder) -> Iterator[Sample]:
    """The samples of a tlog in the file's order; damage comes as refusals, and reading goes on behind it.

    Packets that no sample is made of are skipped by their header. Raises DriverError if the file cannot be
    read.
    """
    data = bytes_of(path)
    if not data:
        yield Refusal(0, "vehicle.tlog", RefusalCode.EMPTY_FILE, str(path))
    for record in records(data):
        if record.message_id == GARBAGE:
            reason = RefusalCode.CUT_OFF if record.end == len(data) else RefusalCode.GARBAGE
            detail = f"{record.end - record.start} bytes at {record.start}"
            yield Refusal(record.stamp_us, "vehicle.tlog", reason, detail)
        elif record.message_id in MESSAGE_IDS:
            message = decode_record(data, record)
            if message is None:
                yield Refusal(record.stamp_us, "vehicle.tlog", RefusalCode.BAD_CHECKSUM, f"at {record.start}")
            else:
                yield from decoder.decode(message, record.stamp_us)


def records(data: bytes) -> Iterator[Record]:
    """Every packet of a tlog's bytes in order; what is no packet comes as one record of garbage."""
    place, last_us = 0, 0
    record = _record_at(data, 0)
    while place < len(data):
        following = None if record is None else _record_at(data, record.end)
        if record is not None and _believed(data, record, following, last_us):
            yield record
            place, last_us, record = record.end, record.stamp_us, following
        else:
            end = _resynchronise(data, place + 1)
            yield Record(last_us, place, place, end, GARBAGE)
            place, record = end, _record_at(data, end)


def _believed(data: bytes, record: Record, following: Record | None, last_us: int) -> bool:
    """A header is believed when the next packet stands where it says; else its checksum must be right."""
    if following is None:
        return decode_record(data, record) is not None
    ahead_us = record.stamp_us - following.stamp_us
    return not (ahead_us > STAMP_OUTLIER_US and following.stamp_us >= last_us)


def _record_at(data: bytes, place: int) -> Record | None:
    """The packet whose stamp begins at ``place``, by its header alone."""
    start = place + 8
    if start + 8 > len(data):
        return None
    magic = data[start]
    if magic == _V2 and start + 12 <= len(data):
        end = start + 12 + data[start + 1] + (13 if data[start + 2] & _SIGNED else 0)
        system, component = data[start + 5], data[start + 6]
        message_id = int.from_bytes(data[start + 7 : start + 10], "little")
    elif magic == _V1:
        end = start + 8 + data[start + 1]
        system, component, message_id = data[start + 3], data[start + 4], data[start + 5]
    else:
        return None
    stamp_us = _stamp.unpack_from(data, place)[0]
    if end > len(data) or not STAMP_RANGE_US[0] < stamp_us < STAMP_RANGE_US[1]:
        return None
    return Record(stamp_us, place, start + (10 if magic == _V2 else 6), end, message_id, system, component)


def _resynchronise(data: bytes, place: int) -> int:
    """Where the next packet of a known kind with a right checksum begins, or the end of the data."""
    for marker in _MARKER.finditer(data, place + 8):
        record = _record_at(data, marker.start() - 8)
        if record is not None and decode_record(data, record) is not None:
            return record.start
    return len(data)


def decode_record(data: bytes, record: Record) -> Any | None:
    """The message of a record; None where the checksum is wrong or the dialect does not know it."""
    if record.message_id not in mavlink.mavlink_map:
        return None
    try:
        return _parser.decode(bytearray(data[record.start + 8 : record.end]))
    except mavlink.MAVError:
        return None


def bytes_of(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise DriverError(
            f"{path}: cannot be read ({error.strerror}); check the path and its rights"
        ) from None
