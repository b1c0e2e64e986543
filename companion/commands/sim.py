"""Fly a simulated drone over simulated ground, closed loop with the real daemon, and say what happened.

SCENARIO is the name of one that comes with landslope (--list) or a TOML file; without one, 'stairs' is flown. The exit
code is 0 when the flight ended as the scenario expects, 1 when it did not.
"""

import argparse
import json
import logging
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from companion.errors import LandslopeError
from drivers.system.pools import dask

DEFAULT = "stairs"
BAR_WIDTH = 30
REDRAW_S = 0.2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument("scenario", nargs="?", metavar="SCENARIO", help="name or file (default: stairs)")
    parser.add_argument("--list", action="store_true", help="the scenarios that come with landslope")
    parser.add_argument("--config", type=Path, metavar="FILE", help="landslope's settings for the flight")
    parser.add_argument(
        "--set", action="append", default=[], metavar="SECTION.KEY=VALUE", dest="overrides",
        help="override a setting of landslope",
    )  # fmt: skip
    parser.add_argument("--seed", type=int, metavar="N", help="another seed than the scenario's")
    flight = parser.add_argument_group("one flight")
    flight.add_argument("--speed", type=float, default=1.0, metavar="X", help="simulated over real time")
    flight.add_argument("--plot", type=Path, metavar="FILE.png", help="the flight in section")
    flight.add_argument("--record", type=Path, metavar="DIR", help="leave a flight folder with truth.csv")
    flight.add_argument(
        "--lockstep", action="store_true",
        help="without threads and sockets: the same flight every time, as fast as it computes",
    )  # fmt: skip
    flight.add_argument(
        "--autopilot", choices=("built-in", "ardupilot", "px4"), default="built-in",
        help="who flies; ardupilot: an ArduCopter SITL started with --model JSON:127.0.0.1; px4: a PX4 SITL with SIH",
    )  # fmt: skip
    flight.add_argument(
        "--connect", metavar="CONNECTION",
        help="the real autopilot's MAVLink (default: tcp:127.0.0.1:5760, PX4: udpin:127.0.0.1:14540)",
    )  # fmt: skip
    flight.add_argument(
        "--pilot", metavar="CONNECTION",
        help="its second MAVLink, for the scenario's pilot (default: tcp:127.0.0.1:5762, PX4: udpin:127.0.0.1:14550)",
    )  # fmt: skip
    flight.add_argument(
        "--physics-port", type=int, default=9002, metavar="PORT",
        help="UDP port at which the SITL's motor outputs arrive (default: 9002)",
    )  # fmt: skip
    flight.add_argument(
        "--watch", action="store_true", help="keep name and bus of the settings, for others to watch"
    )
    flight.add_argument("--verbose", action="store_true", help="log what the daemon logs")
    many = parser.add_argument_group("many flights")
    many.add_argument(
        "--runs", type=int, metavar="N", help="fly N random scenarios and count what went wrong"
    )
    many.add_argument(
        "--classes", metavar="NAMES",
        help="of which classes N flights each: names with commas, or 'all' (default: control)",
    )  # fmt: skip
    many.add_argument("--jobs", type=int, default=2, metavar="N", help="processes (default: 2)")
    many.add_argument(
        "--keep", type=Path, metavar="DIR", help="record the worst runs here, with their scenarios"
    )
    many.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="fly on the workers of this Dask scheduler (needs the extra 'scale')",
    )
    many.add_argument(
        "--table", type=Path, metavar="FOLDER.parquet",
        help="a row a flight, written as they end; taken up again where it was cut off",
    )  # fmt: skip
    many.add_argument("--report", type=Path, metavar="FILE.json", help="every run and the figures")


