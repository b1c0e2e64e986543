"""The service manager is spoken to over a real socket."""

import os
import socket
import time

import pytest

from drivers.system.service_manager import ServiceManager


@pytest.fixture
def manager_socket(tmp_path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / "notify"))
        listener.settimeout(5)
        yield listener


def heard(listener: socket.socket) -> list[str]:
    """All messages that wait."""
    listener.setblocking(False)
    messages = []
    while True:
        try:
            messages.append(listener.recv(4096).decode())
        except BlockingIOError:
            return messages


def test_messages_of_a_services_life(manager_socket):
    manager = ServiceManager({"NOTIFY_SOCKET": manager_socket.getsockname()})
    assert manager.present
    manager.ready()
    manager.status("link ok,\ncamera ok")
    manager.status("link ok, camera ok")
    manager.alive()
    manager.more_time(10)
    manager.stopping()
    manager.close()
    manager.ready()
    assert heard(manager_socket) == [
        "READY=1",
        "STATUS=link ok, camera ok",
        "EXTEND_TIMEOUT_USEC=10000000",
        "STOPPING=1",
    ]


def test_the_watchdog_is_fed_often_enough_and_no_oftener(manager_socket, monkeypatch):
    clock = {"s": 1000.0}
    monkeypatch.setattr(time, "monotonic", lambda: clock["s"])
    environment = {
        "NOTIFY_SOCKET": manager_socket.getsockname(),
        "WATCHDOG_USEC": "300000",
        "WATCHDOG_PID": str(os.getpid()),
    }
    manager = ServiceManager(environment)
    assert manager.watchdog_s == pytest.approx(0.3)
    for _ in range(90):
        manager.alive()
        clock["s"] += 0.005
    manager.close()
    pings = heard(manager_socket)
    assert set(pings) == {"WATCHDOG=1"}
    assert 3 <= len(pings) <= 6


def test_an_abstract_socket():
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        name = f"landslope-test-{os.getpid()}"
        listener.bind("\0" + name)
        manager = ServiceManager({"NOTIFY_SOCKET": "@" + name})
        manager.ready()
        manager.close()
        assert heard(listener) == ["READY=1"]


@pytest.mark.parametrize(
    "environment",
    [
        {},
        {"NOTIFY_SOCKET": "", "WATCHDOG_USEC": "1000000"},
        {"NOTIFY_SOCKET": "/nowhere/at/all"},
        {"NOTIFY_SOCKET": "vsock:2:1"},
    ],
)
def test_nobody_listening_changes_nothing(environment):
    manager = ServiceManager(environment)
    manager.ready()
    manager.alive()
    manager.status("x")
    manager.close()


@pytest.mark.parametrize("changes", [{"WATCHDOG_PID": "1"}, {"WATCHDOG_USEC": "soon"}, {"WATCHDOG_USEC": ""}])
def test_a_watchdog_of_another_process_is_not_fed(manager_socket, changes):
    environment = {"NOTIFY_SOCKET": manager_socket.getsockname(), "WATCHDOG_USEC": "1000000", **changes}
    manager = ServiceManager(environment)
    manager.alive()
    manager.close()
    assert manager.watchdog_s == 0
    assert heard(manager_socket) == []
