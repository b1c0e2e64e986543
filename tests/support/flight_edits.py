"""Named edits of a recorded flight: what may go wrong between a camera or an autopilot and the daemon."""

import struct
from collections.abc import Callable

import cv2
import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect
from vehicle_support import patched

ATTITUDE, ATTITUDE_QUATERNION, RAW_IMU, EXTENDED_SYS_STATE = 30, 31, 27, 245
BOOT_MS = frozenset({30, 31, 32, 33, 132})
"""Messages whose payload begins with time_boot_ms (uint32)."""
BOOT_US = frozenset({27})
"""Messages whose payload begins with a uint64 of microseconds."""

Frames = Callable[[float, np.ndarray], "np.ndarray | tuple[np.ndarray, int] | None"]
Telemetry = Callable[[float, bytes], list[bytes]]


def message_id(frame: bytes) -> int:
    """Of a MAVLink 2 frame."""
    return int.from_bytes(frame[7:10], "little")


class During:
    """An edit that holds from ``start_s`` to ``end_s`` of the cut."""

    def __init__(self, start_s: float, end_s: float) -> None:
        self.start_s = start_s
        self.end_s = end_s

    def __contains__(self, t_s: float) -> bool:
        return self.start_s <= t_s < self.end_s


def unplugged(when: During) -> Frames:
    return lambda t, image: None if t in when else image


def frozen(when: During, noise: float = 0.0) -> Frames:
    """The camera hangs on one picture; with ``noise`` (grey levels) no two are the same bit for bit."""
    held: list[np.ndarray] = []
    random = np.random.default_rng(1)

    def edit(t: float, image: np.ndarray) -> np.ndarray:
        if t not in when:
            return image
        held.append(image)
        if not noise:
            return held[0]
        return np.clip(held[0] + random.normal(0, noise, image.shape), 0, 255).astype(np.uint8)

    return edit


def half_size(when: During) -> Frames:
    return lambda t, image: cv2.resize(image, None, fx=0.5, fy=0.5) if t in when else image


def without(when: During, *ids: int) -> Telemetry:
    """These messages do not come."""
    return lambda t, frame: [] if t in when and message_id(frame) in ids else [frame]


def thinned(when: During, every: int, *ids: int) -> Telemetry:
    """Only one in ``every`` of these comes."""
    count = 0

    def edit(t: float, frame: bytes) -> list[bytes]:
        nonlocal count
        if t not in when or message_id(frame) not in ids:
            return [frame]
        count += 1
        return [frame] if count % every == 0 else []

    return edit


def not_finite(when: During) -> Telemetry:
    """ATTITUDE and ATTITUDE_QUATERNION with NaN and infinite angles."""

    def edit(t: float, frame: bytes) -> list[bytes]:
        if t in when and message_id(frame) in (ATTITUDE, ATTITUDE_QUATERNION):
            return [patched(frame, 4, struct.pack("<2f", np.nan, np.inf))]
        return [frame]

    return edit


def rebooted(at_s: float, silent_s: float) -> Telemetry:
    """The autopilot falls silent and comes back with its boot time begun anew."""
    first: dict[str, int] = {}

    def edit(t: float, frame: bytes) -> list[bytes]:
        if t < at_s:
            return [frame]
        if t < at_s + silent_s:
            return []
        kind = message_id(frame)
        if kind in BOOT_MS:
            (boot_ms,) = struct.unpack("<I", frame[10:14])
            zero = first.setdefault("ms", boot_ms - 500)
            return [patched(frame, 0, struct.pack("<I", boot_ms - zero))]
        if kind in BOOT_US:
            (boot_us,) = struct.unpack("<Q", frame[10:18])
            zero = first.get("ms")
            return [] if zero is None else [patched(frame, 0, struct.pack("<Q", boot_us - zero * 1000))]
        return [frame]

    return edit


def rc_channels(switch_us: int, channel: int = 8) -> dialect.MAVLink_rc_channels_message:
    """RC_CHANNELS with centred sticks and one switch."""
    pulses = [1500] * 4 + [1000] * 14
    pulses[channel - 1] = switch_us
    return dialect.MAVLink_rc_channels_message(0, 18, *pulses, 200)


class HeldBack:
    """An edit of a played recording: messages sent in a span are held, then come at ``pace`` for each that is sent."""

    def __init__(self, from_s: float, to_s: float, pace: int) -> None:
        self._from_s, self._to_s, self._pace = from_s, to_s, pace
        self._held: list[bytes] = []

    def __call__(self, t_s: float, frame: bytes) -> list[bytes]:
        if t_s < self._from_s:
            return [frame]
        self._held.append(frame)
        if t_s < self._to_s:
            return []
        out, self._held = self._held[: self._pace], self._held[self._pace :]
        return out
