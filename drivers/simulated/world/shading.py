"""Light and texture: the grey value that a ray sees on a facet."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.simulated.world.textures import pyramid, texture
from drivers.simulated.world.world import World

Array = NDArray[np.float64]
Image = NDArray[np.float32]

SKY = 205.0
SUN = np.array([0.35, -0.25, -0.90]) / np.linalg.norm([0.35, -0.25, -0.90])
"""Where the light comes from, NED."""
AMBIENT = 0.55
FARTHEST_M = 1e4


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


@dataclass(frozen=True)
class Table:
    """What shading needs of a facet at a pose, a column a facet: ``rays`` (11, n), ``place`` and ``gain`` (n,).

    The rows of ``rays``: 1/Z of a ray (x, y, 1), three; texture u and v a metre of depth, three each; u and v under
    the camera. u and v count repetitions of the texture.
    """

    rays: Image
    place: NDArray[np.int32]
    gain: Image


def joined(tables: list[Table]) -> Table:
    """Tables side by side."""
    return Table(
        np.concatenate([t.rays for t in tables], axis=1),
        np.concatenate([t.place for t in tables]),
        np.concatenate([t.gain for t in tables]),
    )


class Shader:
    """Textures and light of a world."""

    def __init__(self, world: World, texture_size: int, texture_seed: int) -> None:
        self.world = world
        names = sorted({f.material for f in world.facets})
        self._atlas = _atlas(names, texture_seed, texture_size)
        levels = self._atlas.levels
        self._place = np.array([names.index(f.material) * levels for f in world.facets], dtype=np.int32)
        self._repeat = np.array([1.0 / f.texture_m for f in world.facets])
        self._u_axis = np.stack([f.u_axis for f in world.facets])
        self._v_axis = np.stack([f.v_axis for f in world.facets])
        light = AMBIENT + (1 - AMBIENT) * np.maximum(world.normals @ SUN, 0)
        self._gain = (light / (AMBIENT + (1 - AMBIENT) * SUN[2] * -1)).astype(np.float32)

    def table(self, position: Array, ned_from_camera: Array, facets: NDArray[np.int32] | slice) -> Table:
        """The table of the facets (indices) as a camera at a pose sees them."""
        u_axis, v_axis, repeat = self._u_axis[facets], self._v_axis[facets], self._repeat[facets]
        # Textures are anchored at NED's origin, so that neighbouring facets in one plane go on without a seam,
        # and move along with what moves.
        along = position - self.world.shift[facets]
        rays = np.concatenate(
            [
                inverse_depth(self.world, position, ned_from_camera, facets).T,
                repeat * (u_axis @ ned_from_camera).T,
                repeat * (v_axis @ ned_from_camera).T,
                [repeat * (axis * along).sum(axis=1) % 1.0 for axis in (u_axis, v_axis)],
            ]
        )
        return Table(rays.astype(np.float32), self._place[facets], self._gain[facets])

    def shade(self, table: Table, ids: NDArray[np.int32], x: Image, y: Image, pixel: float | Image) -> Image:
        """Grey values (m,) of rays (x, y, 1) on known columns of the table, -1 for the sky.

        ``pixel`` is the width of a sample in x, one for all or (m,).
        """
        only = int(ids[0]) if len(ids) and np.all(ids == ids[0]) else None
        if only == -1:
            return np.full(len(ids), SKY, dtype=np.float32)
        if only is None:
            c = [np.take(row, ids, mode="wrap") for row in table.rays]
            place = np.take(table.place, ids, mode="wrap")
            gain = np.take(table.gain, ids, mode="wrap")
        else:
            c = list(table.rays[:, only])
            place = table.place[only]
            gain = table.gain[only]
        # A facet seen edge-on may be met far off or behind by a ray beside it; kept finite, not shown.
        z = np.maximum(c[0] * x + c[1] * y + c[2], np.float32(1 / FARTHEST_M))
        np.reciprocal(z, out=z)
        u: Image = (c[3] * x + c[4] * y + c[5]) * z
        v: Image = (c[6] * x + c[7] * y + c[8]) * z
        # Derivatives of (u, v) by (x, y), times a sample's width: the footprint in repetitions of the texture.
        step = z * np.asarray(pixel, np.float32)
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


def inverse_depth(
    world: World, position: Array, ned_from_camera: Array, facets: NDArray[np.integer] | slice
) -> Array:
    """(n, 3): 1/Z of a ray (x, y, 1) of the camera on every facet's plane; zeros for planes through the camera."""
    normals = world.normals[facets]
    distance = world.offsets[facets] - normals @ position
    inverse = np.divide(1.0, distance, out=np.zeros_like(distance), where=np.abs(distance) > 1e-12)
    return (normals @ ned_from_camera) * inverse[:, None]
