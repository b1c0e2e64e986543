"""The renderer: what a camera at a pose sees of a world, with exact depth.

Every pixel's ray is met with the facets' planes in closed form, so geometry is exact whatever the lens. A depth
buffer over a grid of sub-samples decides what is in front; textures are read trilinearly from filtered pyramids, so
that nothing aliases; pixels on an edge are averaged over their sub-samples.
"""

import time
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.errors import DriverError
from drivers.simulated.lens import Lens
from drivers.simulated.textures import pyramid, texture
from drivers.simulated.world import World

Array = NDArray[np.float64]
Image = NDArray[np.float32]

NEAR_M = 1e-3
SKY = 205.0
EDGE = np.float32(3e-7)
"""Slack of the edge test, so that rounding leaves no crack between neighbours."""
SUN = np.array([0.35, -0.25, -0.90]) / np.linalg.norm([0.35, -0.25, -0.90])
"""Where the light comes from, NED."""
AMBIENT = 0.55


@dataclass(frozen=True)
class _Atlas:
    """All pyramids in one picture: the upper left corner of level k of texture m stands, in cv2's coordinates, at
    (column, row)[m * levels + k].
    """

    picture: Image
    column: Image
    row: Image
    size: int
    levels: int


def _atlas(materials: list[str], seed: int, size: int) -> _Atlas:
    stacks = [pyramid(texture(name, seed, size)) for name in materials]
    levels = len(stacks[0])
    width = size + 2 + size // 2 + 2
    picture = np.zeros((size + 2 * levels, width * len(stacks)), dtype=np.float32)
    column = np.zeros((len(stacks), levels), dtype=np.float32)
    row = np.zeros((len(stacks), levels), dtype=np.float32)
    for m, stack in enumerate(stacks):
        x, y = m * width, 0
        for k, level in enumerate(stack):
            n = len(level)
            picture[y : y + n + 2, x : x + n + 2] = np.pad(level, 1, mode="wrap")
            # One texel of margin, and half a texel from a corner to the middle.
            column[m, k], row[m, k] = x + 0.5, y + 0.5
            x, y = (m * width + size + 2, 0) if k == 0 else (x, y + n + 2)
    return _Atlas(picture, column.ravel(), row.ravel(), size, levels)


