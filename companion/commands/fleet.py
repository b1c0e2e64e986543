"""A fleet under one zenoh router: measure it, serve it, write its access control."""

import argparse
import signal
import threading
from pathlib import Path

from companion.errors import LandslopeError
from companion.fleet import fleet, fleet_router
from companion.settings.limits import within_limits
from drivers.bus import Endpoints, open_session

CERTIFICATES = "/etc/landslope/pki"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    measure = actions.add_parser("measure", help="publish from simulated vehicles, print losses and latency")
    defaults = fleet.FleetOptions()
    measure.add_argument("--vehicles", type=int, default=defaults.vehicles)
    measure.add_argument("--rate", type=float, default=defaults.rate_hz, dest="rate_hz", metavar="HZ")
    measure.add_argument("--seconds", type=float, default=defaults.duration_s, dest="duration_s")
    measure.add_argument(
        "--router", default="", help="endpoint of a running router; one is started if left out"
    )
    serve = actions.add_parser("serve", help="run a router where there is no zenohd")
    serve.add_argument("--listen", default="", help="as tcp/0.0.0.0:7447; may stand in --config instead")
    serve.add_argument("--config", default="", help="zenoh configuration (JSON5): TLS, access control")
    router = actions.add_parser("router", help="print a router's configuration with TLS and access control")
    router.add_argument(
        "--vehicle", action="append", default=[], help="common name of a vehicle's certificate"
    )
    router.add_argument(
        "--watcher", action="append", default=[], help="common name of a watcher's certificate"
    )
    router.add_argument("--listen", default="tls/0.0.0.0:7447")
    router.add_argument(
        "--certificates", default=CERTIFICATES, help="folder of ca.pem, router.pem, router.key"
    )
    client = actions.add_parser("client", help="print a vehicle's or watcher's zenoh configuration")
    client.add_argument("name", help="common name of its certificate, and name of its files")
    client.add_argument(
        "--connect", required=True, help="as tls/router.example:7447; the name must be the router's"
    )
    client.add_argument("--certificates", default=CERTIFICATES, help="folder of ca.pem, NAME.pem, NAME.key")


def run(args: argparse.Namespace) -> int:
    """Do what was asked for."""
    match args.action:
        case "measure":
            options = within_limits(fleet.FleetOptions(args.vehicles, args.rate_hz, args.duration_s))
            report = fleet.measure(options, args.router)
            print("\n".join(report.lines()))
            return 0 if report.vehicles_heard == report.vehicles else 1
        case "serve":
            _serve(Endpoints(mode="router", listen=_listen(args), config_file=args.config))
        case "router":
            config = fleet_router.router_config(args.vehicle, args.watcher, args.listen, args.certificates)
            print(fleet_router.as_json5(config), end="")
        case "client":
            config = fleet_router.client_config(args.name, args.connect, args.certificates)
            print(fleet_router.as_json5(config, head="// Made by 'landslope fleet client'.\n"), end="")
    return 0


def _listen(args: argparse.Namespace) -> tuple[str, ...]:
    if not args.listen and not args.config:
        raise LandslopeError("a router needs --listen or a --config that says where to listen")
    if args.config and not Path(args.config).is_file():
        raise LandslopeError(f"{args.config}: there is no such file (--config)")
    return (args.listen,) if args.listen else ()


def _serve(endpoints: Endpoints) -> None:
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    session = open_session(endpoints)
    print(f"router {session.info.zid()} is up; Ctrl-C ends it", flush=True)
    stop.wait()
    session.close()
