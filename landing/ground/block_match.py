"""Motion of blocks of a picture against another, by one step of least squares along the parallax.

The error of each follows from the texture and the noise of the two pictures themselves: the gradient energy that they
share is texture, the rest is noise. What is matched is a window about the block, so that beside an edge the block
moves as whatever in the window has texture. Where a part of it shows none of its own, nothing is known of that part.
"""

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Image = NDArray[Any]

BLOCK = 8
"""Side of a block, px."""
PART = BLOCK // 2
"""Side of a part of it, px, that is known by its own texture."""
SUPPORT = 2 * BLOCK
"""Side of the window that a block's match is taken over, px."""
STEP_PX = 1.0
"""Longest last step of a match, and largest disagreement of its two ways; beyond it the match is refused."""
_INDEPENDENT = 0.25
"""Share of a window's pixels whose noise counts as independent: interpolation and compression spread it."""
_SOBEL_NOISE = 12 / 64
"""Variance of a Sobel derivative (weights over eight) of noise of variance one."""
_SIGNIFICANT = 3.0
"""Standard errors by which the common gradient energy of two pictures must exceed that of noise alone."""
_LOCKING_PX = 0.04
"""Error of a match that no texture helps against."""
_TAPER = np.array((0.25, 0.5, 0.25), np.float32)


@dataclass(frozen=True, slots=True)
class Match:
    """Motion along and across the parallax (n,) px with its standard deviations; whether the search has ended.

    Of the blocks' parts (rows, columns): ``seen``, those with texture of their own beyond the noise of their window;
    ``bare``, those with none beyond the noise of the whole picture; ``aside_px`` (rows, columns, 2), where in the part
    its texture is, from its middle.
    """

    along_px: Array
    std_px: Array
    across_px: Array
    across_std_px: Array
    converged: NDArray[np.bool_]
    seen: NDArray[np.bool_]
    bare: NDArray[np.bool_]
    aside_px: Array


