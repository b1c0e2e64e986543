"""A camera's intrinsics from views of a board: which views count, the solution, and whether it may be believed."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from companion.calibration.board import BoardFinder, View
from companion.calibration.solve import Lens, Solution, solve
from companion.core.camera_model import model_of
from companion.errors import LandslopeError
from drivers.files.camera_info import EQUIDISTANT, CameraInfo
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


@dataclass(frozen=True, slots=True)
class Collected:
    """Views that differ from one another, of ``pictures`` of one ``size`` (width, height), and what was left out.

    ``left_out`` has the name and the reason of every picture that gave no view.
    """

    views: list[View]
    pictures: int
    size: tuple[int, int]
    left_out: list[tuple[str, str]]


class ViewCollector:
    """Takes pictures one at a time; most of them decide which size is calibrated."""

    def __init__(self, finder: BoardFinder, options: CalibrationOptions) -> None:
        self._finder, self._options = finder, options
        self._views: dict[tuple[int, int], list[View]] = {}
        self._pictures: list[tuple[str, tuple[int, int], str]] = []

    def add(self, name: str, image: NDArray[np.uint8] | None) -> bool:
        """Whether the picture, None where it cannot be decoded, gave a new view."""
        if image is None:
            self._pictures.append((name, (0, 0), "cannot be decoded"))
            return False
        size = (image.shape[1], image.shape[0])
        views = self._views.setdefault(size, [])
        view = self._finder.find(len(self._pictures), image)
        if view is None:
            reason = "no board found"
        elif not all(_differs(view, other, self._options.min_move * size[0]) for other in views):
            reason = "as another"
        else:
            views.append(view)
            reason = ""
        self._pictures.append((name, size, reason))
        return not reason

    @property
    def collected(self) -> Collected:
        """What came so far."""
        sizes = Counter(size for _, size, _ in self._pictures if size != (0, 0))
        if not sizes:
            return Collected([], 0, (0, 0), [(name, reason) for name, _, reason in self._pictures])
        size = sizes.most_common(1)[0][0]
        left_out = []
        for name, other, reason in self._pictures:
            if other not in (size, (0, 0)):
                left_out.append((name, f"{other[0]} x {other[1]}, not {size[0]} x {size[1]}"))
            elif reason:
                left_out.append((name, reason))
        return Collected(list(self._views[size]), sizes[size], size, left_out)


def collect_views(
    pictures: Iterable[tuple[str, NDArray[np.uint8] | None]], finder: BoardFinder, options: CalibrationOptions
) -> Collected:
    """The views in pictures given with their names."""
    collector = ViewCollector(finder, options)
    for name, image in pictures:
        collector.add(name, image)
    return collector.collected


def calibrate(
    views: Sequence[View],
    pictures: int,
    size: tuple[int, int],
    finder: BoardFinder,
    options: CalibrationOptions,
    lens: Lens = "plumb_bob",
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
    solution = solve(used, size, lens, options.sure_std)
    good = solution.view_rms <= options.outlier * np.median(solution.view_rms)
    left_out = int((~good).sum())
    if left_out and good.sum() >= options.min_views:
        used = [view for view, keep in zip(used, good, strict=True) if keep]
        solution = solve(used, size, lens, options.sure_std)
    else:
        left_out = 0
    coverage = _coverage(used, size)
    _check_quality(solution, coverage, size, board, options)
    info = CameraInfo(
        size[0],
        size[1],
        tuple(map(float, solution.matrix.ravel())),
        tuple(map(float, solution.distortion.ravel())),
        lens,
        covariance=tuple(map(float, solution.covariance.ravel())),
    )
    _check_possible(info)
    return Calibration(
        info, solution.rms, solution.focal_std, coverage, tuple(used), solution.residuals, left_out
    )


def _check_possible(info: CameraInfo) -> None:
    """LandslopeError for a result that no camera has."""
    try:
        model_of(info, "the result")
    except LandslopeError as error:
        hint = "" if info.distortion_model == EQUIDISTANT else "; a wide lens needs --fisheye"
        raise LandslopeError(
            f"{error} with more views, into every corner and tilted to all sides{hint}"
        ) from None


def cells_seen(views: Iterable[View], size: tuple[int, int]) -> NDArray[np.intp]:
    """How many corners were seen in each cell of a grid over the picture, (rows, columns)."""
    counts = np.zeros((COVERAGE_ROWS, COVERAGE_COLUMNS), np.intp)
    for view in views:
        column = (view.image_px[:, 0] / size[0] * COVERAGE_COLUMNS).astype(int).clip(0, COVERAGE_COLUMNS - 1)
        row = (view.image_px[:, 1] / size[1] * COVERAGE_ROWS).astype(int).clip(0, COVERAGE_ROWS - 1)
        np.add.at(counts, (row, column), 1)
    return counts


def _check_quality(
    solution: Solution, coverage: float, size: tuple[int, int], board: str, options: CalibrationOptions
) -> None:
    largest = options.max_error_px * max(1.0, size[0] / REFERENCE_WIDTH)
    if solution.rms > largest:
        raise LandslopeError(
            f"the reprojection error is {solution.rms:.2f} px, {largest:.2f} is the limit: is the board {board}, flat, "
            "and the film sharp? Move slower, light it better; a wide lens needs --fisheye"
        )
    if coverage < options.min_coverage:
        raise LandslopeError(
            f"the board was seen in {coverage:.0%} of the picture, {options.min_coverage:.0%} is needed: bring it into "
            "every corner, near and far"
        )
    uncertain = solution.focal_std
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
