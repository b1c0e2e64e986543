"""Run recorded flights, videos or folders of images through the pipeline, and say what happened.

A FLIGHT is a flight folder, a folder of flight folders, a plain video file or a folder of images. With several flights,
which run in parallel, --out, --ground, --events, --plot, --video and --report take a directory or a name with {flight}
in it.
"""

import argparse
import multiprocessing
import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from companion.errors import LandslopeError
from companion.replay.output import check_writable, names_of, outputs_for
from drivers.errors import DriverError
from drivers.files.video_writer import check_video_name
from drivers.system.workers import worker_pool
from landing.errors import LandingError

if TYPE_CHECKING:
    from companion.replay.replay import Progress, ReplayJob

POLL_S = 0.2
ERRORS = (LandslopeError, DriverError, LandingError)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument(
        "flights", nargs="+", type=Path, metavar="FLIGHT", help="flight folder, video or image folder"
    )
    files = parser.add_argument_group("what is written")
    files.add_argument("--out", metavar="FILE.jsonl", help="one estimate a frame")
    files.add_argument("--ground", metavar="FILE.jsonl", help="what of the ground can be landed on, 2 Hz")
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
    plain = parser.add_argument_group("plain videos and image folders")
    plain.add_argument("--fps", type=_positive, help="frames a second (default: the file's own, else 30)")
    camera = plain.add_mutually_exclusive_group()
    camera.add_argument("--fov-deg", type=_angle, metavar="DEG", help="field of view across the image")
    camera.add_argument("--focal-px", type=_positive, metavar="PX", help="focal length")
    camera.add_argument("--calibration", type=Path, metavar="camera.yaml", help="ROS camera_info file")


def run(args: argparse.Namespace) -> int:
    """Replay the flights; 0, or 2 when one of them could not be."""
    jobs = _jobs(args)
    with _progress_bars(jobs) as bars:
        results = _in_parallel(jobs, bars) if len(jobs) > 1 else [_summary_of(jobs[0], bars(jobs[0]))]
    for text, failed in results:
        print(text, file=sys.stderr if failed else sys.stdout)
    return 2 if any(failed for _, failed in results) else 0


def _jobs(args: argparse.Namespace) -> "list[ReplayJob]":
    """One job a flight, with everything checked that can be before the run."""
    from companion.replay.replay import ReplayJob
    from companion.replay.source import PlainCamera, flights_in

    if args.plot:
        from companion.replay.plot import require_matplotlib

        require_matplotlib()
    flights = []
    for flight in args.flights:
        if not flight.exists():
            raise LandslopeError(
                f"{flight}: there is no such flight; give a flight folder, a video or an image folder"
            )
        flights += flights_in(flight)
    several = len(flights) > 1
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
            path=flight,
            config=args.config,
            overrides=tuple(overrides),
            plain=plain,
            outputs=files,
            publish=args.publish,
            realtime=args.realtime or bool(args.connect),
            enable_after_s=args.enable_after,
            enable_from_rc=args.enable_from_rc,
            connect=args.connect,
        )
        for name, flight, files in zip(names, flights, outputs, strict=True)
    ]


def _summary_of(job: "ReplayJob", progress: "Progress") -> tuple[str, bool]:
    """The summary, or the error as one line; and whether it is an error."""
    from companion.replay.replay import replay

    try:
        return replay(job, progress), False
    except ERRORS as error:
        return f"landslope replay: {job.name}: {error}", True
    except OSError as error:
        return f"landslope replay: {job.name}: {error.filename or 'a file'}: {error.strerror}", True


_reports: Any = None
"""In a worker process: the queue to the one that draws the progress."""


def _start_worker(queue: Any) -> None:
    global _reports
    _reports = queue


def _work(job: "ReplayJob") -> tuple[str, bool]:
    return _summary_of(job, lambda done, total: _reports.put((job.name, done, total)))


def _in_parallel(jobs: "Sequence[ReplayJob]", bars: "Any") -> list[tuple[str, bool]]:
    context = multiprocessing.get_context("spawn")
    updates = {job.name: bars(job) for job in jobs}
    with context.Manager() as manager:
        queue = manager.Queue()
        workers = min(len(jobs), os.cpu_count() or 1)
        with worker_pool(workers, _start_worker, (queue,)) as pool:
            futures = [pool.submit(_work, job) for job in jobs]
            pending: set[Future[tuple[str, bool]]] = set(futures)
            while pending:
                pending = wait(pending, timeout=POLL_S).not_done
                while not queue.empty():
                    name, done, total = queue.get()
                    updates[name](done, total)
            return [_result(job, future) for job, future in zip(jobs, futures, strict=True)]


def _result(job: "ReplayJob", future: "Future[tuple[str, bool]]") -> tuple[str, bool]:
    try:
        return future.result()
    except BrokenProcessPool:
        return f"landslope replay: {job.name}: its process died (out of memory?); replay it on its own", True


@contextmanager
def _progress_bars(jobs: "Sequence[ReplayJob]") -> Iterator[Any]:
    """A function that gives each job its progress report: a bar on a terminal, nothing elsewhere."""
    if not sys.stderr.isatty():
        yield lambda job: lambda done, total: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    with Progress(*columns, console=Console(stderr=True), transient=True) as shown:
        tasks = {job.name: shown.add_task(job.name, total=None) for job in jobs}
        yield lambda job: lambda done, total: shown.update(tasks[job.name], completed=done, total=total)


def _number(text: str, low: float, high: float, what: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(f"'{text}' is not {what} of {low:g} to {high:g}")
    return value


def _seconds(text: str) -> float:
    return _number(text, 0, 1e6, "a number of seconds")


def _positive(text: str) -> float:
    return _number(text, 0.001, 1e5, "a number")


def _angle(text: str) -> float:
    return _number(text, 5, 170, "an angle in degrees")
