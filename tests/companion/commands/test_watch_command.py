"""``landslope watch``: what the terminal shows, and what a pipe gets."""

import json
import os
import pty
import re
import select
import signal
import subprocess
import sys
import time

import pytest
from bus_support import PATIENCE_S, Watcher, alive, free_endpoint
from rich.console import Console

from companion.commands.watch import SILENT_AFTER_S, View, line_of
from drivers.bus import Bus, Delivery, Endpoints

DECISION = {
    "verdict": "unfit",
    "reasons": ["too steep: 23.0 degrees, limit 10.0"],
    "withheld": [],
    "command": "none",
}
ESTIMATE = {
    "status": "ok",
    "inclination_deg": 23.04,
    "inclination_std_deg": 0.31,
    "roughness": 0.0123,
    "time_to_contact_s": None,
    "ventral_flow_x": 0.1,
    "ventral_flow_y": -0.2,
}


def shown(view: View, now_s: float) -> str:
    console = Console(width=120, force_terminal=False)
    with console.capture() as capture:
        console.print(view.table(now_s))
    return capture.get()


def delivery(topic: str, message: dict) -> Delivery:
    return Delivery("kestrel", topic, json.dumps(message).encode())


def test_the_view_shows_what_was_said_and_says_when_the_vehicle_falls_silent():
    view = View()
    assert "waiting" in shown(view, 0.0)
    view.take(Delivery("kestrel", "alive", alive=True), 0.0)
    view.take(delivery("decision", DECISION), 0.0)
    view.take(delivery("estimate", ESTIMATE), 0.1)
    view.take(delivery("event", {"event": "x", "text": "attitude late", "severity": "warning"}), 0.2)
    view.take(delivery("health", {"state": "degraded", "problems": ["gyro: none came"]}), 0.2)
    text = shown(view, 0.3)
    for words in ("kestrel", "alive", "NOT FIT", "too steep: 23.0", "23.0 ± 0.3 degrees", "attitude late"):
        assert words in text
    assert "degraded: gyro: none came" in text
    assert re.search(r"time to contact +unknown", text)
    assert "SILENT" in shown(view, 0.2 + SILENT_AFTER_S + 0.1)
    view.take(Delivery("kestrel", "alive", alive=False), 1.0)
    assert "SILENT: left the bus" in shown(view, 1.1)
    view.take(Delivery("kestrel", "alive", alive=True), 2.0)
    view.take(delivery("estimate", {"status": "motion_too_small"}), 2.0)
    assert "motion too small" in shown(view, 2.1)
    assert "SILENT" not in shown(view, 2.1)


def test_what_is_no_message_is_neither_shown_nor_fatal():
    view = View()
    for payload in (b"", b"[1]", b"\xff", b"{"):
        view.take(Delivery("kestrel", "estimate", payload), 0.0)
        assert json.loads(line_of(Delivery("kestrel", "estimate", payload)))["refused"]
    assert "kestrel" in shown(view, 0.0)


def test_a_pipe_gets_lines_of_json_and_comings_and_goings():
    endpoint = free_endpoint()
    with Watcher("--listen", endpoint) as watcher:
        with Bus("kestrel", Endpoints(connect=(endpoint,))) as bus:
            watcher.until(alive(True))
            while not bus.subscribed("event"):
                time.sleep(0.01)
            bus.put("event", b'{"event": "x", "frame": 3}')
            watcher.until(
                lambda seen: {"vehicle": "kestrel", "topic": "event", "event": "x", "frame": 3} in seen
            )
        watcher.until(alive(False))


def test_one_vehicle_can_be_chosen():
    endpoint = free_endpoint()
    with (
        Watcher("--listen", endpoint, "--vehicle", "two") as watcher,
        Bus("one", Endpoints(connect=(endpoint,))) as one,
        Bus("two", Endpoints(connect=(endpoint,))) as two,
    ):
        watcher.until(alive(True))
        while not two.subscribed("event"):
            time.sleep(0.01)
        one.put("event", b'{"n": 1}')
        two.put("event", b'{"n": 2}')
        watcher.until(lambda seen: any(m.get("n") == 2 for m in seen))
        assert {m["vehicle"] for m in watcher.seen} == {"two"}


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_pipe_that_is_closed_ends_the_watcher_quietly(unbuffered: str):
    """Also when Python keeps what could not be written for its next flush, as it does unless told otherwise."""
    endpoint = free_endpoint()
    process = subprocess.Popen(
        [sys.executable, "-m", "companion.cli", "watch", "--listen", endpoint],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
    )
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    with Bus("kestrel", Endpoints(connect=(endpoint,))):
        assert process.wait(PATIENCE_S) == 0
    assert process.stderr.read() == b""


def test_a_terminal_gets_the_live_view():
    endpoint = free_endpoint()
    master, slave = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "companion.cli", "watch", "--listen", endpoint],
        stdout=slave,
        stderr=slave,
        env=os.environ | {"TERM": "xterm-256color", "COLUMNS": "120", "LINES": "40"},
    )
    os.close(slave)
    seen = ""
    try:
        with Bus("kestrel", Endpoints(connect=(endpoint,))) as bus:
            end = time.monotonic() + PATIENCE_S
            while "NOT FIT" not in seen:
                assert time.monotonic() < end, seen[-2000:]
                bus.put("decision", json.dumps(DECISION).encode())
                if select.select([master], [], [], 0.1)[0]:
                    seen += os.read(master, 65536).decode(errors="replace")
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) in (0, 130)
        assert "Traceback" not in seen
    finally:
        process.kill()
        process.wait()
        os.close(master)
