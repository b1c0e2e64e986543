"""MAVLink 2 message signing: outgoing frames are sealed, incoming ones checked.

pymavlink remembers a stream's time stamp before it has checked the signature, so one forged frame from the
future would lock out the true sender; here only a frame that proved itself moves the stamp.
"""

import hashlib
import hmac
import logging
import time
from collections.abc import Callable
from pathlib import Path

from drivers.errors import DriverError
from drivers.mavlink.framing import MARKER_V2, SIGNATURE_LENGTH, SIGNED, WireFrame, checksum, crc_extra_of
from drivers.mavlink.signing_memory import SigningMemory, Stream
from drivers.refusals import RefusalCode
from drivers.secrets import is_key

log = logging.getLogger(__name__)

KEY_LENGTH = 32
EPOCH_UNIX_S = 1420070400
"""Signing time counts in 10 us from 1 January 2015, UTC."""
MAX_AGE = 60 * 100_000
"""A stream that was never seen may lag this much (one minute) behind the newest time that is known."""
_CHECKSUM = 2


def read_key(text: str) -> bytes:
    """The secret key itself (64 hexadecimal digits), or that of the file which the text names.

    A file holds 32 bytes or 64 hexadecimal digits. Raises DriverError when it is neither.
    """
    if is_key(text):
        log.info("the MAVLink signing key is the one that stands in mavlink.signing_key")
        return bytes.fromhex(text)
    path = Path(text)
    log.info("the MAVLink signing key is read from the file %s", path)
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
    """Signs and checks with one key. ``now`` gives the signing time (10 us since 2015); never goes back.

    ``memory`` is where the time survives a restart; ``save`` is to be called now and then, outside of a hot path.
    """

    def __init__(
        self,
        key: bytes,
        link_id: int = 0,
        now: Callable[[], int] = _wall_time,
        memory: SigningMemory | None = None,
    ) -> None:
        self._key = key
        self._link_id = link_id
        self._now = now
        self._memory = memory
        kept_time, self._streams = memory.load() if memory is not None else (0, {})
        self._time = max(now(), kept_time)
        self._saved = self._time

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

    def refusal(self, frame: WireFrame) -> RefusalCode | None:
        """Why an incoming frame is refused; None when it is sound."""
        if not frame.signed:
            return RefusalCode.UNSIGNED
        data = frame.data
        if not hmac.compare_digest(self._signature(data[:-6]), data[-6:]):
            return RefusalCode.WRONG_SIGNATURE
        stamp = int.from_bytes(data[-12:-6], "little")
        stream = (data[-13], frame.system, frame.component)
        if stamp <= self._floor(stream):
            return RefusalCode.REPLAYED
        self._streams[stream] = stamp
        self._time = max(self._time, stamp)
        return None

    def save(self) -> None:
        """Keep the time on disk, when it has moved on."""
        if self._memory is not None and self._time > self._saved:
            self._saved = self._time
            self._memory.save(self._time, dict(self._streams))

    def _floor(self, stream: Stream) -> int:
        """The time that a frame of a stream must be newer than.

        A sender has one clock for all its links: on a link that was not heard yet, what is older than its newest
        frame elsewhere was recorded there.
        """
        if stream in self._streams:
            return self._streams[stream]
        same = [stamp for other, stamp in self._streams.items() if other[1:] == stream[1:]]
        return max(same, default=self._time - MAX_AGE)

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
