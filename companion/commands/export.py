"""Write recorded flights as MCAP, for Foxglove, Rerun and other robotics tools (needs the extra 'record')."""

import argparse
import importlib.util
import sys
from pathlib import Path

from companion.errors import LandslopeError

ENDING = ".mcap"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument("flights", nargs="+", type=Path, metavar="FLIGHT", help="flight folder")
    parser.add_argument(
        "--mcap",
        required=True,
        type=Path,
        metavar="OUT",
        help="file; a folder when there are several flights",
    )
    parser.add_argument("--config", type=Path, metavar="FILE", help="settings instead of the flight's own")
    parser.add_argument("--set", action="append", default=[], metavar="SECTION.KEY=VALUE", dest="overrides")
    parser.add_argument("--force", action="store_true", help="replace files that exist")


def run(args: argparse.Namespace) -> int:
    """Export every flight; print what went into each file."""
    if importlib.util.find_spec("foxglove") is None:
        raise LandslopeError("this needs the extra 'record': pip install 'landslope[record]'")
    from companion.replay.to_mcap import export

    for flight, out in zip(args.flights, outputs(args.flights, args.mcap, force=args.force), strict=True):
        done = export(flight, out, args.config, tuple(args.overrides))
        print(
            f"{out}: {done.frames} frames, {done.estimates} estimates, {done.events} events,"
            f" {out.stat().st_size / 1e6:.1f} MB"
        )
        if done.damage:
            print(f"landslope export: {flight}: ended early: {done.damage}", file=sys.stderr)
    return 0


def outputs(flights: list[Path], out: Path, *, force: bool) -> list[Path]:
    """A file for each flight. LandslopeError for names that clash, files that exist, folders that do not."""
    several = len(flights) > 1
    if several and out.suffix == ENDING and not out.is_dir():
        raise LandslopeError(f"--mcap {out}: {len(flights)} flights need a folder, not one file")
    folder = several or out.is_dir()
    files = [out / f"{flight.resolve().name}{ENDING}" if folder else out for flight in flights]
    if len(set(files)) < len(files):
        raise LandslopeError("two flights have the same name: export them one by one")
    for file in files:
        if file.is_dir():
            raise LandslopeError(f"{file}: is a folder; choose another path")
        if file.exists() and not force:
            raise LandslopeError(f"{file}: exists; give --force to replace it")
        if several:
            file.parent.mkdir(parents=True, exist_ok=True)
        if not file.parent.is_dir():
            raise LandslopeError(f"{file}: there is no folder {file.parent}; make it first")
    return files
