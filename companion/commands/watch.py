"""Show a vehicle's messages live in the terminal; as lines of JSON when the output goes into a pipe."""

import argparse
import json
import sys
import time
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from companion.commands.closed_pipe import discard_output
from companion.commands.watched_map import map_lines
from companion.live.publisher import endpoints
from companion.messages.ground import Ground
from companion.messages.messages import Decision, Estimate, Event, Health
from companion.messages.received import printable, received
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
MOST_VEHICLES = 100
COLOURS = {"fit": "bold white on green", "unfit": "bold white on red"}
UNKNOWN_COLOUR = "bold white on grey37"
WORDS = {"fit": "FIT FOR LANDING", "unfit": "NOT FIT", "unknown": "UNKNOWN"}
FORBIDDEN = "NO LANDING"
"""In place of a fit verdict beside which a standing condition forbids a landing."""


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
    parser.add_argument("--map", action="store_true", help="the ground map too, as characters and colours")


def run(args: argparse.Namespace) -> int:
    """Watch until interrupted."""
    overrides = [f"zenoh.connect={json.dumps(args.connect)}"] if args.connect else []
    overrides += [f"zenoh.listen={json.dumps(args.listen)}"] if args.listen else []
    if not (args.connect or args.listen or args.config):
        overrides.append("zenoh.scouting=true")  # somebody who says nothing looks around on the local network
    settings = load(args.config, [*overrides, *args.overrides]).settings
    topics = (*MESSAGE_TOPICS, "ground") if args.map else MESSAGE_TOPICS
    with Subscription(endpoints(settings.zenoh), args.vehicle, topics) as subscription:
        if args.json or not sys.stdout.isatty():
            return _lines(subscription)
        return _live(subscription)


def line_of(delivery: Delivery) -> str:
    """One line of JSON: the message with ``vehicle`` and ``topic`` in front, or a coming or going."""
    head: dict[str, Any] = {"vehicle": delivery.vehicle, "topic": delivery.topic}
    if delivery.alive is not None:
        return json.dumps(head | {"alive": delivery.alive})
    if received(delivery.topic, delivery.payload) is None:
        return json.dumps(head | {"refused": f"not a message as the schema of {delivery.topic} says"})
    body = msgspec.json.decode(delivery.payload, type=dict[str, Any])
    # The key says whose message it is, whatever stands in it.
    return json.dumps(head | body | head)


def _lines(subscription: Subscription) -> int:
    while True:
        delivery = subscription.receive(POLL_S)
        if delivery is not None:
            try:
                print(line_of(delivery), flush=True)
            except BrokenPipeError:
                discard_output()
                return 0


@dataclass(slots=True)
class Known:
    """What one vehicle said last."""

    heard_s: float
    changed_s: float
    alive: bool = False
    estimate: Estimate | None = None
    decision: Decision | None = None
    health: Health | None = None
    ground: Ground | None = None
    mapped: Ground | None = None
    """The newest that has a map."""
    events: deque[Event] = field(default_factory=lambda: deque(maxlen=EVENTS_SHOWN))
    refused: int = 0
    """Messages that do not follow the schema."""


