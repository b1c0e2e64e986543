"""One router, one monitor and one browser for the tests of a module."""

from collections.abc import Iterator

import pytest
import zenoh
from monitor_support import Browser, Monitor, Vehicle
from ports import free_endpoint, free_tcp_port

from drivers.bus import Endpoints, open_session


class Net:
    """A router that can go away and come back at the same endpoint."""

    def __init__(self) -> None:
        self.endpoint = free_endpoint()
        self.router: zenoh.Session = self._open()

    def _open(self) -> zenoh.Session:
        return open_session(Endpoints(mode="router", listen=(self.endpoint,)))

    def go(self) -> None:
        self.router.close()

    def come_back(self) -> None:
        self.router = self._open()


@pytest.fixture(scope="module")
def net() -> Iterator[Net]:
    found = Net()
    yield found
    found.go()


@pytest.fixture(scope="module")
def monitor(net: Net) -> Iterator[Monitor]:
    found = Monitor(free_tcp_port(), "--connect", net.endpoint, "--silent-after", "2")
    yield found
    found.close()


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    found = Browser(tmp_path_factory.mktemp("chromium"))
    yield found
    found.close()


@pytest.fixture
def vehicle(net: Net, request: pytest.FixtureRequest) -> Iterator[Vehicle]:
    found = Vehicle(f"v-{request.node.name[:24]}", net.endpoint)
    yield found
    found.close()
