"""What leaves the link: one sequence of numbers for all senders of our component, and a signature where asked."""

import threading
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from drivers.mavlink.framing import MARKER_V2, FrameSplitter, WireFrame, checksum, crc_extra_of
from drivers.mavlink.signing import Signer

_CHECKSUM = 2


class Sealer:
    """Packs our own messages, and takes over MAVSDK's, which share our system and component id.

    Both count their frames for themselves; on the wire they must count together, or the receiver sees loss.
    """

    def __init__(self, component: int, signer: Signer | None) -> None:
        self._mav = dialect.MAVLink(None, 0, component)
        self._signer = signer
        self._splitter = FrameSplitter()
        self._sequence = 0
        self._lock = threading.Lock()

    def pack(self, message: Any, system: int) -> bytes:
        """A pymavlink message from our component of ``system``, ready to send."""
        with self._lock:
            self._mav.srcSystem = system
            return self._seal(bytes(message.pack(self._mav)))

    def take_over(self, data: bytes) -> list[tuple[WireFrame, bytes]]:
        """Frames that MAVSDK wrote: each as it was, and as it is to be sent."""
        with self._lock:
            frames = [piece for piece in self._splitter.feed(data) if isinstance(piece, WireFrame)]
            return [(frame, self._seal(frame.data)) for frame in frames]

    def _seal(self, frame: bytes) -> bytes:
        extra = crc_extra_of(int.from_bytes(frame[7:10], "little"))
        if frame[0] != MARKER_V2 or extra is None:
            return frame
        body = bytearray(frame[:-_CHECKSUM])
        body[4] = self._sequence
        self._sequence = (self._sequence + 1) & 0xFF
        sealed = bytes(body) + checksum(bytes(body), len(body), extra).to_bytes(2, "little")
        return sealed if self._signer is None else self._signer.sign(sealed)