class View:
    """What is known of each vehicle, as a table for the terminal. A vehicle is the one that the key names."""

    def __init__(self) -> None:
        self.vehicles: dict[str, Known] = {}

    def take(self, delivery: Delivery, now_s: float) -> None:
        """Keep the newest of every topic."""
        known = self.vehicles.get(delivery.vehicle)
        if known is None:
            if len(self.vehicles) >= MOST_VEHICLES:
                return
            known = self.vehicles.setdefault(delivery.vehicle, Known(now_s, now_s))
        if delivery.alive is not None:
            known.alive, known.changed_s = delivery.alive, now_s
            return
        message = received(delivery.topic, delivery.payload)
        known.refused += message is None
        match message:
            case Estimate():
                known.estimate = message
            case Decision():
                known.decision = message
            case Health():
                known.health = message
            case Ground():
                known.ground = message
                known.mapped = message if message.map is not None else known.mapped
            case Event():
                known.events.append(message)
            case _:
                return
        known.heard_s = now_s

    def table(self, now_s: float) -> "Table":
        """The present state."""
        from rich.table import Table
        from rich.text import Text

        outer = Table.grid()
        if not self.vehicles:
            outer.add_row(Text("waiting for a vehicle ...", style="dim"))
        for name, known in sorted(self.vehicles.items()):
            inner = Table.grid(padding=(0, 2))
            inner.add_row(Text(printable(name), style="bold"), self._presence(known, now_s))
            for label, text, style in _rows(known):
                inner.add_row(Text(label, style="dim"), Text(printable(text), style=style))
            outer.add_row(inner)
            if known.ground is not None and known.mapped is not None:
                for line in map_lines(known.ground, known.mapped):
                    outer.add_row(line)
        return outer

    def _presence(self, known: Known, now_s: float) -> Any:
        from rich.text import Text

        quiet_s = now_s - known.heard_s
        if not known.alive:
            return Text(f" SILENT: left the bus {now_s - known.changed_s:.0f} s ago ", "bold white on red")
        if quiet_s > SILENT_AFTER_S:
            return Text(f" SILENT: alive, but no message for {quiet_s:.0f} s ", "bold black on yellow")
        return Text("alive", "green")


def _rows(known: Known) -> "list[tuple[str, str, str]]":
    rows = []
    d, e, health = known.decision, known.estimate, known.health
    forbidding = [] if health is None else [c.text for c in health.conditions if c.forbids_landing]
    if d is not None:
        forbidden = d.verdict == "fit" and bool(forbidding)
        verdict = FORBIDDEN if forbidden else WORDS.get(d.verdict, d.verdict)
        colour = UNKNOWN_COLOUR if forbidden else COLOURS.get(d.verdict, UNKNOWN_COLOUR)
        against = [*forbidding, *(reason for reason in d.reasons if reason not in forbidding)]
        rows.append(("verdict", f" {verdict} ", colour))
        rows.append(("against landing", "; ".join(against) or "nothing", ""))
        rows.append(("permission", "; ".join(d.withheld) or "a request may go out", ""))
        rows.append(("command", d.command, ""))
    if e is not None and e.status == "ok":
        inclination = _figure(e.inclination_deg, 1, "degrees", e.inclination_std_deg)
        rows.append(("inclination", inclination, "bold"))
        rows.append(("roughness", _figure(e.roughness, 4, "of the distance", e.roughness_std), ""))
        rows.append(("time to contact", _figure(e.time_to_contact_s, 1, "s"), ""))
        flow = (_figure(value, 3, "") for value in (e.ventral_flow_x, e.ventral_flow_y))
        rows.append(("ventral flow", " / ".join(flow) + "  1/s", ""))
    elif e is not None:
        rows.append(("no estimate", e.status.replace("_", " "), "yellow"))
    if health is not None:
        well = health.state == "ok" and not health.problems
        problems = "all inputs well" if well else "; ".join(health.problems) or "no reason given"
        rows.append(("health", f"{health.state}: {problems}", "" if well else "yellow"))
    if known.ground is not None:
        below, stop = known.ground.below, known.ground.touchdown
        rows.append(("ground below", _ground(below.verdict, below.reasons), ""))
        rows.append(("on the way", _ground(stop.verdict, stop.reasons), ""))
    if known.refused:
        rows.append(("refused", f"{known.refused} messages that do not follow the schema", "yellow"))
    for event in known.events:
        style = {"error": "red", "warning": "yellow"}.get(event.severity, "")
        rows.append(("event", event.text or event.event, style))
    return rows


def _ground(verdict: str, reasons: tuple[str, ...]) -> str:
    return f"{verdict}: {', '.join(reasons).replace('_', ' ')}" if reasons else verdict


def _figure(value: float | None, digits: int, unit: str, std: float | None = None) -> str:
    if value is None:
        return "unknown"
    spread = "" if std is None else f" ± {std:.{digits}f}"
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
