"""Whose frame is this? Only one sender is the vehicle; others that carry its ids are refused.

Without signing this is a guard against mistakes (two vehicles with one id, a second autopilot program, a router that
loops), not against an attacker who can read the link.
"""

from enum import Enum, auto

from drivers.mavlink.framing import MARKER_V1, WireFrame
from drivers.mavlink.ports import Address
from drivers.refusals import SECOND_GONE_S, RefusalCode


class Sender(Enum):
    """Whose frame it is, where it is not refused."""

    VEHICLE = auto()
    OTHER = auto()
    NOBODY_YET = auto()
    """No autopilot's heartbeat was heard yet."""


HEARTBEAT_ID = 0
NO_AUTOPILOT = 8
"""MAV_AUTOPILOT_INVALID: the heartbeat of something that is no autopilot."""


class SequenceCheck:
    """Whether a frame's sequence number continues its sender's.

    A jump of up to ``max_gap`` forward is loss. Any other is refused until ``confirm`` frames in a row go on from
    there with none of the old line between them (the autopilot rebooted, or much was lost).
    """

    def __init__(self, max_gap: int = 64, confirm: int = 3) -> None:
        self._max_gap = max_gap
        self._confirm = confirm
        self._next: int | None = None
        self._other_next = 0
        self._other_count = 0

    def forget(self) -> None:
        """Take the next frame as it is."""
        self._next = None
        self._other_count = 0

    def refusal(self, sequence: int) -> RefusalCode | None:
        """Why the frame is refused, or None."""
        gap = 0 if self._next is None else (sequence - self._next) & 0xFF
        if gap <= self._max_gap:
            self._take(sequence)
            return None
        if gap == 0xFF:
            return RefusalCode.REPEATED_FRAME
        follows = self._other_count > 0 and (sequence - self._other_next) & 0xFF <= self._max_gap
        self._other_count = self._other_count + 1 if follows else 1
        self._other_next = (sequence + 1) & 0xFF
        if self._other_count >= self._confirm:
            self._take(sequence)
            return None
        return RefusalCode.SEQUENCE

    def _take(self, sequence: int) -> None:
        self._next = (sequence + 1) & 0xFF
        self._other_count = 0


class VehicleIdentity:
    """Distinguishes the vehicle's frames from others.

    ``system_id`` 0 takes the first autopilot that is heard; another one then makes it ``ambiguous``, until it
    has left. A new sender address is taken only after the old one was silent for ``silence_s``.
    """

    def __init__(
        self, system_id: int, autopilot_component: int, own_component: int, silence_s: float = 3.0
    ) -> None:
        self.system_id: int | None = system_id or None
        self.sender: Address = None
        self.ambiguous = False
        """Whether a second vehicle was heard within ``SECOND_GONE_S`` although none was named."""
        self._second_us = 0
        self._named = system_id != 0
        self._component = autopilot_component
        self._own_component = own_component
        self._silence_us = int(silence_s * 1e6)
        self._sequence = SequenceCheck()
        self._heard_us: int | None = None

    def check(self, frame: WireFrame, sender: Address, now_us: int) -> Sender | RefusalCode:
        """Whose frame it is, or the reason to refuse it."""
        autopilot = frame.component == self._component and _autopilot_heartbeat(frame)
        if self.system_id is None and autopilot:
            self.system_id = frame.system
        if self.system_id is None:
            return Sender.NOBODY_YET
        if self.ambiguous and now_us - self._second_us > SECOND_GONE_S * 1e6:
            self.ambiguous = False
        if frame.system != self.system_id:
            if autopilot and not self._named:
                self.ambiguous, self._second_us = True, now_us
                return RefusalCode.SECOND_VEHICLE
            return Sender.OTHER
        if frame.component == self._own_component:
            return RefusalCode.OWN_ADDRESS
        return self._same_ids(frame, sender, now_us) if frame.component == self._component else Sender.OTHER

    def _same_ids(self, frame: WireFrame, sender: Address, now_us: int) -> Sender | RefusalCode:
        silent = self._heard_us is None or now_us - self._heard_us > self._silence_us
        if silent:
            self._sequence.forget()
        elif sender != self.sender:
            return RefusalCode.SECOND_SENDER
        refusal = self._sequence.refusal(frame.sequence)
        if refusal is not None:
            return refusal
        self.sender = sender
        self._heard_us = now_us
        return Sender.VEHICLE


def _autopilot_heartbeat(frame: WireFrame) -> bool:
    if frame.message_id != HEARTBEAT_ID:
        return False
    payload = frame.data[6 if frame.data[0] == MARKER_V1 else 10 :]
    return payload[5] != NO_AUTOPILOT
