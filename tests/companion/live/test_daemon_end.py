"""The daemon's start and end as a process, while everything around it is silent."""

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from daemon_support import PATIENCE_S, wait_for
from ports import free_tcp_port, free_udp_port


@pytest.mark.parametrize("mode", ["peer", "client"])
def test_it_starts_and_ends_although_camera_and_router_hang(tmp_path: Path, mode: str) -> None:
    """Both accept the connection and then say nothing; the log says why there is no autopilot."""
    with socket.socket() as hanging:
        hanging.bind(("127.0.0.1", 0))
        hanging.listen(8)
        port = hanging.getsockname()[1]
        settings = (
            f"camera.source=http://127.0.0.1:{port}/stream",
            f"mavlink.connection=tcp:127.0.0.1:{free_tcp_port()}",
            f"vehicle.name=hang{port}",
            f"zenoh.mode={mode}",
            f"zenoh.connect=tcp/127.0.0.1:{port}",
        )
        code, log = started_and_ended(tmp_path, settings, ("link_closed",))
    assert code == 0, log
    assert "Traceback" not in log


def test_it_starts_and_ends_with_nobody_there(tmp_path: Path) -> None:
    settings = (
        f"camera.source=http://127.0.0.1:{free_tcp_port()}/stream",
        f"mavlink.connection=udpin:127.0.0.1:{free_udp_port()}",
        f"vehicle.name=alone{free_tcp_port()}",
        "zenoh.mode=client",
        f"zenoh.connect=tcp/127.0.0.1:{free_tcp_port()}",
    )
    code, log = started_and_ended(tmp_path, settings, ("camera_lost", "zenoh: no session"))
    assert code == 0, log
    assert log.count("camera_lost") == log.count("zenoh: no session") == 1, (
        "reported once, not with every attempt"
    )
    assert "Traceback" not in log


def started_and_ended(
    tmp_path: Path, settings: tuple[str, ...], words: tuple[str, ...] = ()
) -> tuple[int, str]:
    """Run the daemon until it runs and has written the words, then end it; exit code, log.

    How long the end takes is measured by ``landslope benchmark --daemon``.
    """
    arguments = [a for s in settings for a in ("--set", s)]
    path = tmp_path / "log"
    with path.open("wb") as log:
        daemon = subprocess.Popen(
            [sys.executable, "-m", "companion.cli", "run", *arguments],
            stderr=log,
            env=os.environ | {"XDG_RUNTIME_DIR": str(tmp_path)},
        )
    try:
        for word in ("landslope runs", *words):
            wait_for(lambda word=word: word in path.read_text(), f"'{word}' in the log")
        if words:
            time.sleep(1.0)  # for more attempts, none of which is to be reported again
        daemon.send_signal(signal.SIGTERM)
        code = daemon.wait(PATIENCE_S)
        return code, path.read_text()
    finally:
        daemon.kill()
        daemon.wait()