def run(args: argparse.Namespace) -> int:
    """Fly."""
    from companion.simulation.scenario import built_in, read_scenario

    if args.list:
        names = built_in()
        width = max(map(len, names))
        print("\n".join(f"{name:<{width}}  {text}" for name, text in names.items()))
        return 0
    if args.runs is not None:
        return _many(args)
    scenario = read_scenario(args.scenario or DEFAULT)
    if args.seed is not None:
        scenario = replace(scenario, basics=replace(scenario.basics, seed=args.seed))
    if not 0.05 <= args.speed <= 20:
        raise LandslopeError(f"--speed {args.speed:g} is outside its limits 0.05 to 20")
    logging.basicConfig(
        level=logging.INFO if args.verbose else logging.ERROR, format="%(levelname)s %(name)s: %(message)s"
    )
    with _bar(scenario.name) as progress:
        result = _fly(args, scenario, progress)
    from companion.simulation.flight_result import in_words

    print(in_words(result))
    wrong = result.deviations(scenario.expect)
    print("\n".join(f"  WRONG      {line}" for line in wrong) or "  as it should be")
    if args.plot is not None:
        from companion.simulation.picture import draw

        draw(result, scenario, args.plot)
        print(f"  picture    {args.plot}")
    return 1 if wrong else 0


def _fly(args: argparse.Namespace, scenario: Any, progress: Any) -> Any:
    if args.lockstep:
        from companion.simulation.lockstep import LockstepOptions, fly

        return fly(scenario, args.config, args.overrides, LockstepOptions(record=args.record), progress)
    from companion.simulation.simulation import ArduPilot, LiveOptions, Px4, fly_live

    autopilot: ArduPilot | Px4 | None = None
    reached = {name: value for name, value in (("connection", args.connect), ("pilot", args.pilot)) if value}
    if args.autopilot != "built-in" and args.speed != 1.0:
        raise LandslopeError(
            f"--speed is the autopilot's own with --autopilot {args.autopilot}: start ArduCopter with --speedup, "
            "PX4 with PX4_SIM_SPEED_FACTOR"
        )
    if args.autopilot == "ardupilot":
        if not 1 <= args.physics_port <= 65535:
            raise LandslopeError(f"--physics-port {args.physics_port} is outside its limits 1 to 65535")
        autopilot = ArduPilot(**reached, physics_port=args.physics_port)
    elif args.autopilot == "px4":
        autopilot = Px4(**reached)
    options = LiveOptions(args.speed, args.record, args.watch, autopilot)
    return fly_live(scenario, args.config, args.overrides, options, progress)


def _many(args: argparse.Namespace) -> int:
    from companion.simulation.classes import CLASSES, CONTROL, seeds_of
    from companion.simulation.monte_carlo import fly_many

    if not 1 <= args.runs <= 100_000 or not 1 <= args.jobs <= 10_000:
        raise LandslopeError("--runs must be from 1 to 100000 and --jobs from 1 to 10000")
    if args.dask is None and args.jobs > 64:
        raise LandslopeError(f"--jobs {args.jobs}: at most 64 processes of this machine; --dask takes more")
    first, table = args.seed or 0, None
    classes = list(CLASSES) if args.classes == "all" else (args.classes or CONTROL).split(",")
    try:
        seeds = seeds_of(classes, args.runs, first)
    except ValueError as error:
        raise LandslopeError(f"--classes: {error}") from None
    with ExitStack() as stack:
        progress = stack.enter_context(_bar(f"{len(seeds)} flights"))
        if args.table is not None:
            from companion.simulation.result_table import ResultTable

            table = stack.enter_context(ResultTable(args.table, args.config, args.overrides))
        report = fly_many(
            args.runs, first, args.jobs, args.config, args.overrides, args.keep, progress,
            on_run=table.add if table is not None else lambda run: None,
            flown=table.runs_before(seeds) if table is not None else (),
            pool=None if args.dask is None else dask(args.dask), classes=classes,
        )  # fmt: skip
    print(report.in_words())
    if args.report is not None:
        args.report.write_text(json.dumps(report.as_table(), indent=1), encoding="utf-8")
    return 1 if report.requested_on_unfit.count or report.crashes else 0


@contextmanager
def _bar(name: str) -> Iterator[Any]:
    """A progress bar on a terminal; silence in a pipe."""
    drawn = [0.0]

    def progress(done: float, total: float) -> None:
        now = time.monotonic()
        if not sys.stderr.isatty() or now - drawn[0] < REDRAW_S:
            return
        drawn[0] = now
        share = min(done / total, 1.0) if total else 0.0
        filled = round(BAR_WIDTH * share)
        bar = "#" * filled + "." * (BAR_WIDTH - filled)
        print(f"\r{name} [{bar}] {done:.0f} of {total:.0f}", end="", file=sys.stderr, flush=True)

    yield progress
    if drawn[0]:
        print("\r\033[K", end="", file=sys.stderr, flush=True)
