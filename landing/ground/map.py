"""The ground map: looks at the relief fused over time and place, in level axes fixed to the ground.

A grid of cells follows the vehicle; rows go north, columns east. The vehicle's place in it is the sum of its own
motion as the view shows it, in the same metres as the relief, so that what is seen twice falls into the same cell; an
autopilot's position, whose origin may jump, is not asked. Where the view shows no motion the vehicle's velocity
carries on. Heights are up from where the vehicle was when the map was begun.
"""

import math

import numpy as np
from numpy.typing import NDArray

from landing.ground.block_match import PART
from landing.ground.relief import ViewRelief
from landing.options import GroundOptions

Array = NDArray[np.float64]

CELLS = 128
"""Cells a side."""
CELL_M = 0.1
_COARSEST = 3
"""Cells across a part of a block beyond which it has no information about a landing place."""
_CHANGE_STD_M = 0.01
"""Change of a height that is not seen in the square root of a second."""
_SHARED = 0.25
"""Share of a look's variance that no further look takes away: their errors are alike."""
_DISAGREE = 3.0
"""Standard deviations by which a look must differ from what was known for the cell to begin anew."""
_SEEN = 0.2
"""Looks, in baselines, from which a cell has a height at all."""
_MEASURED = 0.25
"""Looks that measured a cell over those that found it bare, at least: a narrow ditch shows its edges, faint texture
shows itself now and then."""
_LEVEL_CELLS = 12
"""Cells seen again from which a look is levelled with the map."""


