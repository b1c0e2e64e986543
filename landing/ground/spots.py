"""Where the vehicle can land: the disc of the vehicle's size about each cell of the ground map is classified.

In: the ``GroundMap`` (heights and variances, m) and the limits (``GroundOptions``). Out: ``Disc`` for a cell, the
worst of a path, and the best places (``Spot``). A plane is fitted to the known cells of a disc by least squares. Its
inclination (deg), the largest distance of a cell from it (the step, m) and the known share are compared with their
limits: landable when all are within them with their uncertainty, hazard when inclination or step is beyond with its
uncertainty, else unknown.
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from landing.ground.map import CELL_M, CELLS, GroundMap
from landing.options import GroundOptions

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Flags = NDArray[np.uint8]

NAN = math.nan
_MOST_SPOTS = 5
_LOOKED_AT = 0.3
"""Least known share of a disc for a plane fit; with less it is unknown, never a hazard."""
_INDEPENDENT_CELLS = 9
"""Cells of a disc whose errors count as independent: neighbours share the windows of their matches."""
_AT_ONCE = 256
"""Discs fitted at once."""
_NEAR_M, _FAR_HAZARD_M = 0.5, 1.0
"""Ranking of spots: 1 m of distance counts as much as 0.5 m of clearance; clearance above 1 m counts as 1 m."""


class GroundCode(StrEnum):
    """Why a disc is not landable."""

    NO_METRES = "no_metres"
    NO_STOPPING_POINT = "no_stopping_point"
    NOT_SEEN = "not_seen"
    STEEP = "steep"
    MAY_BE_STEEP = "may_be_steep"
    STEP = "step"
    MAY_BE_STEP = "may_be_step"


LANDABLE, HAZARD, UNKNOWN = "landable", "hazard", "unknown"


@dataclass(frozen=True, slots=True)
class Disc:
    """A disc of ground: ``verdict`` "landable", "hazard" or "unknown", the reasons, and the measurements (NaN:
    unknown).

    ``known``: share of its cells with a height. Landable has no reasons.
    """

    verdict: str
    reasons: tuple[GroundCode, ...]
    inclination_deg: float = NAN
    inclination_std_deg: float = NAN
    step_m: float = NAN
    known: float = 0.0


@dataclass(frozen=True, slots=True)
class Spot:
    """A landable disc; its centre is ``north_m`` and ``east_m`` from the vehicle.

    ``clearance_m``: distance from its centre, and from where a gust carries the vehicle, to the nearest cell whose
    disc is not landable.
    """

    north_m: float
    east_m: float
    radius_m: float
    inclination_deg: float
    step_m: float
    clearance_m: float


class Discs:
    """The discs of a map at one moment: ``known``, ``inclination_deg``, ``step_m``, ... (rows, columns), NaN where
    unknown.

    ``hidden``: an area of two cells a side that no look has shown lies in the disc, which could hide a step.
    ``least_step_m``: the step minus its uncertainty.
    """

    def __init__(
        self,
        ground: GroundMap,
        options: GroundOptions,
        tilt_std_deg: float,
        scale_std: float,
        cells: NDArray[np.intp] | None = None,
    ) -> None:
        """``tilt_std_deg``: error of the vertical, one sigma; ``scale_std``: relative error of the map's scale, one
        sigma.

        ``cells`` (n,) are flat indices of the discs to compute; None: every disc of which enough is known.
        """
        self.options, self._tilt_std_deg = options, tilt_std_deg
        self._metres = math.isfinite(scale_std) and scale_std <= options.max_scale_std
        reach = math.floor(options.landing_radius_m / CELL_M + 0.5)
        offset = np.arange(-reach, reach + 1)
        down, across = np.meshgrid(offset, offset, indexing="ij")
        inside = np.hypot(down, across) * CELL_M <= options.landing_radius_m + CELL_M / 2
        self._down, self._across = down[inside], across[inside]
        known, looked = ground.known, ground.seen
        shape = known.shape
        # what was never seen over two cells a side could hide a step
        gaps = gaps_of(looked)
        self.known, self.hidden = np.zeros(shape), np.ones(shape, bool)
        self.inclination_deg, self.step_m, self.least_step_m, self.std_m = (
            np.full(shape, NAN) for _ in range(4)
        )
        if cells is None:
            seen = cv2.filter2D(
                known.astype(np.float32), -1, inside.astype(np.float32), borderType=cv2.BORDER_CONSTANT
            )
            cells = np.flatnonzero(seen >= _LOOKED_AT * len(self._down))
        if len(cells):
            self._fit_all(ground, known, looked, gaps, cells, reach)

    def _fit_all(
        self, ground: GroundMap, known: Mask, looked: Mask, gaps: Flags, cells: NDArray[np.intp], reach: int
    ) -> None:
        """Fit the discs about ``cells``, which reach over ``reach`` cells to all sides."""
        row, column = np.divmod(cells, CELLS)
        (top, bottom), (left, right) = ((int(part.min()), int(part.max()) + 1) for part in (row, column))
        window = slice(max(top - reach, 0), bottom + reach), slice(max(left - reach, 0), right + reach)
        above, below, aside, beyond = (
            max(over, 0)
            for over in (reach - top, bottom + reach - CELLS, reach - left, right + reach - CELLS)
        )

        def framed(part: NDArray[Any]) -> NDArray[Any]:
            # cells outside of the grid are unknown: so no disc reaches out of the window
            wide = cv2.copyMakeBorder(part, above, below, aside, beyond, cv2.BORDER_CONSTANT, value=0)
            return np.asarray(wide).ravel()

        seen = looked[window]
        flags = [framed(part.astype(np.uint8)) for part in (known[window], seen, gaps[window])]
        numbers = [framed(np.where(seen, part[window], 0.0)) for part in (ground.height, ground.variance)]
        side = right - left + 2 * reach
        places = (row - top + reach) * side + column - left + reach
        offsets = self._down * side + self._across
        # so many at a time that their cells stay in the processor's cache
        for first in range(0, len(cells), _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            at = places[part, None] + offsets
            self._fit(cells[part], *[flat.take(at) for flat in (*flags, *numbers)])

    def _fit(self, cells: NDArray[np.intp], *of_discs: NDArray[Any]) -> None:
        """Least-squares plane of each disc: height = north * x + east * y about the mean of its known cells.

        ``of_discs`` (n, k) each, all cells of the discs about ``cells`` (n,): what is known, seen at all and in a gap,
        0 or 1; heights and variances, zero where nothing is seen.
        """
        known, seen, gaps, height, variance = of_discs
        there, looked = known.view(bool), seen.view(bool)
        share = there.mean(axis=1)
        self.known.ravel()[cells] = share
        self.hidden.ravel()[cells] = gaps.any(axis=1)
        some = share >= _LOOKED_AT
        if not some.any():
            return
        if not some.all():
            cells, there, looked = cells[some], there[some], looked[some]
            height, variance = height[some], variance[some]
        weight = there.astype(np.float64)
        count = weight.sum(axis=1)
        height -= ((height * weight).sum(axis=1) / count)[:, None]
        x, y = self._down * CELL_M, self._across * CELL_M
        mx, my = weight @ x / count, weight @ y / count
        cxx = weight @ (x * x) - count * mx * mx
        cxy = weight @ (x * y) - count * mx * my
        cyy = weight @ (y * y) - count * my * my
        # the mean of the known heights was subtracted
        weighted = height * weight
        bx, by = weighted @ x, weighted @ y
        determinant = np.maximum(cxx * cyy - cxy * cxy, 1e-12)
        north = (cyy * bx - cxy * by) / determinant
        east = (cxx * by - cxy * bx) / determinant
        off = height - (north[:, None] * (x - mx[:, None]) + east[:, None] * (y - my[:, None]))
        np.abs(off, out=off)
        off *= looked
        sure = off - self.options.sigmas * np.sqrt(variance)
        # a single look shows a step where it is significant, and proves none
        off = np.where(there, off, sure)
        sure *= weight
        self.inclination_deg.ravel()[cells] = np.degrees(np.arctan(np.hypot(north, east)))
        self.step_m.ravel()[cells] = off.max(axis=1)
        self.least_step_m.ravel()[cells] = sure.max(axis=1)
        self.std_m.ravel()[cells] = np.sqrt((variance * weight).sum(axis=1) / count)

    @property
    def inclination_std_deg(self) -> Array:
        """Standard deviation of the inclination (rows, columns): error of the vertical and noise of the heights."""
        return self._inclination_std_deg(self.std_m)

    def _inclination_std_deg(self, std_m: Array) -> Array:
        lever = self.options.landing_radius_m / 2 * math.sqrt(_INDEPENDENT_CELLS)
        return np.hypot(self._tilt_std_deg, np.degrees(std_m / lever))

    @property
    def landable(self) -> Mask:
        """Cells whose disc is landable. Every comparison fails on NaN."""
        o = self.options
        steepest = self.inclination_deg + o.sigmas * self.inclination_std_deg
        return np.asarray(
            self._metres
            & (self.known >= o.min_known)
            & ~self.hidden
            & (steepest <= o.max_inclination_deg)
            & (self.step_m <= o.max_step_m)
        )

    def at(self, row: int, column: int) -> Disc:
        """The disc about a cell; unknown outside of the grid."""
        if not (0 <= row < CELLS and 0 <= column < CELLS):
            return Disc(UNKNOWN, (GroundCode.NOT_SEEN,))
        o = self.options
        known, inclination = float(self.known[row, column]), float(self.inclination_deg[row, column])
        inclination_std = float(self._inclination_std_deg(self.std_m[row, column]))
        step, least_step = float(self.step_m[row, column]), float(self.least_step_m[row, column])
        doubt = o.sigmas * inclination_std
        reasons = []
        if not self._metres:
            reasons.append(GroundCode.NO_METRES)
        if not known >= o.min_known or self.hidden[row, column]:
            reasons.append(GroundCode.NOT_SEEN)
        if inclination - doubt > o.max_inclination_deg:
            reasons.append(GroundCode.STEEP)
        elif not inclination + doubt <= o.max_inclination_deg:
            reasons.append(GroundCode.MAY_BE_STEEP)
        if least_step > o.max_step_m:
            reasons.append(GroundCode.STEP)
        elif not step <= o.max_step_m:
            reasons.append(GroundCode.MAY_BE_STEP)
        if GroundCode.NOT_SEEN in reasons and not math.isfinite(inclination):
            reasons = [code for code in reasons if code in (GroundCode.NO_METRES, GroundCode.NOT_SEEN)]
        hazard = self._metres and (GroundCode.STEEP in reasons or GroundCode.STEP in reasons)
        verdict = HAZARD if hazard else UNKNOWN if reasons else LANDABLE
        return Disc(verdict, tuple(reasons), inclination, inclination_std, step, known)

    def along(self, ground: GroundMap, places: Array) -> Disc:
        """The worst disc about places (n, 2), north and east in the map's axes."""
        cells = dict.fromkeys(ground.cell_of(float(n), float(e)) for n, e in places)
        return worst([self.at(row, column) for row, column in cells])

    def spots(
        self, ground: GroundMap, place_std_m: float, drift_m: tuple[float, float] = (0.0, 0.0)
    ) -> tuple[Spot, ...]:
        """Landable discs, best first: far from what is not landable, level, near the vehicle.

        Only discs that stay landable when they lie ``place_std_m`` (one sigma) elsewhere. ``drift_m``: where a gust
        carries the vehicle, north and east; a disc is as clear as it is there, too.
        """
        landable = self.landable
        if not landable.any():
            return ()
        clearance = cv2.distanceTransform(landable.astype(np.uint8), cv2.DIST_L2, 5) * CELL_M
        row, column = (clearance > 2 * CELL_M + self.options.sigmas * place_std_m).nonzero()
        if not len(row):
            return ()
        blown = (place + round(drift / CELL_M) for place, drift in zip((row, column), drift_m, strict=True))
        downwind = clearance[tuple(place.clip(0, CELLS - 1) for place in blown)]
        corner_north, corner_east = ground.corner_m
        north = corner_north + (row + 0.5) * CELL_M - ground.place[0]
        east = corner_east + (column + 0.5) * CELL_M - ground.place[1]
        clear = np.minimum(clearance[row, column], downwind).astype(np.float64)
        inclination, step = self.inclination_deg[row, column], self.step_m[row, column]
        merit = np.minimum(clear, _FAR_HAZARD_M) - _NEAR_M * np.hypot(north, east)
        merit -= inclination / self.options.max_inclination_deg + step / self.options.max_step_m
        found: list[Spot] = []
        for k in np.argsort(-merit, kind="stable"):
            if all(
                math.hypot(north[k] - s.north_m, east[k] - s.east_m) >= 2 * self.options.landing_radius_m
                for s in found
            ):
                found.append(
                    Spot(
                        float(north[k]),
                        float(east[k]),
                        self.options.landing_radius_m,
                        float(inclination[k]),
                        float(step[k]),
                        float(clear[k]),
                    )
                )
                if len(found) == _MOST_SPOTS:
                    break
        return tuple(found)


def gaps_of(known: Mask) -> NDArray[np.uint8]:
    """Cells (rows, columns), 1, of unknown areas that hold a square of two cells a side."""
    square = np.ones((2, 2), np.uint8)
    # the square of an even side has no middle: erosion takes its last cell, and dilation must go back from there
    corner = cv2.erode((~known).astype(np.uint8), square, anchor=(1, 1))
    return np.asarray(cv2.dilate(corner, square, anchor=(0, 0)), np.uint8)


def worst(discs: list[Disc]) -> Disc:
    """The disc with the worst verdict, of equal ones the least known; unknown for an empty list."""
    order = {HAZARD: 0, UNKNOWN: 1, LANDABLE: 2}
    return min(
        discs, key=lambda d: (order[d.verdict], d.known), default=Disc(UNKNOWN, (GroundCode.NOT_SEEN,))
    )
