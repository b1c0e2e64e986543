"""A ground station of a few lines, over a real UDP socket, for tests of the simulated autopilot."""

import socket
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.simulated.vehicle.autopilot import SimulatedAutopilot


class Station:
    """Speaks with an autopilot whose time is driven by the test."""

    def __init__(self, autopilot: SimulatedAutopilot) -> None:
        self.autopilot = autopilot
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.codec = mavlink.MAVLink(None, srcSystem=250, srcComponent=190)
        self.codec.robust_parsing = True
        self.messages: list[tuple[float, Any]] = []

    def send(self, message: Any) -> None:
        """To the autopilot."""
        self.socket.sendto(message.pack(self.codec), ("127.0.0.1", self.autopilot.port))
        self.codec.seq = (self.codec.seq + 1) % 256

    def command(self, command: int, *params: float) -> None:
        """A COMMAND_LONG to system 1."""
        padded = [*params, *[0.0] * (7 - len(params))]
        self.send(mavlink.MAVLink_command_long_message(1, 1, command, 0, *padded))

    def run(self, seconds: float, step_s: float = 0.01) -> None:
        """Let simulated time pass and take in what comes."""
        for _ in range(round(seconds / step_s)):
            self.autopilot.advance(self.autopilot.time_s + step_s)
            while True:
                try:
                    data = self.socket.recv(4096)
                except BlockingIOError:
                    break
                for message in self.codec.parse_buffer(data) or ():
                    self.messages.append((self.autopilot.time_s, message))

    def all(self, kind: str) -> list[Any]:
        """Messages of a type so far."""
        return [m for _, m in self.messages if m.get_type() == kind]

    def times(self, kind: str) -> list[float]:
        """When they came."""
        return [t for t, m in self.messages if m.get_type() == kind]

    def close(self) -> None:
        """Close both ends."""
        self.socket.close()
        self.autopilot.stop()
