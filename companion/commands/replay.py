"""Run recorded flights, videos or folders of images through the pipeline, and say what happened.

A FLIGHT is a flight folder, a folder of flight folders, a plain video file or a folder of images. With several flights,
which run in parallel, --out, --ground, --events, --plot, --video and --report take a directory or a name with {flight}
in it.
"""

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from companion.errors import LandslopeError
from companion.replay.output import check_writable, names_of, outputs_for
from drivers.files.remote_folder import folders_with, is_remote
from drivers.files.video_writer import check_video_name

if TYPE_CHECKING:
    from companion.replay.replay import ReplayJob


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument(
        "flights",
        nargs="*",
        metavar="FLIGHT",
        help="flight folder, video or image folder; an address of fsspec, as s3://bucket/flights",
    )
    files = parser.add_argument_group("what is written")
    files.add_argument("--out", metavar="FILE.jsonl", help="one estimate a frame")
    files.add_argument("--ground", metavar="FILE.jsonl", help="the ground map: where it is landable, 2 Hz")
    files.add_argument("--events", metavar="FILE.jsonl", help="every change of decision and every event")
    files.add_argument("--plot", metavar="FILE.png", help="the flight at a glance (needs the extra 'plot')")
    files.add_argument("--video", metavar="FILE.webm", help="tracks, surface and verdict drawn on the frames")
    files.add_argument(
        "--report", metavar="FILE.html", help="one page of the flight that opens in any browser"
    )
    files.add_argument(
        "--publish",
        action="store_true",
        help="every message on zenoh: to watchers on this network, or as --set zenoh.* says",
    )
    how = parser.add_argument_group("how it runs")
    how.add_argument("--realtime", action="store_true", help="at the recorded pace")
    how.add_argument(
        "--enable-after", type=_seconds, metavar="SECONDS", help="enable landing at this time of the flight"
    )
    how.add_argument(
        "--enable-from-rc",
        action="store_true",
        help="the recorded pilot's switch enables landing (landing.enable_rc_channel, landing.enable_modes)",
    )
    how.add_argument(
        "--connect",
        metavar="LINK",
        help="rehearse: send the request to a real autopilot (udpout:HOST:PORT, tcp:HOST:PORT, /dev/ttyX:BAUD)",
    )
    how.add_argument(
        "--config", type=Path, metavar="FILE", help="settings in place of the flight's landslope.toml"
    )
    how.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="SECTION.KEY=VALUE",
        dest="overrides",
        help="override a setting",
    )
    many = parser.add_argument_group("many flights")
    many.add_argument("--list", type=Path, metavar="FILE", help="a text file with one FLIGHT a line")
    many.add_argument("--jobs", type=_count, metavar="N", help="processes (default: one a processor)")
    many.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="replay on the workers of this Dask scheduler (needs the extra 'scale')",
    )
    many.add_argument(
        "--table",
        type=Path,
        metavar="FOLDER.parquet",
        help="a row a flight, written as they end; taken up again where it was cut off",
    )
    plain = parser.add_argument_group("plain videos and image folders")
    plain.add_argument("--fps", type=_positive, help="frames a second (default: the file's own, else 30)")
    camera = plain.add_mutually_exclusive_group()
    camera.add_argument("--fov-deg", type=_angle, metavar="DEG", help="field of view across the image")
    camera.add_argument("--focal-px", type=_positive, metavar="PX", help="focal length")
    camera.add_argument("--calibration", type=Path, metavar="camera.yaml", help="ROS camera_info file")


def run(args: argparse.Namespace) -> int:
    """Replay the flights; 0, or 2 when one of them could not be."""
    jobs = _jobs(args)
    if args.table is not None:
        return _into_table(args, jobs)
    if len(jobs) == 1 and args.dask is None:
        from companion.replay.many import replay_one
        from companion.replay.workers import progress_bars

        with progress_bars(jobs) as bars:
            results = [replay_one(jobs[0], bars(jobs[0]))]
    else:
        from companion.replay.workers import in_parallel

        found = {job.name: result for job, result in in_parallel(jobs, args.jobs, args.dask)}
        results = [found[job.name] for job in jobs]
    for result in results:
        print(result.text, file=sys.stderr if result.failed else sys.stdout)
    return 2 if any(result.failed for result in results) else 0


