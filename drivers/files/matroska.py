"""A Matroska file of JPEG pictures that every reader can play up to the last picture that reached the disk.

The sizes of its segment and clusters are written as unknown, which the format (RFC 9559) allows for live streams, and
nothing is written later than its place: a file cut anywhere is a shorter file. FFmpeg's own writer, OpenCV's way to
it, holds back up to 256 kB (three seconds at 160 x 120), hence these lines.
"""

from typing import BinaryIO

UNKNOWN_SIZE = b"\x01\xff\xff\xff\xff\xff\xff\xff"

EBML, DOC_TYPE, DOC_TYPE_VERSION, DOC_TYPE_READ_VERSION = 0x1A45DFA3, 0x4282, 0x4287, 0x4285
SEGMENT, INFO, TIMESTAMP_SCALE, MUXING_APP, WRITING_APP = 0x18538067, 0x1549A966, 0x2AD7B1, 0x4D80, 0x5741
TRACKS, TRACK_ENTRY, TRACK_NUMBER, TRACK_UID, TRACK_TYPE, CODEC_ID = (
    0x1654AE6B,
    0xAE,
    0xD7,
    0x73C5,
    0x83,
    0x86,
)
DEFAULT_DURATION, VIDEO, PIXEL_WIDTH, PIXEL_HEIGHT = 0x23E383, 0xE0, 0xB0, 0xBA
CLUSTER, TIMESTAMP, SIMPLE_BLOCK = 0x1F43B675, 0xE7, 0xA3

TRACK_TYPE_VIDEO = 1
KEYFRAME = 0x80
NS_PER_MS = 1_000_000


class JpegMatroska:
    """Writes pictures at an even ``rate_hz``: their place in the file counts them, the true times stand elsewhere."""

    def __init__(self, file: BinaryIO, width: int, height: int, rate_hz: float) -> None:
        self._file = file
        self._rate_hz = rate_hz
        self._count = 0
        self._per_cluster = max(1, round(rate_hz))
        header = _element(
            EBML,
            _element(DOC_TYPE, b"matroska")
            + _number(DOC_TYPE_VERSION, 4)
            + _number(DOC_TYPE_READ_VERSION, 2),
        )
        info = _element(
            INFO,
            _number(TIMESTAMP_SCALE, NS_PER_MS)
            + _element(MUXING_APP, b"landslope")
            + _element(WRITING_APP, b"landslope"),
        )
        track = _element(
            TRACK_ENTRY,
            _number(TRACK_NUMBER, 1)
            + _number(TRACK_UID, 1)
            + _number(TRACK_TYPE, TRACK_TYPE_VIDEO)
            + _element(CODEC_ID, b"V_MJPEG")
            + _number(DEFAULT_DURATION, round(1e9 / rate_hz))
            + _element(VIDEO, _number(PIXEL_WIDTH, width) + _number(PIXEL_HEIGHT, height)),
        )
        file.write(header + _id(SEGMENT) + UNKNOWN_SIZE + info + _element(TRACKS, track))

    def write(self, jpeg: bytes) -> int:
        """Append one JPEG; returns its index."""
        index = self._count
        start = index - index % self._per_cluster
        at_ms, start_ms = (round(k * 1000 / self._rate_hz) for k in (index, start))
        if index == start:
            self._file.write(_id(CLUSTER) + UNKNOWN_SIZE + _number(TIMESTAMP, start_ms))
        block = bytes((0x81, *(at_ms - start_ms).to_bytes(2, "big", signed=True), KEYFRAME)) + jpeg
        self._file.write(_element(SIMPLE_BLOCK, block))
        self._count += 1
        return index


def _id(number: int) -> bytes:
    return number.to_bytes((number.bit_length() + 7) // 8, "big")


def _element(number: int, payload: bytes) -> bytes:
    """An EBML element: id, size in eight bytes, payload."""
    return _id(number) + (len(payload) | 1 << 56).to_bytes(8, "big") + payload


def _number(number: int, value: int) -> bytes:
    return _element(number, value.to_bytes(max(1, (value.bit_length() + 7) // 8), "big"))
