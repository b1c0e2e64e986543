"""Show a vehicle's messages live in the terminal; as lines of JSON when the output goes into a pipe."""

import argparse
import json
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from companion.commands.closed_pipe import discard_output
from companion.live.publisher import endpoints
from companion.settings.settings_file import load
from drivers.bus import Delivery, Subscription

if TYPE_CHECKING:
    from rich.table import Table

POLL_S = 0.1
REFRESH_HZ = 8
SILENT_AFTER_S = 2.0
"""A vehicle whose token is there but whose messages stop for this long is shown as silent."""

EVENTS_SHOWN = 6
MESSAGE_TOPICS = ("estimate", "decision", "health", "event")
COLOURS = {"fit": "bold white on green", "unfit": "bold white on red", "unknown": "bold white on grey37"}
WORDS = {"fit": "FIT FOR LANDING", "unfit": "NOT FIT", "unknown": "UNKNOWN"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument("--vehicle", default="*", metavar="NAME", help="the vehicle to watch (default: all)")
    parser.add_argument(
        "--connect",
        action="append",
        default=[],
        metavar="ENDPOINT",
        help='zenoh endpoint, as "tcp/10.0.0.5:7447"',
    )
    parser.add_argument(
        "--listen",
        action="append",
        default=[],
        metavar="ENDPOINT",
        help='wait for the vehicle at "tcp/0.0.0.0:7447"',
    )
    parser.add_argument(
        "--config", type=Path, metavar="FILE", help="settings file; its [zenoh] section is taken"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="SECTION.KEY=VALUE",
        dest="overrides",
        help="override a setting",
    )
    parser.add_argument("--json", action="store_true", help="lines of JSON on a terminal too")


def run(args: argparse.Namespace) -> int:
    """Watch until interrupted."""
    overrides = [f"zenoh.connect={json.dumps(args.connect)}"] if args.connect else []
    overrides += [f"zenoh.listen={json.dumps(args.listen)}"] if args.listen else []
    if not (args.connect or args.listen or args.config):
        overrides.append("zenoh.scouting=true")  # somebody who says nothing looks around on the local network
    settings = load(args.config, [*overrides, *args.overrides]).settings
    with Subscription(endpoints(settings.zenoh), args.vehicle, MESSAGE_TOPICS) as subscription:
        if args.json or not sys.stdout.isatty():
            return _lines(subscription)
        return _live(subscription)


def line_of(delivery: Delivery) -> str:
    """One line of JSON: the message with ``vehicle`` and ``topic`` in front, or a coming or going."""
    head: dict[str, Any] = {"vehicle": delivery.vehicle, "topic": delivery.topic}
    if delivery.alive is not None:
        return json.dumps(head | {"alive": delivery.alive})
    try:
        body = msgspec.json.decode(delivery.payload, type=dict[str, Any])
    except msgspec.DecodeError:
        body = {"refused": "not a JSON object"}
    return json.dumps(head | body)


def _lines(subscription: Subscription) -> int:
    while True:
        delivery = subscription.receive(POLL_S)
        if delivery is not None:
            try:
                print(line_of(delivery), flush=True)
            except BrokenPipeError:
                discard_output()
                return 0


class View:
    """What is known of each vehicle, as a table for the terminal."""

    def __init__(self) -> None:
        self.vehicles: dict[str, dict[str, Any]] = {}

    def take(self, delivery: Delivery, now_s: float) -> None:
        """Keep the newest of every topic."""
        state = self.vehicles.setdefault(delivery.vehicle, {"alive": False, "events": [], "heard_s": now_s})
        if delivery.alive is not None:
            state["alive"] = delivery.alive
            state["changed_s"] = now_s
            return
        try:
            message = msgspec.json.decode(delivery.payload, type=dict[str, Any])
        except msgspec.DecodeError:
            return
        state["heard_s"] = now_s
        if delivery.topic == "event":
            state["events"] = [*state["events"], message][-EVENTS_SHOWN:]
        else:
            state[delivery.topic] = message

    def table(self, now_s: float) -> "Table":
        """The present state."""
        from rich.table import Table
        from rich.text import Text

        outer = Table.grid(padding=(0, 0, 1, 0))
        if not self.vehicles:
            outer.add_row(Text("waiting for a vehicle ...", style="dim"))
        for name, state in sorted(self.vehicles.items()):
            inner = Table.grid(padding=(0, 2))
            inner.add_row(Text(name, style="bold"), self._presence(state, now_s))
            for label, text, style in _rows(state):
                inner.add_row(Text(label, style="dim"), Text(text, style=style))
            outer.add_row(inner)
        return outer

    def _presence(self, state: dict[str, Any], now_s: float) -> Any:
        from rich.text import Text

        quiet_s = now_s - state["heard_s"]
        if not state["alive"]:
            return Text(
                f" SILENT: left the bus {now_s - state.get('changed_s', now_s):.0f} s ago ",
                "bold white on red",
            )
        if quiet_s > SILENT_AFTER_S:
            return Text(f" SILENT: alive, but no message for {quiet_s:.0f} s ", "bold black on yellow")
        return Text("alive", "green")


def _rows(state: dict[str, Any]) -> "list[tuple[str, str, str]]":
    rows = []
    decision, estimate, health = (state.get(topic, {}) for topic in ("decision", "estimate", "health"))
    if decision:
        verdict = str(decision.get("verdict"))
        rows.append(("verdict", f" {WORDS.get(verdict, verdict)} ", COLOURS.get(verdict, "")))
        rows.append(("against landing", "; ".join(decision.get("reasons") or ["nothing"]), ""))
        rows.append(("permission", "; ".join(decision.get("withheld") or ["a request may go out"]), ""))
        rows.append(("command", str(decision.get("command")), ""))
    if estimate.get("status") == "ok":
        rows.append(
            ("inclination", _figure(estimate, "inclination_deg", 1, "degrees", "inclination_std_deg"), "bold")
        )
        rows.append(("roughness", _figure(estimate, "roughness", 4, "of the distance", "roughness_std"), ""))
        rows.append(("time to contact", _figure(estimate, "time_to_contact_s", 1, "s"), ""))
        flow = (_figure(estimate, name, 3, "") for name in ("ventral_flow_x", "ventral_flow_y"))
        rows.append(("ventral flow", " / ".join(flow) + "  1/s", ""))
    elif estimate:
        rows.append(("no estimate", str(estimate.get("status")).replace("_", " "), "yellow"))
    if health:
        problems = "; ".join(health.get("problems") or []) or "all inputs well"
        rows.append(
            ("health", f"{health.get('state')}: {problems}", "" if health.get("state") == "ok" else "yellow")
        )
    for event in state["events"]:
        style = {"error": "red", "warning": "yellow"}.get(str(event.get("severity")), "")
        rows.append(("event", str(event.get("text") or event.get("event")), style))
    return rows


def _figure(message: dict[str, Any], name: str, digits: int, unit: str, std: str = "") -> str:
    value = message.get(name)
    if value is None:
        return "unknown"
    spread = f" ± {message[std]:.{digits}f}" if std and message.get(std) is not None else ""
    return f"{value:.{digits}f}{spread} {unit}".rstrip()


def _live(subscription: Subscription) -> int:
    from rich.live import Live

    view = View()
    with Live(view.table(time.monotonic()), refresh_per_second=REFRESH_HZ, screen=True) as live:
        shown_s = 0.0
        while True:
            delivery = subscription.receive(POLL_S)
            now_s = time.monotonic()
            if delivery is not None:
                view.take(delivery, now_s)
            if now_s - shown_s >= 1 / REFRESH_HZ:
                live.update(view.table(now_s))
                shown_s = now_s
