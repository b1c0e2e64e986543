"""Procedural textures: seeded, tileable, grey; made of noise, stones, blades, boards and joints."""

import math
from collections.abc import Callable
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.errors import DriverError

Image = NDArray[np.float32]
Rng = np.random.Generator


def _noise(rng: Rng, size: int, exponent: float, low: float = 1.0, stretch: float = 1.0) -> Image:
    """(size, size) periodic noise, mean 0 and deviation 1, amplitude spectrum falling with f^-exponent.

    Frequencies under ``low`` cycles a tile are left out; ``stretch`` draws the structure out along rows.
    """
    white = np.fft.rfft2(rng.standard_normal((size, size), dtype=np.float32))
    fy = np.fft.fftfreq(size, 1 / size)[:, None]
    fx = np.fft.rfftfreq(size, 1 / size)[None, :] * stretch
    f = np.hypot(fx, fy)
    gain = np.where(f >= low, np.maximum(f, 1e-9) ** -exponent, 0.0)
    # Nothing over 0.7 of the sampling limit: a texture that is itself aliased cannot be filtered later.
    gain *= 1 / (1 + (f / (0.35 * size)) ** 8)
    field = np.fft.irfft2(white * gain, s=(size, size)).astype(np.float32)
    return (field - field.mean()) / field.std()