def _into_table(args: argparse.Namespace, jobs: "list[ReplayJob]") -> int:
    """A row a flight; those that failed are named, the others are counted."""
    from companion.replay.many import FlightTable
    from companion.replay.workers import in_parallel

    started, failures, flown_s = time.monotonic(), 0, 0.0
    with FlightTable(args.table, jobs[0]) as table:
        left = table.left(jobs)
        for _, result in in_parallel(left, args.jobs, args.dask):
            table.add(result.row)
            flown_s += result.row.seconds
            if result.failed:
                failures += 1
                print(result.text, file=sys.stderr)
    took_s = max(time.monotonic() - started, 1e-3)
    before = f", {len(jobs) - len(left)} were there" if len(left) < len(jobs) else ""
    rates = f"{len(left) / took_s:.2f} flights a second, {flown_s / took_s:.1f} times real time"
    print(
        f"{len(left)} flights in {took_s:.0f} s ({rates}){before}; "
        f"{failures} could not be replayed: {args.table}"
    )
    return 2 if failures else 0


def _jobs(args: argparse.Namespace) -> "list[ReplayJob]":
    """One job a flight, with everything checked that can be before the run."""
    from companion.replay.replay import ReplayJob
    from companion.replay.source import FLIGHT_FILES, PlainCamera, flights_in

    if args.plot:
        from companion.replay.plot import require_matplotlib

        require_matplotlib()
    flights: list[Path] = []
    addresses: list[str] = []
    for word in _words(args):
        for found in folders_with(word, FLIGHT_FILES) if is_remote(word) else flights_in(_present(word)):
            flights.append(Path(found.partition("://")[2]) if isinstance(found, str) else found)
            addresses.append(found if isinstance(found, str) else "")
    several = len(flights) > 1
    if args.dask is not None and (args.connect or args.publish):
        raise LandslopeError("--dask replays elsewhere: without --connect and --publish")
    if args.connect and several:
        raise LandslopeError("--connect rehearses one flight at a time: give one FLIGHT")
    if args.enable_from_rc and args.enable_after is not None:
        raise LandslopeError("--enable-after and --enable-from-rc: give one of them")
    names_wanted = ("out", "ground", "events", "plot", "video")
    wanted = {name: getattr(args, name) for name in names_wanted}
    wanted["report"] = args.report
    names = names_of(flights)
    outputs = [outputs_for(name, wanted, several) for name in names]
    check_writable(outputs)
    for files in outputs:
        if files.video is not None:
            check_video_name(files.video)
    overrides = list(args.overrides)
    if args.publish and not any(word.startswith("zenoh.") for word in overrides):
        overrides.insert(0, "zenoh.scouting=true")  # on the desk, watchers are found by themselves
    plain = PlainCamera(args.fps, args.fov_deg, args.focal_px, args.calibration)
    return [
        ReplayJob(
            name=name,
            path=flight if address else flight.absolute(),
            address=address,
            config=None if args.config is None else args.config.absolute(),
            overrides=tuple(overrides),
            plain=plain,
            outputs=files,
            publish=args.publish,
            realtime=args.realtime or bool(args.connect),
            enable_after_s=args.enable_after,
            enable_from_rc=args.enable_from_rc,
            connect=args.connect,
        )
        for name, flight, address, files in zip(names, flights, addresses, outputs, strict=True)
    ]


def _words(args: argparse.Namespace) -> list[str]:
    """The flights as they were named, on the line and in the list."""
    words = list(args.flights)
    if args.list is not None:
        try:
            lines = args.list.read_text(encoding="utf-8", errors="surrogateescape").splitlines()
        except OSError as error:
            raise LandslopeError(f"--list {args.list}: cannot be read: {error.strerror}") from None
        words += [line.strip() for line in lines if line.strip() and not line.startswith("#")]
    if not words:
        raise LandslopeError("no flight: give a FLIGHT, or --list FILE with one a line")
    return words


def _present(word: str) -> Path:
    if not Path(word).exists():
        raise LandslopeError(
            f"{word}: there is no such flight; give a flight folder, a video or an image folder"
        )
    return Path(word)


def _number(text: str, low: float, high: float, what: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(f"'{text}' is not {what} of {low:g} to {high:g}")
    return value


def _count(text: str) -> int:
    return int(_number(text, 1, 10_000, "a number of processes"))


def _seconds(text: str) -> float:
    return _number(text, 0, 1e6, "a number of seconds")


def _positive(text: str) -> float:
    return _number(text, 0.001, 1e5, "a number")


def _angle(text: str) -> float:
    return _number(text, 5, 170, "an angle in degrees")
