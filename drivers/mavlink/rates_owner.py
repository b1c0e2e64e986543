"""One owner of the message rates: MAVSDK's own requests for rates that we ask for are answered here, and not sent."""

import threading
from collections import deque
from collections.abc import Container

from pymavlink.dialects.v20 import ardupilotmega as dialect

from drivers.mavlink.framing import WireFrame

COMMAND_LONG_ID = dialect.MAVLINK_MSG_ID_COMMAND_LONG


class RatesOwner:
    """Keeps back MAV_CMD_SET_MESSAGE_INTERVAL of MAVSDK, which asks for EXTENDED_SYS_STATE at 1 Hz at every start.

    ``takes`` is called by MAVSDK's thread; the answers are handed out later, from another one.
    """

    def __init__(self) -> None:
        self._parser = dialect.MAVLink(None)
        self._asked: deque[tuple[int, int]] = deque()
        self._lock = threading.Lock()

    def takes(self, frame: WireFrame, ours: Container[str]) -> bool:
        """Whether the frame asks for the rate of a message that is among ``ours``; it is then to be kept back."""
        if frame.message_id != COMMAND_LONG_ID:
            return False
        try:
            command = self._parser.decode(bytearray(frame.data))
        except dialect.MAVError:
            return False
        if command.command != dialect.MAV_CMD_SET_MESSAGE_INTERVAL:
            return False
        kind = dialect.mavlink_map.get(int(command.param1))
        if kind is None or kind.msgname not in ours:
            return False
        with self._lock:
            self._asked.append((frame.system, frame.component))
        return True

    def answers(self, system: int | None, component: int) -> list[bytes]:
        """COMMAND_ACK frames, as the autopilot would have sent them, for the requests kept back so far."""
        with self._lock:
            asked = list(self._asked)
            self._asked.clear()
        codec = dialect.MAVLink(None, system or 0, component)
        return [
            bytes(
                dialect.MAVLink_command_ack_message(
                    dialect.MAV_CMD_SET_MESSAGE_INTERVAL, dialect.MAV_RESULT_ACCEPTED, 0, 0, *sender
                ).pack(codec)
            )
            for sender in asked
        ]
