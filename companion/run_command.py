"""Run the daemon: live camera and autopilot in, estimates and the landing command out."""

import argparse
import logging
from pathlib import Path

from companion.settings_file import load


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument("--config", type=Path, metavar="FILE", help="the settings, a landslope.toml")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="SECTION.KEY=VALUE",
        dest="overrides",
        help="override a setting",
    )
    parser.add_argument("--verbose", action="store_true", help="log MAVSDK's chatter too")


def run(args: argparse.Namespace) -> int:
    """Run until SIGTERM or SIGINT."""
    import cv2

    from companion.daemon import Daemon, stop_on_signals

    logging.basicConfig(
        level=logging.DEBUG if args.verbose else logging.INFO, format="%(levelname)s %(name)s: %(message)s"
    )
    cv2.setNumThreads(1)  # as in a replay: the same rounding, and no threads that fight for the cores
    daemon = Daemon(load(args.config, args.overrides).settings)
    stop_on_signals(daemon)
    daemon.run()
    return 0
