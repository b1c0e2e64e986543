"""Ctrl-C, an error or the death of the parent ends the workers of a long command, at once and without a trace."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from places import REPOSITORY

from drivers.system.workers import worker_pool

PATIENCE_S = 300.0
"""For everything that must come; the workers would otherwise sleep for much longer."""
SLEEP_S = 600
FLIGHTS = [str(REPOSITORY / "sitl_logs" / name) for name in ("stairs_a", "rubble_a")]


def session_of(leader: int) -> list[int]:
    """The processes of a session that still live."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            try:
                state = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(state[3]) == leader and state[0] != "Z":
                found.append(int(entry.name))
    return found


def eventually(condition: Callable[[], object]) -> bool:
    until = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > until:
            return False
        time.sleep(0.05)
    return True


@pytest.mark.parametrize(
    "words",
    [
        ("replay", *FLIGHTS),
        ("sim", "--runs", "4", "--jobs", "2"),
        ("experiments", "--quick", "--jobs", "2", "--out", "OUT"),
    ],
    ids=["replay", "sim", "experiments"],
)
def test_ctrl_c_ends_a_long_command_and_leaves_no_worker(tmp_path, words):
    words = [str(tmp_path) if word == "OUT" else word for word in words]
    process = subprocess.Popen(
        [sys.executable, "-m", "companion.cli", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(REPOSITORY)},
    )
    try:
        assert eventually(lambda: len(session_of(process.pid)) >= 4), process.communicate()[0]
        time.sleep(0.5)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        said, _ = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 130
        assert "Traceback" not in said, said
        assert eventually(lambda: not session_of(process.pid)), session_of(process.pid)
    finally:
        for left in session_of(process.pid):
            os.kill(left, signal.SIGKILL)
        process.wait()


def failing() -> None:
    with worker_pool(1) as pool:
        pool.submit(time.sleep, SLEEP_S)
        time.sleep(0.3)
        raise ZeroDivisionError


def test_an_error_ends_the_workers_without_waiting_for_them():
    started = time.monotonic()
    with pytest.raises(ZeroDivisionError):
        failing()
    assert time.monotonic() - started < SLEEP_S


PARENT = """
import time
from drivers.system.workers import worker_pool
if __name__ == "__main__":
    with worker_pool(1) as pool:
        print(pool.submit(__import__("os").getpid).result(), flush=True)
        pool.submit(time.sleep, 600)
        time.sleep(600)
"""


def test_workers_die_with_a_parent_that_is_killed(tmp_path):
    (tmp_path / "parent.py").write_text(PARENT)
    process = subprocess.Popen(
        [sys.executable, str(tmp_path / "parent.py")],
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env=os.environ | {"PYTHONPATH": str(REPOSITORY)},
    )
    assert process.stdout is not None
    worker = int(process.stdout.readline())
    process.kill()
    process.wait()
    assert eventually(lambda: worker not in session_of(process.pid))