class Renderer:
    """Pictures, depth and facets in view, from any pose. ``position`` (3,) NED m, ``ned_from_camera`` (3, 3).

    ``fine`` shades every one of ``samples`` x ``samples`` sub-samples of a pixel (for data sets); without it only the
    pixels on the facets' edges are (for live use). Not safe for threads.
    """

    def __init__(
        self,
        world: World,
        lens: Lens,
        *,
        fine: bool = False,
        samples: int | None = None,
        texture_size: int = 1024,
        texture_seed: int = 1,
    ) -> None:
        self.world, self.lens, self.fine = world, lens, fine
        self.samples = (4 if fine else 2) if samples is None else samples
        if not 1 <= self.samples <= 8:
            raise DriverError(f"samples must lie between 1 and 8, got {self.samples}")
        names = sorted({f.material for f in world.facets})
        self._atlas = _atlas(names, texture_seed, texture_size)
        self._x, self._y = lens.rays()
        self._sx, self._sy = lens.rays(self.samples) if self.samples > 1 else (self._x, self._y)
        # Bounds of the rays of a column and up to it (of a row ...), rising, to look facets' bounds up in.
        self._x_low = np.minimum.accumulate(self._sx.min(axis=0)[::-1])[::-1]
        self._x_high = np.maximum.accumulate(self._sx.max(axis=0))
        self._y_low = np.minimum.accumulate(self._sy.min(axis=1)[::-1])[::-1]
        self._y_high = np.maximum.accumulate(self._sy.max(axis=1))
        self._corners = np.array(
            [
                [self._sx.min(), self._sy.min(), 1],
                [self._sx.max(), self._sy.min(), 1],
                [self._sx.min(), self._sy.max(), 1],
                [self._sx.max(), self._sy.max(), 1],
            ]
        ).T
        self._place = np.array(
            [names.index(f.material) * self._atlas.levels for f in world.facets], dtype=np.int32
        )
        self._repeat = np.array([1.0 / f.texture_m for f in world.facets])
        self._u_axis = np.stack([f.u_axis for f in world.facets])
        self._v_axis = np.stack([f.v_axis for f in world.facets])
        light = AMBIENT + (1 - AMBIENT) * np.maximum(world.normals @ SUN, 0)
        self._gain = (light / (AMBIENT + (1 - AMBIENT) * SUN[2] * -1)).astype(np.float32)
        self._pixel = 1.0 / lens.focal_px

    def image(self, position: Array, ned_from_camera: Array) -> Image:
        """(height, width) float32, 0 to 255, without noise."""
        ids, _ = self._visible(position, ned_from_camera)
        coefficients = self._coefficients(position, ned_from_camera)
        s, h, w = self.samples, self.lens.height, self.lens.width
        if self.fine:
            shaded = self._shade(
                coefficients, ids.ravel(), self._sx.ravel(), self._sy.ravel(), self._pixel / s
            )
            return shaded.reshape(h, s, w, s).mean(axis=(1, 3), dtype=np.float32)
        blocks = ids.reshape(h, s, w, s)
        first = blocks[:, 0, :, 0]
        same = np.ones((h, w), dtype=bool)
        for i in range(s):
            for j in range(s):
                if i or j:
                    same &= blocks[:, i, :, j] == first
        picture = self._shade(coefficients, first.ravel(), self._x.ravel(), self._y.ravel(), self._pixel)
        picture = picture.reshape(h, w)
        if not same.all():
            edge = np.ascontiguousarray(~same)
            ids, x, y = (
                t.reshape(h, s, w, s).swapaxes(1, 2)[edge].ravel() for t in (ids, self._sx, self._sy)
            )
            values = self._shade(coefficients, ids, x, y, self._pixel)
            picture[edge] = values.reshape(-1, s * s).mean(axis=1)
        return picture

    def depth(self, position: Array, ned_from_camera: Array) -> tuple[Array, NDArray[np.int32]]:
        """(Z along the optical axis in m, index of the facet), each (height, width); inf and -1 where there is nothing.

        At the pixels' middles (with an even number of samples: of the sub-sample just above and left of it).
        """
        ids, _ = self._visible(position, ned_from_camera)
        s = self.samples
        middle = ids[(s - 1) // 2 :: s, (s - 1) // 2 :: s]
        q = self._inverse_depth(position, ned_from_camera)[middle]
        z = q[..., 0] * self._x + q[..., 1] * self._y + q[..., 2]
        found = middle >= 0
        return np.where(found, 1 / np.where(found, z, 1.0), np.inf), middle

    def cast(self, position: Array, direction: Array) -> tuple[int, float]:
        """The first facet that a ray (3,) NED meets and its distance in m; (-1, inf) where there is none.

        Computed alone, without the depth buffer.
        """
        world = self.world
        towards = world.normals @ direction
        away = world.offsets - world.normals @ position
        with np.errstate(divide="ignore", invalid="ignore"):
            t = away / towards
        meets = (towards < -1e-12) & (away < 0)
        relative = world.vertices - position
        edges = np.cross(np.roll(relative, -1, axis=1), relative)
        meets &= np.all(edges @ direction >= -1e-12, axis=1)
        if not meets.any():
            return -1, np.inf
        k = int(np.argmin(np.where(meets, t, np.inf)))
        return k, float(t[k])

    def rays(self) -> Array:
        """(height, width, 3): the ray (x, y, 1) of every pixel's middle, camera frame."""
        x, y = self._x.astype(np.float64), self._y.astype(np.float64)
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def rows(self, positions: Array, ned_from_camera: Array, bands: int = 12) -> Image:
        """A picture whose rows were exposed one after the other: poses (height, 3) and (height, 3, 3), one a row.

        Each row is shaded at its own pose; which facet is in front is decided once a band of rows.
        """
        h, w = self.lens.height, self.lens.width
        picture = np.empty((h, w), dtype=np.float32)
        for part in np.array_split(np.arange(h), bands):
            middle = int(part[len(part) // 2])
            ids, _ = self._visible(positions[middle], ned_from_camera[middle])
            s = self.samples
            for row in part:
                coefficients = self._coefficients(positions[row], ned_from_camera[row])
                total = np.zeros(w, dtype=np.float32)
                for i in range(s):
                    line = row * s + i
                    values = self._shade(coefficients, ids[line], self._sx[line], self._sy[line], self._pixel)
                    total += values.reshape(w, s).mean(axis=1)
                picture[row] = total / s
        return picture

    def _inverse_depth(self, position: Array, ned_from_camera: Array) -> Array:
        """(n, 3): 1/Z of a ray (x, y, 1) on every facet's plane; NaN for planes through the camera."""
        normals = self.world.normals @ ned_from_camera
        distance = self.world.offsets - self.world.normals @ position
        return normals / np.where(np.abs(distance) < 1e-12, np.nan, distance)[:, None]

    def _visible(self, position: Array, ned_from_camera: Array) -> tuple[NDArray[np.int32], Image]:
        """(facet, 1/Z) of every sub-sample, each (height * samples, width * samples); -1 and 0 where nothing is."""
        world = self.world
        ids = np.full(self._sx.shape, -1, dtype=np.int32)
        nearest = np.zeros(self._sx.shape, dtype=np.float32)
        corners = (world.vertices - position) @ ned_from_camera
        # Only the outer side is seen: the camera must stand before the plane.
        candidates = world.offsets - world.normals @ position < -1e-9
        candidates &= corners[:, :, 2].max(axis=1) > NEAR_M
        edges = np.cross(np.roll(corners, -1, axis=1), corners)
        lengths = np.linalg.norm(edges, axis=2, keepdims=True)
        edges /= np.where(lengths < 1e-15, 1.0, lengths)
        at_corners = edges @ self._corners
        candidates &= np.all(at_corners.max(axis=2) >= -1e-6, axis=1)
        index = np.flatnonzero(candidates)
        cutting = at_corners[index].min(axis=2) < 0
        sides = edges[index].astype(np.float32)
        inverse = self._inverse_depth(position, ned_from_camera)[index].astype(np.float32)
        for k, (top, bottom, left, right), (a, b, c), lines, cuts in zip(
            index, self._bounds(corners[index]), inverse, sides, cutting, strict=True
        ):
            if top >= bottom or left >= right:
                continue
            part = (slice(top, bottom), slice(left, right))
            sx, sy = self._sx[part], self._sy[part]
            value = a * sx
            value += b * sy
            value += c
            closer = value > nearest[part]
            for p, q, r in lines[cuts]:
                side = p * sx
                side += q * sy
                closer &= side >= -r - EDGE
            np.copyto(nearest[part], value, where=closer)
            np.copyto(ids[part], np.int32(k), where=closer)
        return ids, nearest

    def _bounds(self, corners: Array) -> list[list[int]]:
        """(top, bottom, left, right) of the sub-samples that a facet (n, 4, 3; camera frame) can cover, each."""
        z = corners[:, :, 2]
        ahead = z.min(axis=1) > NEAR_M
        x = corners[:, :, 0] / np.where(ahead[:, None], z, 1.0)
        y = corners[:, :, 1] / np.where(ahead[:, None], z, 1.0)
        rows, columns = self._sx.shape
        bounds = np.stack(
            [
                np.where(ahead, np.searchsorted(self._y_high, y.min(axis=1), "left"), 0),
                np.where(ahead, np.searchsorted(self._y_low, y.max(axis=1), "right"), rows),
                np.where(ahead, np.searchsorted(self._x_high, x.min(axis=1), "left"), 0),
                np.where(ahead, np.searchsorted(self._x_low, x.max(axis=1), "right"), columns),
            ],
            axis=1,
        )
        return bounds.tolist()

    def _coefficients(self, position: Array, ned_from_camera: Array) -> Image:
        """(11, n + 1) float32, a column a facet: 1/Z (3), texture u (3) and v (3) a metre of depth, u and v below.

        u and v count repetitions of the texture; the last column stands for the sky.
        """
        world = self.world
        n = len(world.facets)
        out = np.zeros((n + 1, 11))
        inverse = self._inverse_depth(position, ned_from_camera)
        out[:n, 0:3] = np.where(np.isnan(inverse), 1.0, inverse)
        repeat = self._repeat[:, None]
        out[:n, 3:6] = repeat * (self._u_axis @ ned_from_camera)
        out[:n, 6:9] = repeat * (self._v_axis @ ned_from_camera)
        # Textures are anchored at NED's origin, so that neighbouring facets in one plane go on without a seam.
        out[:n, 9] = self._repeat * (self._u_axis @ position) % 1.0
        out[:n, 10] = self._repeat * (self._v_axis @ position) % 1.0
        out[n, 2] = 1.0
        return np.ascontiguousarray(out.T, dtype=np.float32)

    def _shade(self, coefficients: Image, ids: NDArray[np.int32], x: Image, y: Image, pixel: float) -> Image:
        """Grey values (m,) of rays (x, y, 1) on known facets; ``pixel`` is the width of a sample in x."""
        only = int(ids[0]) if len(ids) and np.all(ids == ids[0]) else None
        if only == -1:
            return np.full(len(ids), SKY, dtype=np.float32)
        if only is None:
            c = [np.take(column, ids, mode="wrap") for column in coefficients]
            place = np.take(self._place, ids, mode="wrap")
            gain = np.take(self._gain, ids, mode="wrap")
        else:
            c = list(coefficients[:, only])
            place = self._place[only]
            gain = self._gain[only]
        z = np.maximum(c[0] * x + c[1] * y + c[2], np.float32(1e-6))
        np.reciprocal(z, out=z)
        u: Image = (c[3] * x + c[4] * y + c[5]) * z
        v: Image = (c[6] * x + c[7] * y + c[8]) * z
        # Derivatives of (u, v) by (x, y), times a sample's width: the footprint in repetitions of the texture.
        step = z * np.float32(pixel)
        ux, uy = (c[3] - u * c[0]) * step, (c[4] - u * c[1]) * step
        vx, vy = (c[6] - v * c[0]) * step, (c[7] - v * c[1]) * step
        e, g, f = ux * ux + vx * vx, uy * uy + vy * vy, ux * uy + vx * vy
        largest = 0.5 * (e + g + np.sqrt((e - g) ** 2 + 4 * f * f))
        atlas = self._atlas
        lod = 0.5 * np.log2(np.maximum(largest, np.float32(1e-20))) + np.float32(np.log2(atlas.size))
        np.clip(lod, 0, atlas.levels - 1.001, out=lod)
        lower = lod.astype(np.int32)
        blend = lod - lower
        u += c[9]
        v += c[10]
        u -= np.floor(u)
        v -= np.floor(v)
        size = np.ldexp(np.float32(atlas.size), -lower)
        place = place + lower
        grey = self._look_up(u, v, size, place)
        size *= np.float32(0.5)
        place += 1
        grey += (self._look_up(u, v, size, place) - grey) * blend
        grey *= gain
        np.clip(grey, 0, 255, out=grey)
        if only is None and (ids < 0).any():
            grey[ids < 0] = SKY
        return grey

    def _look_up(self, u: Image, v: Image, size: Image, place: NDArray[np.int32]) -> Image:
        """Grey values at repetitions (u, v) in the atlas's part number ``place``, ``size`` texels wide."""
        atlas = self._atlas
        at_x = u * size
        at_x += np.take(atlas.column, place)
        at_y = v * size
        at_y += np.take(atlas.row, place)
        # cv2.remap takes at most 32766 columns: long lists go in as several rows.
        count, width = len(at_x), 8192
        if count > width:
            rows = -(-count // width)
            at_x, at_y = np.resize(at_x, (rows, width)), np.resize(at_y, (rows, width))
        grey = cv2.remap(atlas.picture, at_x, at_y, cv2.INTER_LINEAR)
        return np.asarray(grey, dtype=np.float32).reshape(-1)[:count]


def frame_rate(renderer: Renderer, position: Array, ned_from_camera: Array, seconds: float = 1.0) -> float:
    """Frames/s of ``Renderer.image`` on this machine, measured over about ``seconds`` on one thread."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        renderer.image(position, ned_from_camera)
        start, count = time.perf_counter(), 0
        while time.perf_counter() - start < seconds:
            renderer.image(position, ned_from_camera)
            count += 1
        return count / (time.perf_counter() - start)
    finally:
        cv2.setNumThreads(threads)