def match(new: Image, aligned: Image, flow: Array, along: Array) -> Match:
    """One step of least squares from the flow (n, 2) px on, bound to the parallax ``along`` (n, 2).

    A difference in brightness that a whole window shares, by exposure or shading, is fitted with it: what counts is
    how gradients and differences vary within the window.
    """
    first, second = (cv2.spatialGradient(image) for image in (new, aligned))
    residual = cv2.subtract(aligned, new, dtype=cv2.CV_32F)
    mean_x, mean_y = (
        cv2.addWeighted(a, 1 / 16, b, 1 / 16, 0.0, dtype=cv2.CV_32F)
        for a, b in zip(first, second, strict=True)
    )

    def common(a: int, b: int) -> Image:
        # of both pictures: what is noise in one is not in the other
        return cv2.multiply(first[a], second[b], scale=1 / 64, dtype=cv2.CV_32F)

    in_x, in_y = common(0, 0), common(1, 1)
    energy = cv2.add(in_x, in_y)
    own = _means(energy, PART)
    # means of the derivatives (weights over eight) and of the difference
    mean = [[_windows(g) / 8 for g in gradient] for gradient in (first, second)]
    both = [0.5 * (a + b) for a, b in zip(*mean, strict=True)]
    offset = _windows(residual)
    xx, yy = (_windows(g) - mean[0][k] * mean[1][k] for k, g in enumerate((in_x, in_y)))
    xy = _windows(cv2.addWeighted(common(0, 1), 0.5, common(1, 0), 0.5, 0.0))
    xy -= 0.5 * (mean[0][0] * mean[1][1] + mean[0][1] * mean[1][0])
    right_x, right_y = (
        _windows(cv2.multiply(g, residual)) - both[k] * offset for k, g in enumerate((mean_x, mean_y))
    )
    square = _windows(cv2.multiply(residual, residual)) - offset * offset
    ux, uy = along.T
    texture = ux * ux * xx + 2 * ux * uy * xy + uy * uy * yy
    cross = (uy * uy - ux * ux) * xy + ux * uy * (xx - yy)
    other = uy * uy * xx - 2 * ux * uy * xy + ux * ux * yy
    # across is (uy, -ux)
    right, right_other = ux * right_x + uy * right_y, uy * right_x - ux * right_y
    flow_along, flow_across = (flow * along).sum(axis=1), uy * flow[:, 0] - ux * flow[:, 1]
    count = _INDEPENDENT * SUPPORT**2
    with np.errstate(divide="ignore", invalid="ignore"):
        step = (cross * flow_across - right) / texture
        explained = np.clip(right * right / texture, 0.0, 0.5 * square)
        noise = np.maximum(square - explained, 0.1) / 2
        doubt = _SIGNIFICANT * _SOBEL_NOISE * noise / math.sqrt(count)
        std = np.sqrt(2 * noise / (count * np.maximum(texture - doubt, 1e-9)) + _LOCKING_PX**2)
        # what of a motion across the parallax the texture shows apart from one along it
        free = np.maximum(other - cross * cross / np.maximum(texture, 1e-9), 1e-9)
        across = flow_across - (right_other - cross * right / texture) / free
        across_std = np.sqrt(2 * noise / (count * np.maximum(free - doubt, 1e-9)) + _LOCKING_PX**2)
    rows, columns = new.shape[0] // BLOCK, new.shape[1] // BLOCK
    own_doubt = _SIGNIFICANT * _SOBEL_NOISE * math.sqrt(2 / (_INDEPENDENT * PART**2)) * noise
    seen = own > in_parts(own_doubt, rows, columns)
    # a window that does not match is noisy, and not bare for that
    bare = own <= float(np.median(own_doubt))
    converged = (texture > doubt) & (np.abs(step) <= STEP_PX) & np.isfinite(step)
    return Match(
        flow_along + step,
        std,
        np.where(np.isfinite(across), across, 0.0),
        across_std,
        converged,
        seen,
        bare,
        _aside(energy),
    )


def _aside(energy: Image) -> Array:
    """Mean place (rows, columns, 2) px of each part's gradient energy, from the part's middle."""
    energy = np.maximum(energy, np.float32(1e-6))
    whole = _means(energy, PART)
    moments = [_means(cv2.multiply(energy, places), PART) / whole for places in _in_part(*energy.shape)]
    return np.stack(moments, axis=-1).astype(np.float64)


@cache
def _in_part(height: int, width: int) -> tuple[Image, Image]:
    """Places x and y (height, width) px of the pixels of a picture from the middle of their part."""
    step = np.arange(PART, dtype=np.float32) - (PART - 1) / 2
    return np.tile(step, (height, width // PART)), np.tile(step[:, None], (height // PART, width))


def in_parts(of_blocks: NDArray[Any], rows: int, columns: int) -> NDArray[Any]:
    """What is known of blocks (n,), (rows, columns) of them, for each of their parts (2 rows, 2 columns)."""
    return of_blocks.reshape(rows, columns).repeat(2, axis=0).repeat(2, axis=1)


def means_of_blocks(picture: Image) -> Array:
    """Means (n, ...) over blocks."""
    small = _means(picture, BLOCK)
    rows, columns = small.shape[:2]
    return small.reshape(rows * columns, *small.shape[2:]).astype(np.float64)


def _windows(picture: Image) -> Array:
    """Means (n,) over windows of twice a block's side about the blocks."""
    wide = cv2.sepFilter2D(_means(picture, BLOCK), -1, _TAPER, _TAPER, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(wide.ravel(), np.float64)


def _means(picture: Image, side: int) -> Image:
    """Means (rows, columns, ...) over squares of that side, px."""
    rows, columns = picture.shape[0] // side, picture.shape[1] // side
    return cv2.resize(picture, (columns, rows), interpolation=cv2.INTER_AREA)
