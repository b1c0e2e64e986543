"""Calibrate the camera: intrinsics from pictures of a board, or how late its time stamps are from a flight."""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.calibration.board import DICTIONARIES, Board, BoardFinder, draw_board, save_board
from companion.calibration.calibration import CalibrationOptions, calibrate, collect_views
from companion.calibration.picture import picture_of
from companion.calibration.time_offset import TimeOffsetOptions, measure_time_offset
from companion.errors import LandslopeError
from companion.replay.source import PlainCamera, open_source
from drivers.files.camera_info import write_camera_info
from drivers.files.video_file import open_pictures
from drivers.samples import Frame


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    board = Board()
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("source", nargs="?", type=Path, help="a video or a folder of pictures of the board")
    what.add_argument("--print-board", type=Path, metavar="PNG", help="write the board for the printer")
    what.add_argument(
        "--time-offset",
        type=Path,
        metavar="FLIGHT",
        help="measure camera.time_offset_s from a recorded flight",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("camera.yaml"), help="the calibration (default: %(default)s)"
    )
    parser.add_argument(
        "--picture", type=Path, help="the picture of errors and coverage (default: beside --out)"
    )
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
    parser.add_argument("--every", type=int, default=1, metavar="N", help="look at every Nth picture")
    parser.add_argument(
        "--config", type=Path, help="with --time-offset: settings in place of the flight's own"
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
        save_board(args.print_board, draw_board(board, args.dpi), args.dpi)
        print(f"{args.print_board}: {board.text}; print it at 100 % and measure the ruler")
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
    views, count, size = collect_views(_pictures(args.source, max(1, args.every)), finder, options)
    print(f"{count} pictures, {len(views)} different views of the board")
    calibration = calibrate(views, count, size, finder, options)
    write_camera_info(args.out, calibration.info)
    picture = args.picture or args.out.with_suffix(".png")
    if not cv2.imwrite(str(picture), picture_of(calibration)):
        raise LandslopeError(f"{picture}: the picture cannot be written; choose another path with --picture")
    m = calibration.info.matrix
    print(
        f"{len(calibration.views)} views used, {calibration.left_out} left out; reprojection error "
        f"{calibration.rms_px:.3f} px; coverage {calibration.coverage:.0%}\n"
        f"fx {m[0]:.2f} fy {m[4]:.2f} px (+- {calibration.focal_std:.2%}), cx {m[2]:.2f} cy {m[5]:.2f}\n"
        f"{args.out}: the calibration; {picture}: what it rests on"
    )
    return 0


def _pictures(source: Path, every: int) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    for sample in open_pictures(source).frames():
        if isinstance(sample, Frame) and sample.number % every == 0:
            yield sample.number, sample.image


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
        f"time_offset_s = {found.offset_s:.4f}  # +- {found.std_s:.4f} s; the settings have {now:.4f}"
    )
    return 0
