"""Dense relief of the view: plane plus parallax, block by block.

An older picture is warped by the plane's homography, so that the plane stands still. What still moves, moves along the
parallax direction by its height over the plane (Irani and Anandan, "Parallax geometry of pairs of points for 3D scene
analysis", 1996); what moves across it is noise, a wrong match, or an object that moves by itself. Dense inverse search
(OpenCV's DIS optical flow) finds the motion, and one least-squares step along the parallax direction makes a height of
it whose error follows from the texture and the noise of the two pictures themselves.
"""

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from landing.ground.block_match import BLOCK, PART, STEP_PX, SUPPORT, in_parts, match, means_of_blocks
from landing.motion.motion import OverPlane
from landing.motion.views import Views
from landing.options import GroundOptions
from landing.plane.plane import Plane
from landing.rotations import exp_so3
from landing.vision.camera import CameraModel
from landing.vision.homography import RowMoves, Warp, apply, moved, towards

Array = NDArray[np.float64]
Image = NDArray[Any]

KEPT = 40
"""Pictures kept; the gap looked back over is at most one less."""
_FRAMES_APART = 2
"""Frames from look to look at least: what a look costs is spread over them."""
_SAMPLE = 40
_MOVING = 4.0
"""Residual across the parallax, in its own standard deviations, from which a block moves by itself."""
_MOVING_PX = 0.5
_LONGEST, _LENGTHEN = 2.5, 0.3
"""Longest baseline over the usual one, and how much of what is missing is taken at a look."""
_NO_SECOND_MAP = np.empty((0, 0), np.float32)
_LEAST_COLUMNS = 320
"""Pictures are not reduced below this width."""
_FLOW_COLUMNS = 80
"""Width at which the dense flow is found, as is measured to be fast and fine enough."""


