"""Calibrate the camera: intrinsics from pictures of a board, or how late its time stamps are from a flight."""

import argparse
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.calibration.board import DICTIONARIES, Board, BoardFinder
from companion.calibration.calibration import Calibration, CalibrationOptions, calibrate, collect_views
from companion.calibration.coverage_page import CoveragePage, address_of
from companion.calibration.live import LiveCalibration, run_live
from companion.calibration.paper import PAPERS, on_paper, save_board
from companion.calibration.picture import picture_of
from companion.calibration.readout import measure_readout
from companion.calibration.solve import Lens
from companion.calibration.time_offset import TimeOffsetOptions, measure_time_offset
from companion.errors import LandslopeError
from companion.replay.source import PlainCamera, open_source
from companion.settings.settings_file import load
from drivers.cameras import CameraFormat, ReaderLimits, open_camera
from drivers.errors import DriverError
from drivers.files.camera_info import write_camera_info
from drivers.files.video_file import named_images

NAMES_SHOWN = 8
"""Pictures that are left out for one reason are named up to so many."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    board = Board()
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "source",
        nargs="?",
        help="a video, a folder of pictures, a recorded flight or a camera (/dev/video0, picamera, http://, rtsp://)",
    )
    what.add_argument(
        "--live",
        action="store_true",
        help="read camera.source of --config, show what is missing, end when it is enough",
    )
    what.add_argument(
        "--print-board", type=Path, metavar="FILE", help="write the board for the printer, as PNG or PDF"
    )
    what.add_argument(
        "--time-offset",
        type=Path,
        metavar="FLIGHT",
        help="measure camera.time_offset_s and camera.readout_s from a recorded flight",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("camera.yaml"), help="the calibration (default: %(default)s)"
    )
    parser.add_argument(
        "--picture", type=Path, help="the picture of errors and coverage (default: beside --out)"
    )
    parser.add_argument(
        "--page",
        metavar="[HOST:]PORT",
        help="with a camera: show the coverage on a web page too, on this machine alone or at HOST (0.0.0.0:8080)",
    )
    parser.add_argument("--fisheye", action="store_true", help="a wide lens: equidistant, by cv2.fisheye")
    parser.add_argument("--chessboard", action="store_true", help="a plain chessboard instead of ChArUco")
    parser.add_argument(
        "--squares",
        default=f"{board.columns}x{board.rows}",
        help="squares across x down (default: %(default)s)",
    )
    parser.add_argument(
        "--square-mm", type=float, default=board.square_mm, help="a square's side (default: %(default)g)"
    )
    parser.add_argument(
        "--marker-mm", type=float, default=board.marker_mm, help="a marker's side (default: %(default)g)"
    )
    parser.add_argument(
        "--dictionary", default=board.dictionary, help=f"{', '.join(DICTIONARIES)} (default: %(default)s)"
    )
    parser.add_argument(
        "--dpi", type=float, default=300.0, help="the printer's resolution (default: %(default)g)"
    )
    parser.add_argument(
        "--paper",
        choices=tuple(PAPERS),
        default="a4",
        help="what the board is printed on (default: %(default)s)",
    )
    parser.add_argument("--every", type=int, default=1, metavar="N", help="look at every Nth picture")
    parser.add_argument(
        "--config",
        type=Path,
        help="settings: the camera's, for --live and cameras; in place of the flight's own, for --time-offset",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="SECTION.KEY=VALUE",
        dest="overrides",
        help="override a setting",
    )


def run(args: argparse.Namespace) -> int:
    """Print a board, measure the time offset, or calibrate."""
    cv2.setNumThreads(1)
    if args.time_offset is not None:
        return _time_offset(args)
    board = _board(args)
    if args.print_board is not None:
        save_board(args.print_board, on_paper(board, args.dpi, args.paper), args.dpi)
        print(
            f"{args.print_board}: {board.text}, on {args.paper.upper()}; print it at 100 % and measure the ruler"
        )
        return 0
    return _calibrate(args, board)


def _board(args: argparse.Namespace) -> Board:
    try:
        columns, rows = (int(number) for number in args.squares.lower().split("x"))
    except ValueError:
        raise LandslopeError(f"--squares {args.squares}: write it as 8x6, squares across x down") from None
    kind: Literal["charuco", "chessboard"] = "chessboard" if args.chessboard else "charuco"
    return Board(kind, columns, rows, args.square_mm, args.marker_mm, args.dictionary)


def _calibrate(args: argparse.Namespace, board: Board) -> int:
    options, finder = CalibrationOptions(), BoardFinder(board)
    lens: Lens = "equidistant" if args.fisheye else "plumb_bob"
    if args.live or not Path(args.source).exists():
        calibration = _from_camera(args, LiveCalibration(finder, options, lens))
    else:
        found = collect_views(_pictures(Path(args.source), max(1, args.every)), finder, options)
        print(
            f"{found.pictures} pictures of {found.size[0]} x {found.size[1]}, {len(found.views)} different views of "
            "the board"
        )
        _say_left_out(found.left_out)
        calibration = calibrate(found.views, found.pictures, found.size, finder, options, lens)
    return _written(args, calibration)


def _from_camera(args: argparse.Namespace, live: LiveCalibration) -> Calibration:
    """Read the camera that is named, or the one of the settings, until the views are enough."""
    c = load(args.config, tuple(args.overrides)).settings.camera
    wanted = CameraFormat(c.width, c.height, c.rate_hz, c.exposure_us, c.gain, c.pixel_format, c.transport)
    limits = ReaderLimits(open_timeout_s=c.open_timeout_s, read_timeout_s=c.read_timeout_s)
    source = c.source if args.live else args.source
    try:
        camera = open_camera(source, wanted, limits)
    except DriverError as error:
        raise LandslopeError(f"{error}; --set camera.source=SOURCE names it") from None
    with ExitStack() as stack:
        stack.enter_context(camera)
        page = None
        if args.page is not None:
            page = stack.enter_context(CoveragePage(*address_of(args.page)))
            print(f"the coverage is shown at port {page.port} too", flush=True)

        def show(text: str) -> None:
            print(f"{text}\n", flush=True)
            if page is not None:
                page.show(text)

        return run_live(camera, live, show)


def _say_left_out(left_out: list[tuple[str, str]]) -> None:
    """How many pictures gave no view, for which reasons, and which ones."""
    if not left_out:
        return
    reasons: dict[str, list[str]] = {}
    for name, reason in left_out:
        reasons.setdefault(reason, []).append(name)
    print(f"{len(left_out)} pictures left out:")
    for reason, names in reasons.items():
        more = f" and {len(names) - NAMES_SHOWN} more" if len(names) > NAMES_SHOWN else ""
        print(f"  {len(names)} {reason}: {', '.join(names[:NAMES_SHOWN])}{more}")


def _written(args: argparse.Namespace, calibration: Calibration) -> int:
    write_camera_info(args.out, calibration.info)
    picture = args.picture or args.out.with_suffix(".png")
    coded, data = cv2.imencode(".png", picture_of(calibration))
    if not coded:
        raise LandslopeError(f"{picture}: the picture cannot be coded as PNG")
    try:
        picture.write_bytes(data.tobytes())
    except OSError as error:
        raise LandslopeError(
            f"{picture}: the picture cannot be written ({error.strerror}); choose another path with --picture"
        ) from None
    m = calibration.info.matrix
    print(
        f"{len(calibration.views)} views used, {calibration.left_out} left out; reprojection error "
        f"{calibration.rms_px:.3f} px; coverage {calibration.coverage:.0%}\n"
        f"fx {m[0]:.2f} fy {m[4]:.2f} px (+- {calibration.focal_std:.2%}), cx {m[2]:.2f} cy {m[5]:.2f}\n"
        f"{args.out}: the calibration ({calibration.info.distortion_model}); {picture}: what it rests on"
    )
    return 0


def _pictures(source: Path, every: int) -> Iterator[tuple[str, NDArray[np.uint8] | None]]:
    return (named for k, named in enumerate(named_images(source)) if k % every == 0)


def _time_offset(args: argparse.Namespace) -> int:
    source = open_source(args.time_offset, args.config, tuple(args.overrides), PlainCamera())
    if not source.telemetry:
        raise LandslopeError(
            f"{args.time_offset}: a recorded flight with telemetry is needed, not a plain video"
        )
    if not source.calibrated:
        raise LandslopeError("the time offset needs a calibrated camera: set camera.calibration")
    found = measure_time_offset(source.samples(), source.camera, source.settings, TimeOffsetOptions())
    now = source.settings.camera.time_offset_s
    print(
        f"{found.pairs} pairs of frames, rate of turn varying by {found.swing_rad_s:.2f} rad/s, correlation "
        f"{found.correlation:.3f}\n"
        f"time_offset_s = {found.offset_s:.4f}  # +- {found.std_s:.4f} s; the settings have {now:.4f}",
        flush=True,
    )
    _readout(args, source.settings.camera.readout_s)
    return 0


def _readout(args: argparse.Namespace, now: float | str) -> None:
    """The rows' readout of the same flight; without one the offset stands alone."""
    overrides = (*args.overrides, "camera.readout_s=unknown")
    source = open_source(args.time_offset, args.config, overrides, PlainCamera())
    try:
        found = measure_readout(source.samples(), source.camera, source.settings)
    except LandslopeError as refusal:
        print(f"# {refusal}; the settings have readout_s = {now}")
        return
    print(f"readout_s = {found.readout_s:.4f}  # +- {found.std_s:.4f} s; the settings have {now}")
