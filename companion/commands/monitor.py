"""Watch vehicles on a live web page (needs the extra 'monitor'), or serve them to the Foxglove app ('record')."""

import argparse
import importlib.util
import socket
from pathlib import Path

from companion.errors import LandslopeError
from companion.monitor.options import SHORTEST_TOKEN, MonitorOptions, is_loopback
from companion.settings.limits import within_limits
from drivers.bus import Endpoints


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    bus = parser.add_argument_group("where the vehicles are")
    bus.add_argument(
        "--connect", action="append", default=[], metavar="ENDPOINT", help="as tcp/192.168.1.10:7447"
    )
    bus.add_argument("--listen", action="append", default=[], metavar="ENDPOINT", help="as tcp/0.0.0.0:7447")
    bus.add_argument(
        "--scouting", action="store_true", help="find vehicles in the local network by multicast"
    )
    bus.add_argument(
        "--zenoh-config", default="", metavar="FILE", help="zenoh configuration (JSON5), as for TLS"
    )
    bus.add_argument("--vehicle", default="*", metavar="NAME", help="watch this one only")
    page = parser.add_argument_group("the page")
    page.add_argument(
        "--host", default="127.0.0.1", help="address to serve on; beyond loopback a token is needed"
    )
    page.add_argument("--port", type=int, help="default 8642; with --foxglove 8765")
    page.add_argument(
        "--token-file", metavar="FILE", help="file whose first line is the token asked of browsers"
    )
    page.add_argument("--certificate", metavar="FILE", help="PEM certificate: serve https")
    page.add_argument("--key", metavar="FILE", help="its private key")
    defaults = MonitorOptions()
    page.add_argument("--silent-after", type=float, default=defaults.silent_after_s, metavar="S")
    page.add_argument("--refresh", type=float, default=defaults.refresh_hz, metavar="HZ")
    parser.add_argument("--foxglove", action="store_true", help="serve the Foxglove app instead of a page")


def run(args: argparse.Namespace) -> int:
    """Serve until interrupted."""
    options = within_limits(MonitorOptions(silent_after_s=args.silent_after, refresh_hz=args.refresh))
    endpoints = Endpoints(
        connect=tuple(args.connect),
        listen=tuple(args.listen),
        scouting=args.scouting,
        config_file=args.zenoh_config,
    )
    if endpoints.isolated:
        raise LandslopeError(
            "there is nowhere to look for vehicles: give --connect, --listen, --scouting or --zenoh-config"
        )
    if args.foxglove:
        return _serve_foxglove(args, options, endpoints)
    return _serve_page(args, options, endpoints)


def token_for(host: str, token_file: str | None) -> str | None:
    """The token that browsers must know. LandslopeError when one is needed and missing, or too short."""
    if token_file is None:
        if is_loopback(host):
            return None
        raise LandslopeError(
            f"--host {host} opens the page to the network: give --token-file with a token of"
            f" {SHORTEST_TOKEN} characters or more"
        )
    try:
        token = Path(token_file).read_text().split("\n")[0].strip()
    except (OSError, UnicodeDecodeError) as error:
        raise LandslopeError(f"{token_file}: the token cannot be read: {error}") from None
    if len(token) < SHORTEST_TOKEN:
        raise LandslopeError(
            f"{token_file}: the token has {len(token)} characters; it needs {SHORTEST_TOKEN} or more"
        )
    return token


def _serve_page(args: argparse.Namespace, options: MonitorOptions, endpoints: Endpoints) -> int:
    _need("nicegui", "monitor")
    token = token_for(args.host, args.token_file)
    port = 8642 if args.port is None else args.port
    certificate, key = _certificate(args)
    _check_free(args.host, port)
    from companion.monitor import server
    from companion.monitor.feed import Feed
    from companion.monitor.state import Watch

    watch = Watch(options)
    feed = Feed(watch, endpoints, args.vehicle)
    try:
        app = server.application(watch, feed, token, secure=certificate is not None)
        scheme = "http" if certificate is None else "https"
        print(f"landslope monitor: {scheme}://{_shown(args.host)}:{port}/  (Ctrl-C ends it)", flush=True)
        server.serve(app, args.host, port, certificate, key)
    finally:
        feed.close()
    return 0


def _serve_foxglove(args: argparse.Namespace, options: MonitorOptions, endpoints: Endpoints) -> int:
    _need("foxglove", "record")
    if not is_loopback(args.host):
        raise LandslopeError(
            f"--host {args.host}: the Foxglove server asks for no token, so it serves on loopback only;"
            " reach it through an ssh tunnel"
        )
    from companion.monitor.foxglove import serve

    return serve(options, endpoints, args.vehicle, args.host, 8765 if args.port is None else args.port)


def _need(module: str, extra: str) -> None:
    if importlib.util.find_spec(module) is None:
        raise LandslopeError(f"this needs the extra '{extra}': pip install 'landslope[{extra}]'")


def _certificate(args: argparse.Namespace) -> tuple[Path | None, Path | None]:
    if bool(args.certificate) != bool(args.key):
        raise LandslopeError("--certificate and --key belong together: give both or none")
    files = [Path(file) if file else None for file in (args.certificate, args.key)]
    for file in files:
        if file is not None and not file.is_file():
            raise LandslopeError(f"{file}: there is no such file")
    return files[0], files[1]


def _check_free(host: str, port: int) -> None:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except (OSError, OverflowError) as error:
            raise LandslopeError(f"cannot serve on {host}:{port}: {error}; choose another --port") from None


def _shown(host: str) -> str:
    return f"[{host}]" if ":" in host else host
