"""Corners and their tracks: Shi-Tomasi corners spread by a grid, followed by pyramidal Lucas-Kanade.

Each frame is matched against one reference image (not against the frame before), so that errors do not add up
from frame to frame; the reference is renewed when the view has changed too much, and corners are then added in
the cells of the grid that have lost theirs. The positions of the last frames stay in a ring, so an estimator can
take any gap between two frames without tracking again.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from landing.camera import CameraModel
from landing.options import TrackingOptions

Points = NDArray[np.float64]
Image = NDArray[Any]


@dataclass(frozen=True, slots=True)
class TrackPair:
    """The tracks seen in both the newest frame and one ``gap`` frames older.

    ``new`` and ``old`` are (n, 2) normalised image coordinates; ``slots`` (n,) names the tracks. ``whitener``
    (3, n) holds c11, c12, c22 of the triangular C with C^T C the information of a match (1 over normalised
    units squared), from the texture of its patch: along an edge a match tells little.
    """

    gap: int
    slots: NDArray[np.intp]
    new: Points
    old: Points
    whitener: Points


class FeatureTracker:
    """Follows up to ``options.max_features`` corners through a sequence of grey images of one size."""

    HISTORY = 64
    """Frames whose positions are kept."""

    def __init__(self, camera: CameraModel, options: TrackingOptions) -> None:
        self.camera, self.options = camera, options
        n = options.max_features
        self.frame = -1
        self.alive = np.zeros(n, bool)
        self.born = np.zeros(n, np.int64)
        self.pixels = np.full((n, 2), np.nan, np.float32)
        self.history = np.full((self.HISTORY, n, 2), np.nan)
        self.whitener = np.ones((3, n))
        self._reference: Image | None = None
        self._reference_px = np.zeros((n, 2), np.float32)
        self._reference_frame = -1
        self._cell = max(8, round((camera.width * camera.height / (1.15 * n)) ** 0.5))
        self._rows, self._cols = camera.height // self._cell, camera.width // self._cell
        self._top = (camera.height - self._rows * self._cell) // 2
        self._left = (camera.width - self._cols * self._cell) // 2
        self._reference_count = 0
        self.refused = 0

    def reset(self) -> None:
        """Forget all tracks: the next frame starts anew."""
        self.frame, self._reference = -1, None
        self.alive[:] = False

    def step(self, image: Image, new_from_previous: NDArray[np.float64] | None = None) -> None:
        """Follow the tracks into the next frame.

        ``new_from_previous`` (3, 3) predicts normalised homogeneous points of this frame from those of the
        frame before (a homography); a good prediction makes the search short and sure.
        """
        smooth = self._prepared(image)
        self.frame += 1
        if self._reference is None:
            self._renew(smooth)
        else:
            self._follow(smooth, new_from_previous)
            if self._worn_out():
                self._renew(smooth)
        normalised = self.history[self.frame % self.HISTORY]
        normalised[:] = np.nan
        normalised[self.alive] = self.camera.undistort(self.pixels[self.alive])

    def pair(self, gap: int) -> TrackPair:
        """The tracks common to the newest frame and the one ``gap`` frames before it."""
        slots = np.flatnonzero(self.alive & (self.born <= self.frame - gap))
        new = self.history[self.frame % self.HISTORY, slots]
        old = self.history[(self.frame - gap) % self.HISTORY, slots]
        return TrackPair(gap, slots, new, old, self.whitener[:, slots])

    def longest(self) -> int:
        """The largest gap that the history holds."""
        return min(self.frame, self.HISTORY - 1)

    def coverage(self) -> float:
        """Share of the grid's cells that hold a track."""
        return float(self._occupied().sum()) / (self._rows * self._cols)

    def _prepared(self, image: Image) -> Image:
        """The image stretched to a fixed contrast about its mean, then blurred.

        Lucas-Kanade takes brightness as constant: the stretch follows exposure changes. It also keeps faint
        texture above the steps of eight bits.
        """
        o = self.options
        mean, spread = cv2.meanStdDev(image)
        gain = min(o.contrast / max(float(spread[0, 0]), 1e-3), o.max_gain)
        image = cv2.convertScaleAbs(image, alpha=gain, beta=128 - gain * float(mean[0, 0])) if gain != 1 else image
        if o.blur_px > 0:
            image = cv2.GaussianBlur(image, (5, 5), o.blur_px)
        return image

    def _follow(self, image: Image, new_from_previous: NDArray[np.float64] | None) -> None:
        slots = np.flatnonzero(self.alive)
        if not len(slots):
            return
        o = self.options
        start = self._reference_px[slots]
        guess, levels = self.pixels[slots], o.levels_unpredicted
        if new_from_previous is not None:
            previous = self.history[(self.frame - 1) % self.HISTORY, slots]
            p = previous @ new_from_previous[:, :2].T + new_from_previous[:, 2]
            guess = self.camera.project(p[:, :2] / p[:, 2:]).astype(np.float32)
            levels = o.levels
        window = (o.window_px, o.window_px)
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 0.01)
        flags = cv2.OPTFLOW_USE_INITIAL_FLOW
        assert self._reference is not None
        found, status, _ = cv2.calcOpticalFlowPyrLK(
            self._reference, image, start, guess.copy(), None, None, window, levels, criteria, flags, 1e-4
        )
        back, status_back, _ = cv2.calcOpticalFlowPyrLK(
            image, self._reference, found, start.copy(), None, None, window, 0, criteria, flags, 1e-4
        )
        error = np.abs(back - start).max(axis=1)
        margin = o.window_px / 2
        inside = (
            (found > margin) & (found < (self.camera.width - 1 - margin, self.camera.height - 1 - margin))
        ).all(1)
        good = (
            status.ravel().astype(bool) & status_back.ravel().astype(bool) & (error < o.forward_backward_max_px) & inside
        )
        self.refused += int((inside & ~good).sum())
        self.pixels[slots] = found
        self.alive[slots[~good]] = False

    def _worn_out(self) -> bool:
        o = self.options
        slots = np.flatnonzero(self.alive)
        if len(slots) < o.renew_below * self._reference_count:
            return True
        if self.frame - self._reference_frame >= o.renew_after_frames:
            return True
        start, now = self._reference_px[slots], self.pixels[slots]
        moved = np.median(np.abs(now - start), axis=0)
        if float(moved.max()) > o.renew_after_px:
            return True
        # similarity between the patterns: how much they have grown and turned
        a, b = start - start.mean(0), now - now.mean(0)
        spread = float((a * a).sum()) + 1e-9
        growth = float((a * b).sum()) / spread - 1
        turn = float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()) / spread
        return max(abs(growth), abs(turn)) > o.renew_after_growth

    def _occupied(self) -> NDArray[np.bool_]:
        cells = np.zeros((self._rows, self._cols), bool)
        p = self.pixels[self.alive]
        r = ((p[:, 1] - self._top) // self._cell).astype(int).clip(0, self._rows - 1)
        c = ((p[:, 0] - self._left) // self._cell).astype(int).clip(0, self._cols - 1)
        cells[r, c] = True
        return cells

    def _renew(self, image: Image) -> None:
        """Take this frame as the reference and put a corner into every cell that has no track."""
        self._reference, self._reference_frame = image, self.frame
        self._drop_twins()
        o, half_window = self.options, self.options.window_px // 2
        xx, xy, yy = structure_tensor(image, o.window_px)
        strength = (xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
        margin = half_window + 2
        strength[:margin] = strength[-margin:] = 0
        strength[:, :margin] = strength[:, -margin:] = 0
        s, rows, cols = self._cell, self._rows, self._cols
        blocks = strength[self._top : self._top + rows * s, self._left : self._left + cols * s]
        blocks = blocks.reshape(rows, s, cols, s).transpose(0, 2, 1, 3).reshape(rows * cols, s * s)
        best = blocks.argmax(axis=1)
        value = blocks[np.arange(rows * cols), best]
        # the match's standard deviation along the weak direction must be bearable
        limit = (o.grey_noise / (o.window_px * o.corner_max_std_px)) ** 2
        cells = np.flatnonzero((value > limit) & ~self._occupied().ravel())
        cells = cells[np.argsort(-value[cells], kind="stable")]
        free = np.flatnonzero(~self.alive)[: len(cells)]
        cells = cells[: len(free)]
        self.pixels[free, 0] = self._left + (cells % cols) * s + best[cells] % s
        self.pixels[free, 1] = self._top + (cells // cols) * s + best[cells] // s
        self.alive[free] = True
        self.born[free] = self.frame
        slots = np.flatnonzero(self.alive)
        x, y = np.rint(self.pixels[slots]).astype(int).T
        tensor = np.stack((xx[y, x], xy[y, x], yy[y, x])).astype(np.float64)
        self.whitener[:, slots] = self._whitener(tensor)
        self._reference_px[:] = self.pixels
        self._reference_count = len(slots)

    def _whitener(self, tensor: Points) -> Points:
        """c11, c12, c22 (3, n) for mean structure tensors xx, xy, yy (3, n) in grey levels squared per pixel."""
        o = self.options
        xx, xy, yy = tensor * (o.window_px / o.grey_noise) ** 2
        # covariance: grey noise through the texture, and what no texture helps against (deformation, pixel locking)
        floor = o.match_std_px**2
        determinant = np.maximum(xx * yy - xy * xy, 1e-9)
        cxx, cxy, cyy = yy / determinant + floor, -xy / determinant, xx / determinant + floor
        determinant = cxx * cyy - cxy * cxy
        ixx, ixy, iyy = cyy / determinant, -cxy / determinant, cxx / determinant
        c11 = np.sqrt(ixx)
        c12 = ixy / c11
        return np.stack((c11, c12, np.sqrt(np.maximum(iyy - c12 * c12, 1e-12)))) * self.camera.focal_px

    def _drop_twins(self) -> None:
        """Of tracks that have run into one another keep the oldest."""
        slots = np.flatnonzero(self.alive)
        slots = slots[np.argsort(self.born[slots], kind="stable")]
        place = (self.pixels[slots] // self.options.twin_px).astype(np.int64)
        _, first = np.unique(place[:, 0] * 100_000 + place[:, 1], return_index=True)
        twin = np.ones(len(slots), bool)
        twin[first] = False
        self.alive[slots[twin]] = False


def structure_tensor(image: Image, window_px: int) -> tuple[Image, Image, Image]:
    """Mean of gx^2, gx gy and gy^2 over a window, grey levels squared per pixel squared (Shi and Tomasi)."""
    gx = cv2.Sobel(image, cv2.CV_32F, 1, 0, ksize=3, scale=0.125)
    gy = cv2.Sobel(image, cv2.CV_32F, 0, 1, ksize=3, scale=0.125)
    size = (window_px, window_px)
    return (
        cv2.boxFilter(cv2.multiply(gx, gx), -1, size),
        cv2.boxFilter(cv2.multiply(gx, gy), -1, size),
        cv2.boxFilter(cv2.multiply(gy, gy), -1, size),
    )
