"""MAVLink 2 message signing (mavlink.io/en/guide/message_signing.html): signs outgoing frames, checks incoming ones.

A signature is six bytes of SHA-256 over key and frame, with a time stamp (10 us since 2015) that must increase within a
stream, against replayed frames. pymavlink stores a stream's time stamp before it has checked the signature, so that one
forged frame with a late stamp locks out the true sender. Here only a frame with a valid signature moves the stamp.
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
"""Bytes of a key."""
EPOCH_UNIX_S = 1420070400
"""Signing time is counted in units of 10 us from this moment: 1 January 2015, UTC."""
MAX_AGE = 60 * 100_000
"""A new stream may be this much (one minute, in units of 10 us) behind the newest known time."""
_CHECKSUM = 2


def read_key(text: str) -> bytes:
    """The key (32 bytes) from the setting: its 64 hexadecimal digits, or the name of a file with it.

    A file holds 32 bytes or 64 hexadecimal digits. Raises DriverError when it is neither.
    """
    if is_key(text):
        log.info("the MAVLink signing key is the value of mavlink.signing_key")
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
    """Signs and checks frames with one key.

    ``link_id`` is written into every signature. ``now`` returns the signing time (10 us since 2015); the signer's own
    time never decreases, so a clock that falls back repeats no stamp. ``memory`` keeps the time over a restart;
    ``save`` writes to it and is to be called every few seconds.
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
        """An unsigned MAVLink 2 frame with flag, checksum and signature; all other frames unchanged."""
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
        """Why an incoming frame is refused; None when it is accepted, which also moves its stream's time stamp."""
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
        """Write time and streams to the memory, when the time has increased."""
        if self._memory is not None and self._time > self._saved:
            self._saved = self._time
            self._memory.save(self._time, dict(self._streams))

    def _floor(self, stream: Stream) -> int:
        """The time stamp that a frame of a stream must exceed.

        A sender has one clock for all its links: on a new link, a frame that is older than the sender's newest one on
        another link is a recording of it.
        """
        if stream in self._streams:
            return self._streams[stream]
        same = [stamp for other, stamp in self._streams.items() if other[1:] == stream[1:]]
        return max(same, default=self._time - MAX_AGE)

    def _signature(self, data: bytes) -> bytes:
        return hashlib.sha256(self._key + data).digest()[:6]


def unsigned(frame: bytes) -> bytes:
    """A signed frame without its signature, for a program that has no key; other frames unchanged."""
    if frame[0] != MARKER_V2 or not frame[2] & SIGNED:
        return frame
    extra = crc_extra_of(int.from_bytes(frame[7:10], "little"))
    if extra is None:
        return frame
    body = bytearray(frame[: -SIGNATURE_LENGTH - _CHECKSUM])
    body[2] &= ~SIGNED & 0xFF
    return bytes(body) + checksum(bytes(body), len(body), extra).to_bytes(2, "little")
