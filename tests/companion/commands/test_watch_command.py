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
from bus_support import PATIENCE_S, Watcher, alive
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from ports import free_endpoint
from rich.console import Console

from companion.commands.watch import SILENT_AFTER_S, View, line_of
from companion.messages.conditions import Code, Condition, condition, state_of
from companion.messages.messages import Health, encode, estimate_message
from drivers.bus import Bus, Delivery, Endpoints
from landing.estimate import SurfaceEstimate

DECISION = {
    "frame": 1,
    "time_unix_us": 1,
    "verdict": "unfit",
    "reasons": ["too steep: 23.0 degrees, limit 10.0"],
    "since_unix_us": 1,
    "permitted": False,
    "withheld": [],
    "requested": False,
    "command": "none",
}
ESTIMATE = json.loads(encode(estimate_message(SurfaceEstimate(1, 0.0, "ok", "map"), 1, None, True))) | {
    "inclination_deg": 23.04,
    "inclination_std_deg": 0.31,
    "roughness": 0.0123,
    "ventral_flow_x": 0.1,
    "ventral_flow_y": -0.2,
}
EVENT = {"event": "x", "frame": None, "time_unix_us": 1, "severity": "warning", "text": "attitude late"}


def health(*conditions: Condition) -> dict:
    """Health with these conditions, as a vehicle publishes it."""
    message = Health(
        time_unix_us=1,
        state=state_of(conditions),
        problems=tuple(c.text for c in conditions),
        inputs={},
        counters={},
        clock_offset_s=None,
        clock_std_s=None,
        camera_late_s=None,
        camera_late_std_s=None,
        pipeline_ms=None,
        conditions=conditions,
    )
    return json.loads(encode(message))


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
    view.take(delivery("event", EVENT), 0.2)
    view.take(delivery("health", health(condition(Code.INPUT_MISSING, "gyro"))), 0.2)
    text = shown(view, 0.3)
    for words in ("kestrel", "alive", "NOT FIT", "too steep: 23.0", "23.0 ± 0.3 degrees", "attitude late"):
        assert words in text
    assert "degraded: gyro: none came" in text
    assert re.search(r"time to contact +unknown", text)
    assert "SILENT" in shown(view, 0.2 + SILENT_AFTER_S + 0.1)
    view.take(Delivery("kestrel", "alive", alive=False), 1.0)
    assert "SILENT: left the bus" in shown(view, 1.1)
    view.take(Delivery("kestrel", "alive", alive=True), 2.0)
    view.take(delivery("estimate", ESTIMATE | {"status": "motion_too_small"}), 2.0)
    assert "motion too small" in shown(view, 2.1)
    assert "SILENT" not in shown(view, 2.1)


def test_what_is_no_message_is_neither_shown_nor_fatal():
    view = View()
    for payload in (b"", b"[1]", b"\xff", b"{"):
        view.take(Delivery("kestrel", "estimate", payload), 0.0)
        assert json.loads(line_of(Delivery("kestrel", "estimate", payload)))["refused"]
    assert "kestrel" in shown(view, 0.0)


def test_a_forged_message_is_refused_counted_and_kills_nothing():
    """Text where a number belongs, numbers that no type holds, lists for texts, endless nesting, no UTF-8."""
    view = View()
    view.take(delivery("estimate", ESTIMATE), 0.0)
    forged = [
        ("estimate", json.dumps(ESTIMATE | {"inclination_deg": "steep"}).encode()),
        ("estimate", json.dumps(ESTIMATE | {"frame": 10**400}).encode()),
        ("estimate", json.dumps(ESTIMATE | {"time_unix_us": -5}).encode()),
        ("decision", json.dumps(DECISION | {"reasons": 7}).encode()),
        ("health", json.dumps(health() | {"problems": {"a": 1}}).encode()),
        ("event", json.dumps(EVENT | {"text": ["a", "b"]}).encode()),
        ("event", b'{"details": ' + b"[" * 100_000),
        ("event", b'{"text": "\xff"}'),
        ("estimate", b" " * 3_000_000),
    ]
    for topic, payload in forged:
        view.take(Delivery("kestrel", topic, payload), 0.1)
        assert "refused" in json.loads(line_of(Delivery("kestrel", topic, payload))), payload[:60]
    text = shown(view, 0.2)
    assert "23.0 ± 0.3 degrees" in text
    assert f"{len(forged)} messages that do not follow the schema" in text


@examples(200)
@given(text=st.text(), name=st.text(min_size=1))
def test_no_text_of_a_vehicle_reaches_the_terminal_as_a_control_sequence(text, name):
    view = View()
    view.take(Delivery(name, "event", json.dumps(EVENT | {"text": text}).encode()), 0.0)
    view.take(Delivery(name, "decision", json.dumps(DECISION | {"withheld": [text]}).encode()), 0.0)
    console = Console(width=200, force_terminal=False)
    with console.capture() as capture:
        console.print(view.table(0.0))
    assert all(character.isprintable() or character == "\n" for character in capture.get())


def test_escape_sequences_are_shown_as_what_they_are_not():
    view = View()
    view.take(delivery("event", EVENT | {"text": "\x1b[2J\x1b]0;owned\x07all well\u202e"}), 0.0)
    text = shown(view, 0.0)
    assert "\x1b" not in text
    assert "\x07" not in text
    assert "\u202e" not in text


def test_the_key_names_the_vehicle_whatever_the_body_says():
    forged = delivery("event", EVENT | {"vehicle": "another", "topic": "decision"})
    line = json.loads(line_of(forged))
    assert line["vehicle"] == "kestrel"
    assert line["topic"] == "event"


def test_a_condition_that_forbids_landing_is_shown_in_place_of_a_fit_verdict():
    view = View()
    view.take(delivery("decision", DECISION | {"verdict": "fit", "reasons": []}), 0.0)
    assert "FIT FOR LANDING" in shown(view, 0.0)
    view.take(delivery("health", health(condition(Code.TWO_VEHICLES))), 0.0)
    text = shown(view, 0.0)
    assert "FIT FOR LANDING" not in text
    assert "NO LANDING" in text
    assert "two vehicles on the link" in text
    view.take(delivery("health", health(condition(Code.RECORDING_STOPPED, detail="disk full"))), 0.0)
    text = shown(view, 0.0)
    assert "FIT FOR LANDING" in text
    assert "not recording: disk full" in text
    assert "all inputs well" not in text


def test_a_pipe_gets_lines_of_json_and_comings_and_goings():
    endpoint = free_endpoint()
    with Watcher("--listen", endpoint) as watcher:
        with Bus("kestrel", Endpoints(connect=(endpoint,))) as bus:
            watcher.until(alive(True))
            while not bus.subscribed("event"):
                time.sleep(0.01)
            bus.put("event", json.dumps(EVENT).encode())
            watcher.until(lambda seen: {"vehicle": "kestrel", "topic": "event", **EVENT} in seen)
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
        one.put("event", json.dumps(EVENT | {"frame": 1}).encode())
        two.put("event", json.dumps(EVENT | {"frame": 2}).encode())
        watcher.until(lambda seen: any(m.get("frame") == 2 for m in seen))
        assert {m["vehicle"] for m in watcher.seen} == {"two"}


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_pipe_that_is_closed_ends_the_watcher_quietly(unbuffered: str):
    """Also when Python keeps what could not be written for its next flush, as it does unless configured otherwise."""
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
