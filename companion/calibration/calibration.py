"""A camera's intrinsics from views of a board: which views count, the solution, and whether it may be believed."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.calibration.board import BoardFinder, View
from companion.errors import LandslopeError
from drivers.files.camera_info import CameraInfo
from landing.options import Limits

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class CalibrationOptions:
    """Which sets of views are good enough."""

    min_views: Annotated[int, Limits(4, 200, "", "fewest views of the board")] = 12
    max_views: Annotated[int, Limits(10, 500, "", "most views that are used")] = 60
    min_move: Annotated[
        float, Limits(0, 1, "", "corners' move to the next view, over the picture's width")
    ] = 0.04
    min_coverage: Annotated[float, Limits(0, 1, "", "share of the picture that corners were seen in")] = 0.6
    max_error_px: Annotated[
        float, Limits(0.05, 10, "px", "largest RMS reprojection error, at 640 pixels width")
    ] = 1.0
    outlier: Annotated[float, Limits(1.5, 20, "", "views worse than this times the median are left out")] = (
        3.0
    )
    max_focal_std: Annotated[
        float, Limits(0.0005, 0.5, "", "largest relative uncertainty of the focal length")
    ] = 0.01
    min_tilt_deg: Annotated[float, Limits(0, 60, "deg", "from which on a view counts as tilted")] = 12.0
    min_tilted: Annotated[int, Limits(0, 100, "", "fewest tilted views")] = 4
    sure_std: Annotated[
        float, Limits(0, 10, "sigma", "how far from zero the highest radial term must be, to be used")
    ] = 4.0
    max_centre_shift: Annotated[
        float, Limits(0.01, 0.5, "", "largest way of the principal point from the middle, over the size")
    ] = 0.15


COVERAGE_COLUMNS, COVERAGE_ROWS = 8, 6
REFERENCE_WIDTH = 640
K3_PLACE = 8
"""Of k3 among the intrinsics' standard deviations: fx, fy, cx, cy, k1, k2, p1, p2, k3."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """The solution: ``info`` for the file, RMS error in px, relative focal uncertainty, coverage 0 to 1, views used.

    ``residuals`` are observed minus reprojected corners, (n, 2) px a view; ``left_out`` counts outliers.
    """

    info: CameraInfo
    rms_px: float
    focal_std: float
    coverage: float
    views: tuple[View, ...]
    residuals: tuple[Array, ...]
    left_out: int


def collect_views(
    pictures: Iterable[tuple[int, NDArray[np.uint8]]], finder: BoardFinder, options: CalibrationOptions
) -> tuple[list[View], int, tuple[int, int]]:
    """Views that differ from one another, how many pictures were looked at, and their size (width, height)."""
    views: list[View] = []
    count, size = 0, (0, 0)
    for number, image in pictures:
        here = (image.shape[1], image.shape[0])
        if count and here != size:
            raise LandslopeError(
                f"picture {number} is {here[0]} x {here[1]}, those before are {size[0]} x {size[1]}: one size only"
            )
        size, count = here, count + 1
        view = finder.find(number, image)
        if view is not None and all(_differs(view, other, options.min_move * size[0]) for other in views):
            views.append(view)
    return views, count, size


def calibrate(
    views: Sequence[View],
    pictures: int,
    size: tuple[int, int],
    finder: BoardFinder,
    options: CalibrationOptions,
) -> Calibration:
    """Solve, leave outliers out, solve again; raises LandslopeError, with the remedy, for a set that is not fit."""
    board = finder.board.text
    if not views:
        hint = " its markers are of another board." if finder.foreign_markers else ""
        raise LandslopeError(
            f"no board in any of {pictures} pictures: looked for {board};{hint} give --squares, --dictionary or "
            "--chessboard as the board is, and film it sharp, lit and whole"
        )
    if len(views) < options.min_views:
        raise LandslopeError(
            f"only {len(views)} different views of the board in {pictures} pictures, {options.min_views} are needed: "
            "film it longer, from more sides and distances"
        )
    used = _spread(views, options.max_views)
    solution = _solve(used, size, options)
    good = solution.view_rms <= options.outlier * np.median(solution.view_rms)
    left_out = int((~good).sum())
    if left_out and good.sum() >= options.min_views:
        used = [view for view, keep in zip(used, good, strict=True) if keep]
        solution = _solve(used, size, options)
    else:
        left_out = 0
    coverage = _coverage(used, size)
    _judge(solution, coverage, size, board, options)
    info = CameraInfo(
        size[0],
        size[1],
        tuple(map(float, solution.matrix.ravel())),
        tuple(map(float, solution.distortion.ravel())),
    )
    focal_std = _focal_std(solution)
    return Calibration(info, solution.rms, focal_std, coverage, tuple(used), solution.residuals, left_out)


def cells_seen(views: Iterable[View], size: tuple[int, int]) -> NDArray[np.intp]:
    """How many corners were seen in each cell of a grid over the picture, (rows, columns)."""
    counts = np.zeros((COVERAGE_ROWS, COVERAGE_COLUMNS), np.intp)
    for view in views:
        column = (view.image_px[:, 0] / size[0] * COVERAGE_COLUMNS).astype(int).clip(0, COVERAGE_COLUMNS - 1)
        row = (view.image_px[:, 1] / size[1] * COVERAGE_ROWS).astype(int).clip(0, COVERAGE_ROWS - 1)
        np.add.at(counts, (row, column), 1)
    return counts


@dataclass(frozen=True, slots=True)
class _Solution:
    rms: float
    matrix: Array
    distortion: Array
    std: Array
    view_rms: Array
    tilts_deg: Array
    residuals: tuple[Array, ...]


def _solve(views: Sequence[View], size: tuple[int, int], options: CalibrationOptions) -> _Solution:
    """The solution with the fewest terms: k3 only where it stands out, since it runs wild beyond the last corners."""
    full = _solve_with(views, size, 0)
    k3, k3_std = full.distortion[4], full.std[K3_PLACE]
    if abs(k3) > options.sure_std * k3_std:
        return full
    return _solve_with(views, size, cv2.CALIB_FIX_K3)


def _solve_with(views: Sequence[View], size: tuple[int, int], flags: int) -> _Solution:
    rms, matrix, distortion, turns, moves, std, _, view_rms = cv2.calibrateCameraExtended(
        [view.board_mm for view in views],
        [view.image_px for view in views],
        size,
        np.eye(3),
        np.zeros(5),
        flags=flags,
    )
    residuals = []
    for view, turn, move in zip(views, turns, moves, strict=True):
        there, _ = cv2.projectPoints(view.board_mm, turn, move, matrix, distortion)
        residuals.append(view.image_px.astype(np.float64) - np.asarray(there, np.float64).reshape(-1, 2))
    return _Solution(
        float(rms),
        np.asarray(matrix, np.float64),
        np.asarray(distortion, np.float64).ravel()[:5],
        np.asarray(std, np.float64).ravel(),
        np.asarray(view_rms, np.float64).ravel(),
        np.array([_tilt_deg(turn) for turn in turns]),
        tuple(residuals),
    )


def _tilt_deg(turn: NDArray[Any]) -> float:
    """Angle between the board's normal and the optical axis, of the board's rotation vector."""
    return math.degrees(math.acos(min(1.0, abs(float(cv2.Rodrigues(turn)[0][2, 2])))))


def _judge(
    solution: _Solution, coverage: float, size: tuple[int, int], board: str, options: CalibrationOptions
) -> None:
    largest = options.max_error_px * max(1.0, size[0] / REFERENCE_WIDTH)
    if solution.rms > largest:
        raise LandslopeError(
            f"the reprojection error is {solution.rms:.2f} px, {largest:.2f} is the limit: is the board {board}, flat, "
            "and the film sharp? Move slower, light it better"
        )
    if coverage < options.min_coverage:
        raise LandslopeError(
            f"the board was seen in {coverage:.0%} of the picture, {options.min_coverage:.0%} is needed: bring it into "
            "every corner, near and far"
        )
    uncertain = _focal_std(solution)
    if not uncertain <= options.max_focal_std:
        raise LandslopeError(
            f"the focal length is uncertain by {uncertain:.1%}, {options.max_focal_std:.1%} is the limit: tilt the "
            "board by 20 to 45 degrees, to all sides"
        )
    tilted = int((solution.tilts_deg >= options.min_tilt_deg).sum())
    if tilted < options.min_tilted:
        raise LandslopeError(
            f"only {tilted} views are tilted by {options.min_tilt_deg:g} degrees, {options.min_tilted} are needed: "
            "tilt the board by 20 to 45 degrees, to all sides"
        )
    centre = solution.matrix[:2, 2] - (np.array(size) - 1) / 2
    shift = np.abs(centre) / np.array(size)
    if shift.max() > options.max_centre_shift:
        raise LandslopeError(
            f"the principal point lies {centre[0]:+.0f}, {centre[1]:+.0f} px from the middle, more than "
            f"{options.max_centre_shift:.0%} of the picture: take more views, tilted and near the edges"
        )


def _focal_std(solution: _Solution) -> float:
    """Largest relative standard deviation of the two focal lengths."""
    return float(max(solution.std[0] / solution.matrix[0, 0], solution.std[1] / solution.matrix[1, 1]))


def _coverage(views: Iterable[View], size: tuple[int, int]) -> float:
    return float((cells_seen(views, size) > 0).mean())


def _differs(view: View, other: View, least_px: float) -> bool:
    """Whether the corners that both show have moved, or there are few of them."""
    _, here, there = np.intersect1d(view.ids, other.ids, return_indices=True)
    if len(here) < BoardFinder.MIN_CORNERS:
        return True
    moved = np.linalg.norm(view.image_px[here] - other.image_px[there], axis=1)
    return float(moved.max()) >= least_px


def _spread(views: Sequence[View], most: int) -> list[View]:
    """At most ``most`` of the views, evenly over the film."""
    if len(views) <= most:
        return list(views)
    return [views[k] for k in np.linspace(0, len(views) - 1, most).round().astype(int)]
