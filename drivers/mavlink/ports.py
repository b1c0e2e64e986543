"""Byte ports by name: a serial line, a UDP port that listens or sends first, a TCP client."""

import errno
import ipaddress
import select
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Protocol

from drivers.errors import DriverError

FORMS = "serial:DEVICE[:BAUD], /dev/DEVICE[:BAUD], udpin:HOST:PORT, udpout:HOST:PORT or tcp:HOST:PORT"
DEFAULT_BAUD = 921600
CONNECT_TIMEOUT_S = 2.0
WRITE_TIMEOUT_S = 0.3
"""A peer that takes nothing for this long is given up and connected to anew: it must not hold the pipeline up."""
PEER_MEMORY_S = 10.0
"""How long a udpin port goes on sending to a peer that fell silent."""
MOST_PEERS = 32
"""Senders that a udpin port remembers, the latest."""
CHUNK = 65536
_UNREACHABLE = frozenset({errno.ENETUNREACH, errno.EHOSTUNREACH, errno.ENETDOWN, errno.ENOBUFS, errno.EPERM})

Address = tuple[str, int] | None


class Port(Protocol):
    """An open port. ``read`` waits at most ``timeout_s`` and returns (bytes, sender); OSError when it broke."""

    def read(self, timeout_s: float) -> tuple[bytes, Address] | None:
        """What came in, or None when nothing did."""

    def write(self, data: bytes) -> None:
        """Send; a full buffer or an absent peer loses the data, as a radio would."""

    def believe(self, sender: Address) -> None:
        """From now on send to this sender only."""

    def close(self) -> None:
        """Close; idempotent."""


@dataclass(frozen=True, slots=True)
class PortName:
    """A port's name, taken apart and checked."""

    kind: str
    host: str
    number: int

    def __str__(self) -> str:
        return f"{self.kind}:{self.host}:{self.number}"


def parse_port(text: str) -> PortName:
    """Take a port's name apart. Raises DriverError that says what the forms are."""
    kind, _, rest = ("serial", ":", text) if text.startswith("/") else text.partition(":")
    if kind == "serial":
        device, _, baud = rest.rpartition(":")
        if not device:
            device, baud = rest, str(DEFAULT_BAUD)
        if device and baud.isdecimal() and int(baud) > 0:
            return PortName(kind, device, int(baud))
    elif kind in ("udpin", "udpout", "tcp"):
        host, _, number = rest.rpartition(":")
        if host and number.isdecimal() and 0 < int(number) < 65536:
            return PortName(kind, host, int(number))
    raise DriverError(f"connection '{text}' is none of {FORMS}")


def is_local(name: PortName) -> bool:
    """Whether only this machine reaches it: a serial line, or a loopback address."""
    if name.kind == "serial" or name.host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(name.host.strip("[]")).is_loopback
    except ValueError:
        return False


def open_port(name: PortName) -> Port:
    """Open the port. Raises OSError (serial's errors are OSErrors too) when it cannot be opened now."""
    openers: dict[str, Callable[[PortName], Port]] = {
        "serial": SerialPort,
        "udpin": UdpServer,
        "udpout": UdpClient,
        "tcp": TcpClient,
    }
    return openers[name.kind](name)


def _readable(handle: int | socket.socket, timeout_s: float) -> bool:
    return bool(select.select([handle], [], [], timeout_s)[0])


class UdpServer:
    """Bound to an address; sends to all that sent lately, or only to the sender that is believed."""

    def __init__(self, name: PortName) -> None:
        self._socket = socket.socket(_family(name), socket.SOCK_DGRAM)
        try:
            self._socket.bind((name.host, name.number))
        except OSError:
            self._socket.close()
            raise
        self._socket.setblocking(False)
        self._peers: dict[tuple[str, int], float] = {}
        self._believed: Address = None

    def read(self, timeout_s: float) -> tuple[bytes, Address] | None:
        if not _readable(self._socket, timeout_s):
            return None
        try:
            data, sender = self._socket.recvfrom(CHUNK)
        except (BlockingIOError, ConnectionError):
            return None
        self._peers.pop(sender[:2], None)
        self._peers[sender[:2]] = time.monotonic()
        if len(self._peers) > MOST_PEERS:
            del self._peers[next(iter(self._peers))]
        return data, sender[:2]

    def write(self, data: bytes) -> None:
        for peer in [self._believed] if self._believed else self._recent():
            _send(partial(self._socket.sendto, data, peer))

    def _recent(self) -> list[tuple[str, int]]:
        now = time.monotonic()
        return [peer for peer, seen in list(self._peers.items()) if now - seen < PEER_MEMORY_S]

    def believe(self, sender: Address) -> None:
        self._believed = sender

    def close(self) -> None:
        self._socket.close()


class UdpClient:
    """Sends to one address and hears only that one."""

    def __init__(self, name: PortName) -> None:
        self._socket = socket.socket(_family(name), socket.SOCK_DGRAM)
        try:
            self._socket.connect((name.host, name.number))
        except OSError:
            self._socket.close()
            raise
        self._socket.setblocking(False)

    def read(self, timeout_s: float) -> tuple[bytes, Address] | None:
        if not _readable(self._socket, timeout_s):
            return None
        try:
            return self._socket.recv(CHUNK), None
        except (BlockingIOError, ConnectionError):
            return None  # nobody listens there yet

    def write(self, data: bytes) -> None:
        _send(lambda: self._socket.send(data))

    def believe(self, sender: Address) -> None:
        """There is only one."""

    def close(self) -> None:
        self._socket.close()


class TcpClient:
    """A TCP connection to a server."""

    def __init__(self, name: PortName) -> None:
        self._socket = socket.create_connection((name.host, name.number), CONNECT_TIMEOUT_S)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.settimeout(WRITE_TIMEOUT_S)

    def read(self, timeout_s: float) -> tuple[bytes, Address] | None:
        if not _readable(self._socket, timeout_s):
            return None
        data = self._socket.recv(CHUNK)
        if not data:
            raise ConnectionResetError("the other side closed the connection")
        return data, None

    def write(self, data: bytes) -> None:
        # A stream must not lose a part of a frame: after a timeout it cannot go on.
        self._socket.sendall(data)

    def believe(self, sender: Address) -> None:
        """There is only one."""

    def close(self) -> None:
        self._socket.close()


class SerialPort:
    """A serial line, 8N1, no flow control."""

    def __init__(self, name: PortName) -> None:
        import serial  # only where there is a serial line

        self._line = serial.Serial(
            name.host, name.number, timeout=0, write_timeout=WRITE_TIMEOUT_S, exclusive=True
        )

    def read(self, timeout_s: float) -> tuple[bytes, Address] | None:
        if not _readable(self._line.fileno(), timeout_s):
            return None
        data = self._line.read(CHUNK)
        if not data:
            raise ConnectionResetError("the serial device is gone")
        return data, None

    def write(self, data: bytes) -> None:
        self._line.write(data)

    def believe(self, sender: Address) -> None:
        """There is only one."""

    def close(self) -> None:
        self._line.close()


def _family(name: PortName) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in name.host else socket.AF_INET


def _send(send: Callable[[], object]) -> None:
    """Datagrams: one that cannot go out now is lost, as on a radio."""
    try:
        send()
    except (BlockingIOError, ConnectionError):
        return
    except OSError as error:
        if error.errno in _UNREACHABLE:
            return
        raise
