"""Sockets of the simulated autopilot: UDP as a client or a server, TCP as a server, any number of peers."""

import contextlib
import socket
from collections import deque
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.errors import DriverError

RECEIVE_BYTES = 65536
MAX_UNSENT = 1_000_000
"""A TCP peer that has not read this many bytes is dropped."""


@dataclass(slots=True, eq=False)
class Peer:
    """Somebody who talks with the autopilot: own sequence numbers, own delayed queue."""

    address: Any
    codec: Any
    stream: socket.socket | None = None
    queue: deque[tuple[float, bytes]] = field(default_factory=deque)
    """(when it goes out, bytes), in order: a link delays messages but does not swap them."""
    open: bool = True
    unsent: bytearray = field(default_factory=bytearray)
    """What a TCP peer has not taken yet."""


class Endpoint:
    """``udpout:HOST:PORT``, ``udpin:HOST:PORT`` or ``tcp:HOST:PORT`` (a server); port 0 takes a free one."""

    def __init__(self, connection: str, system_id: int, component_id: int) -> None:
        kind, _, rest = connection.partition(":")
        host, _, port = rest.rpartition(":")
        if kind not in ("udpout", "udpin", "tcp") or not host or not port.isdigit() or int(port) > 65535:
            raise DriverError(
                f"'{connection}' is no connection for a simulated autopilot; "
                "give udpout:HOST:PORT, udpin:HOST:PORT or tcp:HOST:PORT (a server)"
            )
        self.peers: list[Peer] = []
        self._ids = (system_id, component_id)
        self._by_address: dict[Any, Peer] = {}
        self._tcp = kind == "tcp"
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM if self._tcp else socket.SOCK_DGRAM)
        try:
            if self._tcp:
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            address = (socket.gethostbyname(host), int(port))
            if kind == "udpout":
                self._socket.bind(("", 0))
                self._peer(address)
            else:
                self._socket.bind(address)
            if self._tcp:
                self._socket.listen()
        except OSError as error:
            self._socket.close()
            raise DriverError(
                f"cannot open {connection}: {error.strerror or error}; is the port taken?"
            ) from error
        self._socket.setblocking(False)

    @property
    def port(self) -> int:
        """The local port."""
        return int(self._socket.getsockname()[1])

    def sockets(self) -> list[socket.socket]:
        """What to wait for."""
        return [self._socket, *(p.stream for p in self.peers if p.stream is not None)]

    def receive(self) -> list[tuple[Peer, bytes]]:
        """All bytes that are there, without waiting."""
        return self._receive_tcp() if self._tcp else self._receive_udp()

    def send(self, peer: Peer, data: bytes) -> None:
        """Bytes to a peer; one that is gone is forgotten (TCP) or ignored (UDP, where it may come back)."""
        try:
            if peer.stream is None:
                self._socket.sendto(data, peer.address)
            else:
                peer.unsent += data
                del peer.unsent[: peer.stream.send(peer.unsent)]
        except BlockingIOError:
            if len(peer.unsent) > MAX_UNSENT:
                self._drop(peer)
        except OSError:
            if peer.stream is not None:
                self._drop(peer)

    def close(self) -> None:
        """Close everything."""
        for peer in list(self.peers):
            self._drop(peer)
        self._socket.close()

    def _receive_udp(self) -> list[tuple[Peer, bytes]]:
        received: list[tuple[Peer, bytes]] = []
        while True:
            try:
                data, address = self._socket.recvfrom(RECEIVE_BYTES)
            except BlockingIOError:
                return received
            except ConnectionError:
                continue  # An earlier datagram met a closed port.
            received.append((self._by_address.get(address) or self._peer(address), data))

    def _receive_tcp(self) -> list[tuple[Peer, bytes]]:
        with contextlib.suppress(BlockingIOError):
            while True:
                stream, address = self._socket.accept()
                # A client that never reads must not hold up the flight.
                stream.setblocking(False)
                self._peer(address).stream = stream
        received: list[tuple[Peer, bytes]] = []
        for peer in list(self.peers):
            if peer.stream is None:
                continue
            try:
                data = peer.stream.recv(RECEIVE_BYTES)
            except BlockingIOError:
                continue
            except OSError:
                data = b""
            if data:
                received.append((peer, data))
            else:
                self._drop(peer)
        return received

    def _peer(self, address: Any) -> Peer:
        codec = mavlink.MAVLink(None, srcSystem=self._ids[0], srcComponent=self._ids[1])
        codec.robust_parsing = True
        peer = Peer(address, codec)
        self.peers.append(peer)
        self._by_address[address] = peer
        return peer

    def _drop(self, peer: Peer) -> None:
        peer.open = False
        if peer.stream is not None:
            peer.stream.close()
        self._by_address.pop(peer.address, None)
        self.peers.remove(peer)