class GroundMap:
    """Cells (rows, columns): ``height`` m, ``variance`` m^2, ``looks`` (independent ones, fading), ``bare`` (looks that
    found no texture, fading), ``seen_s``, ``disputed`` (share of the recent looks that differ beyond their noise)."""

    def __init__(self, options: GroundOptions, focal_px: float) -> None:
        self.options, self._focal_px = options, focal_px
        shape = (CELLS, CELLS)
        self.height = np.zeros(shape)
        self.variance = np.full(shape, math.inf)
        self.looks = np.zeros(shape)
        self.bare = np.zeros(shape)
        self.seen_s = np.full(shape, -math.inf)
        self.disputed = np.zeros(shape)
        self.place = np.zeros(3)
        """The vehicle (north, east, up) in the map's axes, m."""
        self._corner = np.full(2, -CELLS // 2, np.int64)
        self._time_s = math.nan

    @property
    def corner_m(self) -> tuple[float, float]:
        """North and east of the grid's corner."""
        return float(self._corner[0]) * CELL_M, float(self._corner[1]) * CELL_M

    @property
    def known(self) -> NDArray[np.bool_]:
        """Cells (rows, columns) that are measured well enough and not long ago, and not bare in most looks."""
        o = self.options
        sure = self.variance <= (o.max_step_m / 2) ** 2
        return np.asarray(sure & (self.looks >= np.maximum(_MEASURED * self.bare, o.min_looks)))

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Cells (rows, columns) that have a height, if only from a single look: not enough to stand on it."""
        return np.asarray((self.variance <= self.options.max_step_m**2) & (self.looks >= _SEEN))

    def cell_of(self, north_m: float, east_m: float) -> tuple[int, int]:
        """Row and column of a place in the map's axes; may lie outside."""
        return (
            math.floor(north_m / CELL_M) - int(self._corner[0]),
            math.floor(east_m / CELL_M) - int(self._corner[1]),
        )

    def forget(self) -> None:
        """Nothing is known: the place is lost, or metres are."""
        self.looks[:] = 0.0
        self.bare[:] = 0.0
        self.variance[:] = math.inf
        self.disputed[:] = 0.0

    def move(self, time_s: float, way_ned: Array | None) -> None:
        """The vehicle went by ``way_ned`` (3,) m since the last frame; None where nobody knows."""
        interval_s = time_s - self._time_s
        self._time_s = time_s
        if way_ned is None or not np.isfinite(way_ned).all():
            self.forget()
        else:
            self.place += (way_ned[0], way_ned[1], -way_ned[2])
        if interval_s > 0:
            left = math.exp(-interval_s / self.options.memory_s)
            self.looks *= left
            self.bare *= left
            self.variance += _CHANGE_STD_M**2 * interval_s
        self._follow()

    def resolution(self, distance_m: float) -> float:
        """Side of a cell at the plane's distance along the axis, normalised; NaN where a look would be of no use."""
        fine = PART * distance_m <= _COARSEST * CELL_M * self._focal_px
        return CELL_M / distance_m if fine and distance_m > 0 else math.nan

    def look(self, relief: ViewRelief, ned_from_camera: Array, distance_m: float) -> None:
        """Take one look. ``distance_m`` is the plane's along the axis."""
        if self._footprint_m(relief, distance_m) > _COARSEST * CELL_M:
            return
        # cells under what moves by itself are not known
        moving = self._under(relief, relief.moving, ned_from_camera, distance_m)
        self.looks.ravel()[moving] = 0.0
        self.disputed.ravel()[moving] = 1.0
        self.bare.ravel()[self._under(relief, relief.bare, ned_from_camera, distance_m)] += relief.fresh
        known = relief.known.nonzero()[0]
        if not len(known):
            return
        depth = relief.depth[known]
        north, east, up = self._places(relief.points[known], depth, ned_from_camera, distance_m)
        std = relief.std[known] * distance_m
        index, source = self._cells(north, east, self._footprint_m(relief, distance_m))
        information = (1.0 / (std * std))[source]
        size = CELLS * CELLS
        count = np.bincount(index, minlength=size)
        total = np.bincount(index, information, size)
        seen = count.nonzero()[0]
        height = np.bincount(index, information * up[source], size)[seen] / total[seen]
        variance = count[seen] / total[seen]
        self._fuse(seen, height, variance, relief.fresh)

    def _under(
        self, relief: ViewRelief, which: NDArray[np.bool_], ned_from_camera: Array, distance_m: float
    ) -> NDArray[np.intp]:
        """Flat indices of the cells under parts (n,) of a look that have no height of their own.

        A cell may occur more than once, which numpy's indexed assignments take as once.
        """
        points = relief.points[which]
        if not len(points):
            return np.empty(0, np.intp)
        north, east, _ = self._places(points, np.ones(len(points)), ned_from_camera, distance_m)
        return self._cells(north, east, self._footprint_m(relief, distance_m))[0]

    def _footprint_m(self, relief: ViewRelief, distance_m: float) -> float:
        """Side of a part of a look on the plane at this distance."""
        return relief.reduction * PART * distance_m / self._focal_px

    def _places(
        self, points: Array, depth: Array, ned_from_camera: Array, distance_m: float
    ) -> tuple[Array, Array, Array]:
        """North, east and up (n,) of points (n, 2) at a depth (n,) over the plane's distance."""
        rays = points @ ned_from_camera[:, :2].T + ned_from_camera[:, 2]
        north, east, down = (rays * (depth * distance_m)[:, None]).T
        return self.place[0] + north, self.place[1] + east, self.place[2] - down

    def _cells(
        self, north: Array, east: Array, footprint_m: float
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Flat indices (k,) of the cells under parts of that footprint, and the part of each."""
        parts = max(1, math.ceil(footprint_m / CELL_M))
        steps = (np.arange(parts) - (parts - 1) / 2) * (footprint_m / parts)
        down, across = (part.ravel() for part in np.meshgrid(steps, steps, indexing="ij"))
        row = np.floor((north[:, None] + down) / CELL_M).astype(np.int64) - self._corner[0]
        column = np.floor((east[:, None] + across) / CELL_M).astype(np.int64) - self._corner[1]
        inside = (row >= 0) & (row < CELLS) & (column >= 0) & (column < CELLS)
        source = np.broadcast_to(np.arange(len(north))[:, None], row.shape)[inside]
        return (row * CELLS + column)[inside], source

    def _fuse(self, seen: NDArray[np.intp], height: Array, variance: Array, weight: float) -> None:
        old_height, old_variance = self.height.ravel()[seen], self.variance.ravel()[seen]
        looks, disputed = self.looks.ravel()[seen], self.disputed.ravel()[seen]
        again = looks > 0
        if np.count_nonzero(again) >= _LEVEL_CELLS:
            # the vertical motion adds up errors that all cells share: earlier measurements show it
            lift = float(np.median(old_height[again] - height[again]))
            self.place[2] += lift
            height = height + lift
        innovation = height - old_height
        both = old_variance + variance
        square = innovation * innovation
        alike = square <= _DISAGREE**2 * both
        # a difference that the vehicle can stand on is an error larger than it was said to be, and no other ground
        agrees = again & (alike | (square <= self.options.max_step_m**2))
        gain = np.ones(len(seen))
        gain[agrees] = old_variance[agrees] / both[agrees]
        fused = np.maximum(gain * variance, _SHARED * variance)
        larger = agrees & ~alike
        gain[larger], fused[larger] = 0.5, 0.25 * square[larger]
        self.height.ravel()[seen] = np.where(agrees, old_height + gain * innovation, height)
        self.variance.ravel()[seen] = fused
        self.looks.ravel()[seen] = np.where(agrees, looks + weight, weight)
        self.disputed.ravel()[seen] = disputed + weight * ((again & ~agrees) - disputed)
        self.seen_s.ravel()[seen] = self._time_s

    def _follow(self) -> None:
        """Keep the vehicle in the middle of the grid, by whole cells."""
        middle = np.floor(self.place[:2] / CELL_M).astype(np.int64) - CELLS // 2
        shift = middle - self._corner
        if np.abs(shift).max() < CELLS // 16:
            return
        self._corner = middle
        rows, columns = (int(s) for s in shift)
        for cells, empty in (
            (self.height, 0.0),
            (self.variance, math.inf),
            (self.looks, 0.0),
            (self.bare, 0.0),
            (self.seen_s, -math.inf),
            (self.disputed, 0.0),
        ):
            cells[:] = np.roll(cells, (-rows, -columns), (0, 1))
            cells[_new_part(rows)] = empty
            cells[:, _new_part(columns)] = empty


def _new_part(shift: int) -> slice:
    """Which cells come into the grid when it moves on by ``shift``."""
    if abs(shift) >= CELLS:
        return slice(None)
    return slice(CELLS - shift, None) if shift > 0 else slice(None, -shift)
