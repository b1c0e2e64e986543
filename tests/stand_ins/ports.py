"""Ports of the loopback device for tests: none that the system gives to a client, none that another worker takes.

A port that the system itself finds free (bind to 0) may belong to somebody else a moment later: to the other end of
any connection, in this process or in another worker's.
"""

import itertools
import os
import random
import socket

_FIRST, _A_WORKER, _WORKERS = 20_000, 1_000, 12
"""Below the system's own range (32,768 and up); each worker of the test run has its own thousand."""


def _all() -> "itertools.cycle[int]":
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")) % _WORKERS
    mine = list(range(_FIRST + worker * _A_WORKER, _FIRST + (worker + 1) * _A_WORKER))
    turn = random.SystemRandom().randrange(len(mine))
    return itertools.cycle(mine[turn:] + mine[:turn])


_ports = _all()


def _free(port: int, kind: socket.SocketKind) -> bool:
    with socket.socket(socket.AF_INET, kind) as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


def free_tcp_port() -> int:
    """A TCP port that nobody listens on."""
    return next(port for port in _ports if _free(port, socket.SOCK_STREAM))


def free_udp_port() -> int:
    """A UDP port that nobody listens on."""
    return next(port for port in _ports if _free(port, socket.SOCK_DGRAM))


def free_endpoint() -> str:
    """A zenoh endpoint that nobody listens on."""
    return f"tcp/127.0.0.1:{free_tcp_port()}"
