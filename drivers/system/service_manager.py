"""State of the service for systemd: ready, status line, watchdog, stopping.

The sd_notify protocol (man 3 sd_notify): each message is one datagram of text to the socket named by NOTIFY_SOCKET.
"""

import os
import socket
import time
from collections.abc import Mapping

PINGS_PER_INTERVAL = 3
"""Watchdog messages within one watchdog interval, at most; systemd recommends at least two."""

MAX_STATUS = 200
"""Longest status line, in characters; longer ones are cut."""


class ServiceManager:
    """Sends to the socket in NOTIFY_SOCKET; every method does nothing when the process is not a systemd service.

    ``alive`` is called by the loop that the watchdog guards, after each round of work; it limits its own rate, so
    calling it for every frame is fine. Sending never blocks and never raises: when the socket is full or closed the
    message is lost.
    """

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        self._address = environment.get("NOTIFY_SOCKET", "")
        self._socket: socket.socket | None = None
        if self._address[:1] in ("/", "@"):
            self._address = self._address.replace("@", "\0", 1) if self._address[0] == "@" else self._address
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)
        self.watchdog_s = _watchdog_s(environment) if self._socket else 0.0
        self._next_ping = 0.0
        self._status = ""

    @property
    def present(self) -> bool:
        """Whether a service manager listens."""
        return self._socket is not None

    def ready(self) -> None:
        """The service is up."""
        self._send("READY=1")

    def status(self, text: str) -> None:
        """One line for 'systemctl status'; the same one again is not sent."""
        line = " ".join(text.split())[:MAX_STATUS]
        if line != self._status:
            self._status = line
            self._send(f"STATUS={line}")

    def alive(self) -> None:
        """The loop works: triggers the watchdog, when one is set."""
        now = time.monotonic()
        if self.watchdog_s and now >= self._next_ping:
            self._next_ping = now + self.watchdog_s / PINGS_PER_INTERVAL
            self._send("WATCHDOG=1")

    def stopping(self) -> None:
        """The service is stopping."""
        self._send("STOPPING=1")

    def more_time(self, seconds: float) -> None:
        """Ask for so many seconds from now before systemd gives up starting or stopping."""
        self._send(f"EXTEND_TIMEOUT_USEC={round(seconds * 1e6)}")

    def close(self) -> None:
        """Close the socket; later calls do nothing."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, message: str) -> None:
        if self._socket is None:
            return
        try:
            self._socket.sendto(message.encode(), self._address)
        except OSError:
            return


def _watchdog_s(environment: Mapping[str, str]) -> float:
    """The watchdog's interval in seconds; 0: there is none, or it watches another process."""
    microseconds, pid = environment.get("WATCHDOG_USEC", ""), environment.get("WATCHDOG_PID", "")
    if not microseconds.isdecimal() or (pid and pid != str(os.getpid())):
        return 0.0
    return int(microseconds) * 1e-6
