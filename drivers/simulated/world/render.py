"""The renderer: what a camera at a pose sees of a world, with exact depth.

Every pixel's ray is met with the facets' planes in closed form, so geometry is exact whatever the lens. A depth
buffer over a grid of sub-samples decides what is in front; textures are read trilinearly from filtered pyramids, so
that nothing aliases; pixels on an edge are averaged over their sub-samples.
"""

import time

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.errors import DriverError
from drivers.simulated.world.lens import Lens
from drivers.simulated.world.shading import SKY, Shader, Table, inverse_depth, joined
from drivers.simulated.world.world import World

Array = NDArray[np.float64]
Image = NDArray[np.float32]

NEAR_M = 1e-3
EDGE = np.float32(5e-7)
"""Slack of the edge test, so that rounding leaves no crack between neighbours."""


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
        self._shader = Shader(world, texture_size, texture_seed)
        self._x, self._y = lens.rays()
        self._sx, self._sy = lens.rays(self.samples) if self.samples > 1 else (self._x, self._y)
        # Without distortion a column of rays has one x and a row one y: products of vectors, not of pictures.
        self._straight = lens.straight and lens.matrix[0, 1] == 0
        every = slice((self.samples - 1) // 2, None, self.samples)
        self._middle = (every, every)
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

    def image(self, position: Array, ned_from_camera: Array) -> Image:
        """(height, width) float32, 0 to 255, without noise."""
        ids = self._visible(position, ned_from_camera)
        table = self._shader.table(position, ned_from_camera, slice(None))
        s, h, w = self.samples, self.lens.height, self.lens.width
        if self.fine:
            shaded = self._shade(table, ids.ravel(), self._sx.ravel(), self._sy.ravel(), 1 / s)
            return shaded.reshape(h, s, w, s).mean(axis=(1, 3), dtype=np.float32)
        blocks = ids.reshape(h, s, w, s)
        first = blocks[:, 0, :, 0]
        same = np.ones((h, w), dtype=bool)
        for i in range(s):
            for j in range(s):
                if i or j:
                    same &= blocks[:, i, :, j] == first
        picture = self._shade(table, first.ravel(), self._x.ravel(), self._y.ravel())
        picture = picture.reshape(h, w)
        if not same.all():
            edge = np.ascontiguousarray(~same)
            ids, x, y = (
                t.reshape(h, s, w, s).swapaxes(1, 2)[edge].ravel() for t in (ids, self._sx, self._sy)
            )
            values = self._shade(table, ids, x, y)
            picture[edge] = values.reshape(-1, s * s).mean(axis=1)
        return picture

    def depth(self, position: Array, ned_from_camera: Array) -> tuple[Array, NDArray[np.int32]]:
        """(Z along the optical axis in m, index of the facet), each (height, width); inf and -1 where there is nothing.

        Along ``rays()``: the rays that decided which facet is seen, so that none is met far off its edge.
        """
        ids = self._visible(position, ned_from_camera)
        middle = ids[self._middle]
        q = inverse_depth(self.world, position, ned_from_camera, slice(None))[middle]
        z = q[..., 0] * self._sx[self._middle] + q[..., 1] * self._sy[self._middle] + q[..., 2]
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
        """(height, width, 3): the ray (x, y, 1) of every pixel's middle, camera frame.

        With an even number of samples: that of the sub-sample just above and left of the middle.
        """
        x, y = self._sx[self._middle].astype(np.float64), self._sy[self._middle].astype(np.float64)
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def rows(self, positions: Array, ned_from_camera: Array, bands: int = 12) -> Image:
        """A picture whose rows were exposed one after the other: poses (height, 3) and (height, 3, 3), one a row.

        Each row is shaded at its own pose; which facet is in front is decided once a band of rows.
        """
        h, w, s = self.lens.height, self.lens.width, self.samples
        picture = np.empty((h, w), dtype=np.float32)
        for part in np.array_split(np.arange(h), min(bands, h)):
            middle = int(part[len(part) // 2])
            lines = slice(int(part[0]) * s, (int(part[-1]) + 1) * s)
            ids = self._visible(positions[middle], ned_from_camera[middle], lines)
            used = np.unique(ids[ids >= 0])
            if not len(used):
                picture[part] = SKY
                continue
            # One column for every facet in view at every row's pose.
            table = joined([self._shader.table(positions[r], ned_from_camera[r], used) for r in part])
            column = np.searchsorted(used, ids) + len(used) * (np.arange(len(ids)) // s)[:, None]
            column = np.where(ids < 0, -1, column).astype(np.int32)
            x, y = self._sx[lines], self._sy[lines]
            values = self._shade(table, column.ravel(), x.ravel(), y.ravel())
            picture[part] = values.reshape(len(part), s, w, s).mean(axis=(1, 3))
        return picture

    def _shade(self, table: Table, ids: NDArray[np.int32], x: Image, y: Image, width: float = 1.0) -> Image:
        """Grey values (m,) of samples ``width`` pixels wide."""
        pixel: float | Image = width / self.lens.focal_px
        if self.lens.equidistant:
            # sqrt of the area that a pixel covers: 1 / cos^2 of the angle along the radius, less across
            pixel = np.float32(pixel) * (1 + x * x + y * y) ** np.float32(0.75)
        return self._shader.shade(table, ids, x, y, pixel)

    def _visible(
        self, position: Array, ned_from_camera: Array, lines: slice | None = None
    ) -> NDArray[np.int32]:
        """(m, width * samples) facet of every sub-sample in the ``lines`` of the grid (default all); -1: none."""
        world = self.world
        first, last, _ = (lines or slice(None)).indices(len(self._sx))
        ids = np.full((last - first, self._sx.shape[1]), -1, dtype=np.int32)
        nearest = np.zeros(ids.shape, dtype=np.float32)
        # Only the outer side is seen: the camera must stand before the plane.
        index = np.flatnonzero(world.offsets - world.normals @ position < -1e-9)
        corners = (world.vertices[index] - position) @ ned_from_camera
        bounds = self._bounds(corners, first, last)
        seen = (bounds[:, 0] < bounds[:, 1]) & (bounds[:, 2] < bounds[:, 3])
        seen &= corners[:, :, 2].max(axis=1) > NEAR_M
        index, corners, bounds = index[seen], corners[seen], bounds[seen]
        edges = np.cross(np.roll(corners, -1, axis=1), corners)
        lengths = np.linalg.norm(edges, axis=2, keepdims=True)
        edges /= np.where(lengths < 1e-15, 1.0, lengths)
        at_corners = edges @ self._corners
        seen = np.all(at_corners.max(axis=2) >= -1e-6, axis=1)
        index, bounds, edges = index[seen], bounds[seen], edges[seen].astype(np.float32)
        cutting = at_corners[seen].min(axis=2) < 0
        inverse = inverse_depth(world, position, ned_from_camera, index).astype(np.float32)
        for k, (top, bottom, left, right), (a, b, c), sides, cuts in zip(
            index, bounds.tolist(), inverse, edges, cutting, strict=True
        ):
            if self._straight:
                sx, sy = self._sx[:1, left:right], self._sy[top:bottom, :1]
            else:
                sx, sy = self._sx[top:bottom, left:right], self._sy[top:bottom, left:right]
            part = (slice(top - first, bottom - first), slice(left, right))
            value = a * sx + (b * sy + c)
            closer = value > nearest[part]
            for p, q, r in sides[cuts]:
                closer &= p * sx >= (-r - EDGE) - q * sy
            np.copyto(nearest[part], value, where=closer)
            np.copyto(ids[part], np.int32(k), where=closer)
        return ids

    def _bounds(self, corners: Array, first: int, last: int) -> NDArray[np.intp]:
        """(n, 4): top, bottom, left, right of the sub-samples that facets (n, 4, 3; camera frame) can cover.

        Within the lines ``first`` to ``last``.
        """
        z = corners[:, :, 2]
        ahead = z.min(axis=1) > NEAR_M
        x = corners[:, :, 0] / np.where(ahead[:, None], z, 1.0)
        y = corners[:, :, 1] / np.where(ahead[:, None], z, 1.0)
        columns = self._sx.shape[1]
        bounds = np.stack(
            [
                np.where(ahead, np.searchsorted(self._y_high, y.min(axis=1), "left"), first),
                np.where(ahead, np.searchsorted(self._y_low, y.max(axis=1), "right"), last),
                np.where(ahead, np.searchsorted(self._x_high, x.min(axis=1), "left"), 0),
                np.where(ahead, np.searchsorted(self._x_low, x.max(axis=1), "right"), columns),
            ],
            axis=1,
        )
        bounds[:, :2] = np.clip(bounds[:, :2], first, last)
        return bounds


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