@dataclass(frozen=True, slots=True)
class ViewRelief:
    """One look at the ground, a row a part of a block of the picture (n parts, row by row).

    ``points`` (n, 2) are the parts' middles, normalised, in the newest frame at its middle row's time; ``depth`` (n,)
    the distance along the axis over that of the plane at the axis, NaN where it is not known; ``std`` (n,) one sigma of
    it. ``moving`` (n,) marks what moves against the ground, ``bare`` (n,) what both pictures show without texture.
    ``fresh`` is the motion since the last look over that of the baseline, at most one: looks over the same baseline
    share their errors. ``reduction``: side of the picture over that of the one that was looked at.
    """

    points: Array
    depth: Array
    std: Array
    moving: NDArray[np.bool_]
    bare: NDArray[np.bool_]
    fresh: float
    reduction: int = 1

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which parts (n,) have a height."""
        return np.isfinite(self.depth)


class DenseRelief:
    """Looks at the relief of the whole view whenever the view has moved on enough."""

    def __init__(self, options: GroundOptions, camera: CameraModel) -> None:
        self.options, self.camera = options, camera
        self._images: deque[Image] = deque(maxlen=KEPT)
        self._warp = Warp(camera)
        self._half: DenseRelief | None = None
        """The same for pictures of half the size, where they are large enough."""
        if camera.width >= 2 * _LEAST_COLUMNS:
            self._half = DenseRelief(options, camera.resized(camera.width // 2, camera.height // 2))
        self._flow: Any = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST)
        self._flow.setFinestScale(0)
        self._shrunk = 2 ** max(0, round(math.log2(camera.width / _FLOW_COLUMNS)))
        self._rows, self._columns = camera.height // BLOCK, camera.width // BLOCK
        x = np.arange(self._columns) * BLOCK + (BLOCK - 1) / 2
        y = np.arange(self._rows) * BLOCK + (BLOCK - 1) / 2
        self._centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        self.points = camera.undistort(self._centres)
        """Middles of the blocks (n, 2), normalised."""
        x = np.arange(2 * self._columns) * PART + (PART - 1) / 2
        y = np.arange(2 * self._rows) * PART + (PART - 1) / 2
        parts = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        self._parts = camera.undistort(parts)
        self._shares, self._part_shares = (
            middles[:, 1] / (camera.height - 1) - 0.5 for middles in (self._centres, parts)
        )
        height, width = self._rows * BLOCK, self._columns * BLOCK
        self._size = (height, width)
        self._grid = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
        self.take_mask()
        self._moved, self._frames = math.inf, 0
        self._longer = 1.0

    def take_mask(self) -> None:
        """The camera's mask has changed."""
        barred = self._barred = self.camera.barred(SUPPORT // 2)
        column, row = np.rint(self._centres).astype(np.intp).T
        self.mask = np.zeros(len(self._centres), bool) if barred is None else barred[row, column]
        """Blocks (n,) whose window holds something that is not the ground."""
        if self._half is not None:
            half = self._half.camera
            half.mask = self.camera.resized(half.width, half.height).mask
            self._half.take_mask()

    @property
    def target_px(self) -> float:
        """Flow that is looked back over."""
        return self._longer * self.options.baseline * self.camera.width

    def ask_for(self, look: ViewRelief, std: float) -> None:
        """From the next look on a baseline as long as it takes for a standard deviation of ``std`` over the distance.

        Noise and coarse pixels make heights from far up too uncertain; over a longer way they are less so.
        """
        known = look.std[look.known]
        if not len(known):
            return
        wanted = self._longer * float(np.median(known)) / std
        self._longer += _LENGTHEN * (min(max(wanted, 1.0), _LONGEST) - self._longer)

    def step(self, views: Views, plane: Plane, image: Image, resolution: float = 0.0) -> ViewRelief | None:
        """The relief at the newest frame, of this ``image``; None between looks, and where the motion shows none.

        ``resolution`` is the smallest normalised length that is of use: the picture is reduced as far as its parts are
        no larger. NaN: a look would be of no use, and the next one is due as soon as one is.
        The picture is taken as the camera gave it: with a local mean taken out, as it is for the tracks, what lies
        within that mean's reach of an edge or of texture shows some of it, and seems to be seen.
        """
        self._images.appendleft(image)
        self._frames += 1
        if plane.status != "ok" or not np.isfinite(plane.omega).all():
            self._moved = math.inf
            return None
        if views.longest >= 1:
            interval_s = views.newest.time_s - views.view(1).time_s
            self._moved += float(np.linalg.norm(plane.omega)) * interval_s * self.camera.focal_px
        if self._moved < self.options.look_step * self.target_px or self._frames < _FRAMES_APART:
            return None
        if math.isnan(resolution):
            return None
        gap = self._gap(views)
        motion = None if gap is None else self._motion(views, plane, gap)
        if gap is None or motion is None:
            return None
        fresh = min(1.0, self._moved / self.target_px)
        self._moved, self._frames = 0.0, 0
        moves = views.rows.moves_of(gap)
        looking, reduction = self.reduced(resolution)
        size = looking.camera.width, looking.camera.height
        new, old = self._images[0], self._images[gap]
        if reduction > 1:
            new, old = (cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in (new, old))
        relief = looking.look(new, old, plane.normal, *motion, fresh, moves)
        return replace(relief, reduction=reduction)

    def reduced(self, resolution: float) -> tuple["DenseRelief", int]:
        """The look at the smallest picture whose parts are no larger than ``resolution``, and its reduction."""
        half = self._half
        if half is None or PART / half.camera.focal_px > resolution:
            return self, 1
        looking, reduction = half.reduced(resolution)
        return looking, 2 * reduction

    def _gap(self, views: Views) -> int | None:
        """The gap whose flow is nearest to the one wanted; None where none is near."""
        gaps, _, flow = views.profile(24, 0.3, _SAMPLE)
        flow_px = flow[gaps < len(self._images)] * self.camera.focal_px
        if not len(flow_px):
            return None
        best = int(np.abs(flow_px - self.target_px).argmin())
        usual_px = self.target_px / self._longer
        if not 0.5 * usual_px <= flow_px[best] <= 2.0 * self.target_px:
            return None
        return int(gaps[best])

    def _motion(self, views: Views, plane: Plane, gap: int) -> tuple[Array, Array] | None:
        """Displacement over height t (3,) from the newest to the older frame, and old_from_new (3, 3)."""
        rotation = views.rotation(gap)
        if rotation is None:
            return None
        tracks, derotated = views.stack(np.array([gap]))
        weight = plane.weights(len(views.tracker.alive)).take(tracks.slots)
        noise = plane.noise if math.isfinite(plane.noise) else 1.0
        over = OverPlane(tracks.new, derotated, plane.normal, tracks.whitener, turns=True)
        found = over.displacement(weight, views.baseline_std(gap) / (2 * noise))
        if found is None:
            return None
        return found[0][0, :3], rotation @ exp_so3(found[0][0, 3:])

    def look(
        self,
        new: Image,
        old: Image,
        normal: Array,
        t: Array,
        old_from_new: Array,
        fresh: float = 1.0,
        row_moves: RowMoves | None = None,
    ) -> ViewRelief:
        """The relief in ``new`` (height, width) against ``old``, over a plane of the normal (3,) at distance one.

        ``t`` (3,) is the displacement from the newest to the older frame over height, in the newest frame's axes, and
        ``old_from_new`` (3, 3) the rotation, both between the middle rows' times; ``row_moves`` of the two pictures.
        """
        height, width = self._size
        new = np.ascontiguousarray(new[:height, :width])
        old_from_this = old_from_new @ towards(t, normal)
        places = self._warp.places(old_from_this, row_moves=row_moves)[:height, :width]
        warped = cv2.remap(
            np.ascontiguousarray(old),
            places,
            _NO_SECOND_MAP,
            cv2.INTER_CUBIC,
            borderMode=cv2.BORDER_REPLICATE,
        )
        forth, back = self._flows(new, warped)
        flow = np.column_stack([means_of_blocks(part) for part in forth])
        # OpenCV 5.0.0 interpolates linearly at wrong places where both coordinates come in one map
        x, y = (cv2.add(here, part) for here, part in zip(self._grid, forth, strict=True))
        aligned = cv2.remap(warped, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        inside = self._inside(places, flow, old.shape) & ~self.mask
        usable = self._both_ways(flow, back) & inside
        along, per_normalised = self._parallax(t)
        matched = match(new, aligned, flow, along)
        usable &= matched.converged
        std_px = matched.std_px
        points = self.points if row_moves is None else moved(self.points, self._shares, row_moves[0])
        found = points + (matched.along_px / per_normalised)[:, None] * self._direction(t)
        depth, per_step = _depth(points, found, t, normal)
        std = per_step * std_px / self.camera.focal_px
        across = np.abs(matched.across_px)
        moving = usable & (across > _MOVING_PX) & (across > _MOVING * matched.across_std_px)
        relative = std / np.abs(depth)
        usable &= ~moving & (depth > 0) & (relative <= self.options.max_std)
        # a height belongs to where the texture is: beside an edge, to the edge
        parts = self._parts + matched.aside_px.reshape(-1, 2) / self.camera.focal_px
        if row_moves is not None:
            parts = moved(parts, self._part_shares, row_moves[0])
        known = self._in_parts(usable) & matched.seen.ravel()
        # a part lies on the same slope as the plane, at its block's height over it
        aside = self._in_parts(points @ normal[:2] + normal[2]) / (parts @ normal[:2] + normal[2])
        return ViewRelief(
            parts,
            np.where(known, self._in_parts(depth) * aside, math.nan),
            np.where(known, self._in_parts(std) * aside, math.nan),
            self._in_parts(moving),
            self._in_parts(inside) & matched.bare.ravel(),
            fresh,
        )

    def _in_parts(self, of_blocks: NDArray[Any]) -> NDArray[Any]:
        """What is known of blocks (n,), for their parts (4 n,)."""
        return in_parts(of_blocks, self._rows, self._columns).ravel()

    def _flows(self, new: Image, warped: Image) -> tuple[list[Image], Image]:
        """The flow, x and y (height, width) px each, and that of the way back as it is found, over small pictures."""
        height, width = self._size
        size = width // self._shrunk, height // self._shrunk
        small = [cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in (new, warped)]
        forth, back = (
            self._flow.calc(a, b, None) * np.float32(self._shrunk) for a, b in (small, small[::-1])
        )
        full = [
            cv2.resize(part, (width, height), interpolation=cv2.INTER_LINEAR) for part in cv2.split(forth)
        ]
        return full, back

    def _both_ways(self, flow: Array, back: Image) -> NDArray[np.bool_]:
        """Blocks (n,) whose flow (n, 2) leads back to where it began; ``back`` as ``_flows`` has it."""
        to = ((self._centres + flow + 0.5) / self._shrunk - 0.5).astype(np.float32)
        x, y = (np.ascontiguousarray(part).reshape(self._rows, self._columns) for part in to.T)
        there = cv2.remap(back, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        left = flow + there.reshape(-1, 2)
        return np.asarray(np.hypot(left[:, 0], left[:, 1]) <= STEP_PX)

    def _inside(self, places: NDArray[np.float32], flow: Array, shape: tuple[int, ...]) -> NDArray[np.bool_]:
        """Blocks (n,) whose window lies in the older picture, and not on its mask."""
        x, y = np.rint(self._centres + flow).astype(np.intp).T
        height, width = self._size
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        there = places[y.clip(0, height - 1), x.clip(0, width - 1)]
        margin = BLOCK / 2
        inside &= (there >= margin).all(axis=1)
        inside &= (there[:, 0] <= shape[1] - 1 - margin) & (there[:, 1] <= shape[0] - 1 - margin)
        if self._barred is not None:
            column, row = np.rint(there).astype(np.intp).T
            inside &= ~self._barred[row.clip(0, shape[0] - 1), column.clip(0, shape[1] - 1)]
        return inside

    def _direction(self, t: Array) -> Array:
        """Unit vectors (n, 2) along the parallax, normalised coordinates: away from or towards the epipole."""
        away = t[:2] - self.points * t[2]
        return away / np.maximum(np.linalg.norm(away, axis=1), 1e-12)[:, None]

    def _parallax(self, t: Array) -> tuple[Array, Array]:
        """Unit vectors (n, 2) along the parallax in pixels, and pixels a normalised unit there (n,)."""
        step = 1.0 / self.camera.focal_px
        moved = self.camera.project(self.points + step * self._direction(t)) - self._centres
        length = np.hypot(moved[:, 0], moved[:, 1])
        return moved / length[:, None], length / step


def _depth(points: Array, found: Array, t: Array, normal: Array) -> tuple[Array, Array]:
    """Distance (n,) along the axis over the plane's, and its change (n,) with a normalised step of ``found`` (n, 2).

    ``found`` is where the points (n, 2) are in the older picture as the plane's homography warps it. With d the
    plane's distance over the point's, both seen from the newest frame, x' - x = d (x' tz - tx), y' alike.
    """
    old = apply(towards(t, normal), found)
    reach = old * t[2] - t[:2]
    length2 = np.maximum((reach * reach).sum(axis=1), 1e-18)
    inverse = ((old - points) * reach).sum(axis=1) / length2
    with np.errstate(divide="ignore"):
        depth = 1.0 / inverse
    return depth, depth * depth / np.sqrt(length2)
