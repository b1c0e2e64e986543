"""MAVLink 2 message signing: outgoing frames are sealed, incoming ones checked.

pymavlink remembers a stream's time stamp before it has checked the signature, so one forged frame from the
future would lock out the true sender; here only a frame that proved itself moves the stamp.
"""

import hashlib
import hmac
import time
from collections.abc import Callable
from pathlib import Path

from drivers.errors import DriverError
from drivers.mavlink.framing import MARKER_V2, SIGNATURE_LENGTH, SIGNED, WireFrame, checksum, crc_extra_of

KEY_LENGTH = 32
EPOCH_UNIX_S = 1420070400
"""Signing time counts in 10 us from 1 January 2015, UTC."""
MAX_AGE = 60 * 100_000
"""A stream that was never seen may lag this much (one minute) behind the newest time that is known."""
_CHECKSUM = 2


def read_key(path: Path) -> bytes:
    """The secret key of a file: 32 bytes, or 64 hexadecimal digits. Raises DriverError when it is neither."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DriverError(f"{path}: cannot read the signing key: {error.strerror}") from error
    if len(data) == KEY_LENGTH:
        return data
    try:
        key = bytes.fromhex(data.decode("ascii").strip())
    except ValueError:
        key = b""
    if len(key) != KEY_LENGTH:
        raise DriverError(
            f"{path}: a signing key is {KEY_LENGTH} bytes or {2 * KEY_LENGTH} hexadecimal digits, "
            f"this file has {len(data)} bytes"
        )
    return key


def _wall_time() -> int:
    # A board without a clock starts in 1970; the autopilot's frames then bring the time.
    return max(0, int((time.time() - EPOCH_UNIX_S) * 1e5))


class Signer:
    """Signs and checks with one key. ``now`` gives the signing time (10 us since 2015); never goes back."""

    def __init__(self, key: bytes, link_id: int = 0, now: Callable[[], int] = _wall_time) -> None:
        self._key = key
        self._link_id = link_id
        self._now = now
        self._time = now()
        self._streams: dict[tuple[int, int, int], int] = {}

    def sign(self, frame: bytes) -> bytes:
        """The MAVLink 2 frame (unsigned) with flag, checksum and signature; other frames come back as they are."""
        if frame[0] != MARKER_V2 or frame[2] & SIGNED:
            return frame
        extra = crc_extra_of(int.from_bytes(frame[7:10], "little"))
        if extra is None:
            return frame
        self._time = max(self._time + 1, self._now())
        body = bytearray(frame[:-_CHECKSUM])
        body[2] |= SIGNED
        body += checksum(bytes(body), len(body), extra).to_bytes(2, "little")
        body += bytes((self._link_id,)) + self._time.to_bytes(6, "little")
        return bytes(body) + self._signature(bytes(body))

    def refusal(self, frame: WireFrame) -> str | None:
        """Why an incoming frame is refused ("unsigned", "wrong signature", "replayed"); None when it is sound."""
        if not frame.signed:
            return "unsigned"
        data = frame.data
        if not hmac.compare_digest(self._signature(data[:-6]), data[-6:]):
            return "wrong signature"
        stamp = int.from_bytes(data[-12:-6], "little")
        stream = (data[-13], frame.system, frame.component)
        newest = self._streams.get(stream)
        if stamp <= newest if newest is not None else stamp + MAX_AGE < self._time:
            return "replayed"
        self._streams[stream] = stamp
        self._time = max(self._time, stamp)
        return None

    def _signature(self, data: bytes) -> bytes:
        return hashlib.sha256(self._key + data).digest()[:6]


def unsigned(frame: bytes) -> bytes:
    """A signed frame without its signature, for a reader that knows no keys."""
    if frame[0] != MARKER_V2 or not frame[2] & SIGNED:
        return frame
    extra = crc_extra_of(int.from_bytes(frame[7:10], "little"))
    if extra is None:
        return frame
    body = bytearray(frame[: -SIGNATURE_LENGTH - _CHECKSUM])
    body[2] &= ~SIGNED & 0xFF
    return bytes(body) + checksum(bytes(body), len(body), extra).to_bytes(2, "little")