def _cells(rng: Rng, size: int, count: int) -> tuple[Image, NDArray[np.int32]]:
    """Voronoi cells on a torus: (distance in px to the nearest edge; cell number), both (size, size)."""
    points = rng.uniform(0, size, (count, 2))
    pad = size // 4
    canvas = np.ones((size + 2 * pad, size + 2 * pad), dtype=np.uint8)
    number = np.zeros(canvas.shape, dtype=np.int32)
    for i in (-size, 0, size):
        for j in (-size, 0, size):
            at = np.rint(points + np.array([i + pad, j + pad])).astype(int)
            inside = np.all((at >= 0) & (at < canvas.shape[0]), axis=1)
            canvas[at[inside, 0], at[inside, 1]] = 0
            number[at[inside, 0], at[inside, 1]] = np.flatnonzero(inside)
    _, labels = cv2.distanceTransformWithLabels(canvas, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    zero = canvas == 0
    owner = np.zeros(int(labels.max()) + 1, dtype=np.int32)
    owner[labels[zero]] = number[zero]
    cell = owner[labels]
    edge = np.zeros(cell.shape, dtype=np.uint8)
    edge[:-1] |= cell[:-1] != cell[1:]
    edge[:, :-1] |= cell[:, :-1] != cell[:, 1:]
    distance = cv2.distanceTransform(1 - edge, cv2.DIST_L2, 5)
    inner = slice(pad, pad + size)
    return distance[inner, inner].astype(np.float32), cell[inner, inner]


def _smooth(image: Image, sigma: float) -> Image:
    pad = math.ceil(4 * sigma) + 1
    wide = cv2.copyMakeBorder(image, pad, pad, pad, pad, cv2.BORDER_WRAP)
    return np.asarray(cv2.GaussianBlur(wide, (0, 0), sigma), dtype=np.float32)[pad:-pad, pad:-pad]


def _fine(rng: Rng, size: int) -> Image:
    return 128 + 42 * _noise(rng, size, 0.5, low=size / 16)


def _noise_texture(rng: Rng, size: int) -> Image:
    return 128 + 30 * _noise(rng, size, 1.1, low=2) + 18 * _noise(rng, size, 0.3, low=size / 24)


def _gravel(rng: Rng, size: int) -> Image:
    stones, number = _cells(rng, size, 5000)
    shade = rng.normal(0, 34, int(number.max()) + 1).astype(np.float32)
    dome = np.minimum(stones / (0.006 * size), 1.0)
    picture = (115 + shade[number]) * (0.35 + 0.65 * np.sqrt(dome)) + 10 * _noise(rng, size, 0.6, low=8)
    return _smooth(picture.astype(np.float32), 0.7) + 6 * _noise(rng, size, 1.2, low=2)


def _grass(rng: Rng, size: int) -> Image:
    picture = np.full((size, size), 70, dtype=np.float32)
    start = rng.uniform(0, size, (9000, 2))
    length = rng.uniform(0.008, 0.03, 9000) * size
    angle = rng.normal(0.6, 0.9, 9000)
    grey = rng.uniform(45, 190, 9000)
    end = start + length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for a, b, g in zip(start, end, grey, strict=True):
        for i in (-size, 0, size) if min(a[0], b[0]) < 4 or max(a[0], b[0]) > size - 4 else (0,):
            for j in (-size, 0, size) if min(a[1], b[1]) < 4 or max(a[1], b[1]) > size - 4 else (0,):
                p = np.rint(16 * (a + np.array([i, j]))).astype(int).tolist()
                q = np.rint(16 * (b + np.array([i, j]))).astype(int).tolist()
                cv2.line(picture, p, q, float(g), 1, cv2.LINE_8, 4)
    return _smooth(picture, 0.8) + 14 * _noise(rng, size, 1.3, low=2) + 5 * _noise(rng, size, 0.4, low=16)


def _joints(
    size: int, rows: int, columns: int, shift: float, width: float
) -> tuple[Image, NDArray[np.int64]]:
    """Brick-like pattern: (0 in the joint to 1 in the field, number of the brick), both (size, size)."""
    y, x = np.mgrid[0:size, 0:size] / size
    row = np.floor(y * rows).astype(np.int64)
    along = (x * columns + shift * row) % columns
    column = np.floor(along).astype(np.int64)
    dy = np.minimum(y * rows % 1, 1 - y * rows % 1) / rows
    dx = np.minimum(along % 1, 1 - along % 1) / columns
    return np.clip(np.minimum(dx, dy) / width, 0, 1).astype(np.float32), row * columns + column


def _tiles(rng: Rng, size: int) -> Image:
    field, number = _joints(size, 10, 10, 0.0, 0.0025)
    shade = rng.normal(0, 14, int(number.max()) + 1).astype(np.float32)
    stain = 9 * _noise(rng, size, 1.1, low=3) + 5 * _noise(rng, size, 0.3, low=24)
    return _smooth(60 + (90 + shade[number]) * field + stain, 0.7)


def _wood(rng: Rng, size: int) -> Image:
    field, number = _joints(size, 28, 2, 0.77, 0.0012)
    shade = rng.normal(0, 12, int(number.max()) + 1).astype(np.float32)
    grain = 12 * _noise(rng, size, 0.8, low=8, stretch=24) + 4 * _noise(rng, size, 0.5, low=16)
    return _smooth(45 + (85 + shade[number] + grain) * field, 0.6)


def _concrete(rng: Rng, size: int) -> Image:
    picture = 140 + 5 * _noise(rng, size, 1.3, low=2) + 3.5 * _noise(rng, size, 0.4, low=size / 24)
    pores = np.zeros((size, size), dtype=np.float32)
    at = rng.integers(0, size, (700, 2))
    pores[at[:, 0], at[:, 1]] = rng.uniform(150, 700, 700)
    return picture - _smooth(pores, 1.5)


def _asphalt(rng: Rng, size: int) -> Image:
    chips = np.maximum(_noise(rng, size, 0.2, low=size / 16) - 0.8, 0)
    return 80 + 8 * _noise(rng, size, 0.9, low=4) + 28 * chips


def _roof(rng: Rng, size: int) -> Image:
    field, number = _joints(size, 12, 16, 0.5, 0.003)
    shade = rng.normal(0, 16, int(number.max()) + 1).astype(np.float32)
    y = (np.mgrid[0:size, 0:size][0] / size * 12 % 1).astype(np.float32)
    return _smooth(40 + (70 + 35 * y + shade[number]) * field + 8 * _noise(rng, size, 0.7, low=4), 0.7)


def _dark(rng: Rng, size: int) -> Image:
    """What lies in the shade of a pit."""
    return 14 + 2 * _noise(rng, size, 1.0, low=4)


MATERIALS: dict[str, Callable[[Rng, int], Image]] = {
    "noise": _noise_texture,
    "fine": _fine,
    "gravel": _gravel,
    "grass": _grass,
    "tiles": _tiles,
    "wood": _wood,
    "concrete": _concrete,
    "asphalt": _asphalt,
    "roof": _roof,
    "dark": _dark,
}
"""Name -> maker. "fine" holds fine structure only; "concrete" is of low contrast."""


@lru_cache(maxsize=24)
def texture(material: str, seed: int = 1, size: int = 1024) -> Image:
    """(size, size) float32, 0 to 255, that repeats without a seam. ``size`` is a power of two."""
    if material not in MATERIALS:
        raise DriverError(f"there is no material '{material}'; there are {', '.join(MATERIALS)}")
    if size < 64 or size & (size - 1):
        raise DriverError(f"a texture's size must be a power of two of at least 64, got {size}")
    rng = np.random.default_rng([seed, list(MATERIALS).index(material)])
    picture = np.clip(MATERIALS[material](rng, size), 2, 253).astype(np.float32)
    picture.flags.writeable = False
    return picture


def pyramid(picture: Image) -> list[Image]:
    """The picture and its halvings down to 2 x 2, each low-pass filtered on the torus before it is thinned out."""
    # A windowed sinc that cuts at half the sampling limit: little passes that would fold back.
    taps = np.arange(-5.5, 6) / 2
    kernel = np.sinc(taps) * np.cos(np.pi * taps / 6.5) ** 2
    kernel = (kernel / kernel.sum()).astype(np.float64)
    levels = [picture]
    while levels[-1].shape[0] > 2:
        wide = np.pad(levels[-1], 6, mode="wrap")
        soft = cv2.sepFilter2D(wide, cv2.CV_32F, kernel, kernel, anchor=(5, 5))
        # The even kernel sits between samples 2i and 2i + 1: the middle of the new, twice as large texel.
        size = levels[-1].shape[0]
        levels.append(np.ascontiguousarray(soft[6 : 6 + size : 2, 6 : 6 + size : 2]))
    return levels
