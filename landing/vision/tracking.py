"""Tracks of Shi-Tomasi corners, followed by pyramidal Lucas-Kanade.

Each frame is matched against one reference image and not against the frame before, so that errors add up from
reference to reference only; the reference is renewed, and corners are added in the empty cells of the grid, when the
view has moved on by a part of a cell. The positions of the last frames stay in a ring, so an estimator can take any
gap between two frames without tracking again.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from landing.options import TrackingOptions
from landing.vision.camera import CameraModel
from landing.vision.corners import Corners
from landing.vision.homography import apply, least_squares
from landing.vision.reference import Reference
from landing.vision.texture import Texture, structure_tensor

Points = NDArray[np.float64]
Image = NDArray[Any]

_CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 0.01)
_VECTOR = 8
"""Pixels of a row that a processor works on together."""
_LEVELS = 3
"""Pyramid levels above the image where no motion is predicted; where it is, the image alone is enough."""
_RETRY_SHARE = 0.2
"""Share of tracks lost at which a prediction counts as wrong."""
_WARP_TRACKS = 20
"""Fewest tracks to warp the reference image by."""
_LEVEL_PX = 31
"""Side of the area whose mean is taken out before tracking."""
_CONTRAST, _MAX_GAIN = 45.0, 4.0
"""Standard deviation of grey that images are stretched to, and the largest stretch."""
_TWIN_PX = 5.0
"""Tracks as near as this are one."""
_RENEW_BELOW, _RENEW_AFTER_FRAMES, _RENEW_AFTER_CELLS = 0.75, 15, 0.3
"""Share of tracks left, age of the reference image and motion, in cells of the grid, at which corners are added."""
_BACK_PX = 0.3
"""A track that does not come back to its start within this is refused (forward-backward error)."""
_GUESS = cv2.OPTFLOW_USE_INITIAL_FLOW | cv2.OPTFLOW_LK_GET_MIN_EIGENVALS
"""Without the second flag OpenCV works out an error of each match that nobody reads: half of its time."""


@dataclass(frozen=True, slots=True)
class TrackPair:
    """The tracks seen in both the newest frame and one ``gap`` frames older.

    ``new`` and ``old`` are (n, 2) normalised image coordinates; ``slots`` (n,) names the tracks. ``whitener``
    (3, n) holds c11, c12, c22 of the triangular C with C^T C the information of a match (1 over normalised
    units squared), from the texture of its patch: along an edge a match has little information.
    """

    gap: int
    slots: NDArray[np.intp]
    new: Points
    old: Points
    whitener: Points


class FeatureTracker:
    """Follows up to ``options.max_features`` corners through a sequence of grey images of one size."""

    HISTORY = 100
    """Frames whose positions are kept."""
    IMAGES = 9
    """Frames whose pictures are kept."""

    def __init__(self, camera: CameraModel, options: TrackingOptions) -> None:
        self.camera, self.options = camera, options
        n = options.max_features
        self.frame = -1
        self.alive = np.zeros(n, bool)
        self.born = np.zeros(n, np.int64)
        self.pixels = np.full((n, 2), np.nan, np.float32)
        self.history = np.full((self.HISTORY, n, 2), np.nan)
        self.pixel_history = np.full((self.HISTORY, n, 2), np.nan, np.float32)
        self.whitener = np.ones((3, n))
        self.refused = 0
        self.images: deque[Image] = deque(maxlen=self.IMAGES)
        """The last pictures as they were matched, the newest first."""
        self.take_mask()
        self._reference = Reference(camera, options)
        self._texture = Texture(camera, options)
        self._corners = Corners(camera, options)
        self._twin_columns = math.ceil(camera.width / _TWIN_PX)
        twin_cells = self._twin_columns * math.ceil(camera.height / _TWIN_PX)
        self._oldest = np.zeros(max(twin_cells, self._corners.cells), np.int64)

    def take_mask(self) -> None:
        """The camera's mask has changed: tracks that it covers end with the next frame."""
        mask = self.camera.mask
        self._barred = self.camera.barred(self.options.window_px // 2)
        """Pixels (height, width) about which a window would hold something else than ground."""
        self._shown = None if mask is None else np.where(mask, 0, 255).astype(np.uint8)

    def reset(self) -> None:
        """Forget all tracks: the next frame starts anew."""
        self.frame = -1
        self.images.clear()
        self._reference.forget()
        self.alive[:] = False

    def step(self, image: Image, new_from_previous: NDArray[np.float64] | None = None) -> None:
        """Follow the tracks into the next frame.

        ``new_from_previous`` (3, 3) predicts normalised homogeneous points of this frame from those of the
        frame before (a homography); a good prediction makes the search short and sure.
        """
        image = self._prepared(image)
        self.images.appendleft(image)
        self.frame += 1
        if self._reference.known:
            self._follow(image, new_from_previous)
        if not self._reference.known or self._changed():
            self._place(image)
        normalised = self.history[self.frame % self.HISTORY]
        normalised[:] = np.nan
        slots = self.alive.nonzero()[0]
        normalised[slots] = self.camera.undistort(self.pixels.take(slots, 0))
        self.pixel_history[self.frame % self.HISTORY] = self.pixels

    def common(self, gap: int) -> NDArray[np.intp]:
        """The slots of the tracks common to the newest frame and the one ``gap`` frames older."""
        return (self.alive & (self.born <= self.frame - gap)).nonzero()[0]

    def pair(self, gap: int) -> TrackPair:
        """The tracks common to the newest frame and the one ``gap`` frames older, as they are in the pictures."""
        slots = self.common(gap)
        new, old = (self.history[(self.frame - k) % self.HISTORY].take(slots, 0) for k in (0, gap))
        return TrackPair(gap, slots, new, old, self.whitener.take(slots, 1))

    def longest(self) -> int:
        """The largest gap that the history holds."""
        return min(self.frame, self.HISTORY - 1)

    def coverage(self) -> float:
        """Share of the grid's cells that hold a track."""
        occupied = self._corners.occupied(self.pixels.compress(self.alive, 0))
        return int(np.count_nonzero(occupied)) / len(occupied)

    def _prepared(self, image: Image) -> Image:
        """The image with its local mean taken out, stretched to a fixed contrast.

        Lucas-Kanade takes brightness as constant. Vignetting and shading stay with the camera while the texture
        moves: a bias that grows with the way. The stretch follows exposure changes and keeps faint texture above
        the steps of eight bits.
        """
        image = self._filled(image, _LEVEL_PX)
        image = cv2.addWeighted(image, 1.0, cv2.blur(image, (_LEVEL_PX, _LEVEL_PX)), -1.0, 128.0)
        mean, spread = cv2.meanStdDev(image, mask=self._shown)
        gain = min(_CONTRAST / max(float(spread[0, 0]), 1e-3), _MAX_GAIN)
        if gain != 1:
            image = cv2.convertScaleAbs(image, alpha=gain, beta=128 - gain * float(mean[0, 0]))
        return image

    def _filled(self, image: Image, side: int) -> Image:
        """The image with the ground's local mean where the mask is: a dark skid must not shade the ground beside it."""
        if self._shown is None:
            return image
        ground = cv2.bitwise_and(image, image, mask=self._shown)
        total, share = (cv2.blur(part, (side, side)).astype(np.float32) for part in (ground, self._shown))
        return np.where(self._shown > 0, image, total * 255 / np.maximum(share, 1.0)).astype(np.uint8)

    def _follow(self, image: Image, new_from_previous: NDArray[np.float64] | None) -> None:
        slots = self.alive.nonzero()[0]
        if not len(slots):
            return
        reference, last = self._reference, self.pixels.take(slots, 0)
        start = reference.pixels.take(slots, 0)
        new_from_reference = self._from_reference(slots, new_from_previous)
        if new_from_reference is None:
            found, good, inside = self._match(reference.image, image, start, last, _LEVELS)
        else:
            seen = self.history[reference.frame % self.HISTORY].take(slots, 0)
            there = self.camera.project(apply(new_from_reference, seen)).astype(np.float32)
            like = reference.seen_from(slots, seen, there, new_from_reference)
            found, good, inside = self._match(like.image, image, like.pixels, there, 0)
            found = found - like.bias
            if np.count_nonzero(inside > good) > _RETRY_SHARE * len(slots):
                # the prediction was wrong: search as if there were none
                reference.forget_warp()
                found, good, inside = self._match(reference.image, image, start, last, _LEVELS)
        self.refused += int(np.count_nonzero(inside > good))
        self.pixels[slots] = found
        if self._barred is not None:
            good = good.copy()
            column, row = np.rint(found[good]).astype(np.intp).T
            good[good] = ~self._barred[row, column]
        self.alive[slots] = good

    def _from_reference(
        self, slots: NDArray[np.intp], new_from_previous: NDArray[np.float64] | None
    ) -> NDArray[np.float64] | None:
        """Homography to this frame from the reference: what the tracks did so far, then the prediction."""
        if new_from_previous is None or len(slots) < _WARP_TRACKS:
            return None
        if self._reference.frame == self.frame - 1:
            return new_from_previous
        seen = self.history[self._reference.frame % self.HISTORY].take(slots, 0)
        previous = self.history[(self.frame - 1) % self.HISTORY].take(slots, 0)
        previous_from_reference = least_squares(seen, previous)
        return None if previous_from_reference is None else new_from_previous @ previous_from_reference

    def _match(
        self, reference: Image, image: Image, start: Image, guess: Image, levels: int
    ) -> tuple[Image, NDArray[np.bool_], NDArray[np.bool_]]:
        """Places (n, 2) px of the reference's points in the image, which are good, and which lie inside."""
        o = self.options
        window = (o.window_px, o.window_px)
        found, status, _ = cv2.calcOpticalFlowPyrLK(
            reference, image, start, guess.copy(), None, None, window, levels, _CRITERIA, _GUESS, 1e-4
        )
        # the way back is only compared with a bound: rows of whole vectors are twice as fast
        window = (-(-o.window_px // _VECTOR) * _VECTOR, o.window_px)
        back, status_back, _ = cv2.calcOpticalFlowPyrLK(
            image, reference, found, start.copy(), None, None, window, 0, _CRITERIA, _GUESS, 1e-4
        )
        margin = o.window_px / 2
        x, y = found.T
        inside = (x > margin) & (x < self.camera.width - 1 - margin)
        inside &= y > margin
        inside &= y < self.camera.height - 1 - margin
        good = _larger(back - start) < _BACK_PX
        good &= inside
        good &= np.asarray(status, np.uint8).ravel().view(bool)
        good &= np.asarray(status_back, np.uint8).ravel().view(bool)
        return np.asarray(found), good, inside

    def _changed(self) -> bool:
        """Whether so much of the view is new that corners must be added."""
        count = int(np.count_nonzero(self.alive))
        if not count or count < _RENEW_BELOW * self._reference.count:
            return True
        if self.frame - self._reference.frame >= _RENEW_AFTER_FRAMES:
            return True
        moved = _larger((self.pixels - self._reference.pixels).compress(self.alive, 0))
        moved.partition(count // 2)
        return float(moved[count // 2]) > _RENEW_AFTER_CELLS * self._corners.cell_px

    def _place(self, image: Image) -> None:
        """Take this frame as the reference and put a corner into every cell that has no track."""
        self._drop_twins()
        tensor = structure_tensor(image)
        corners = self._corners.find(tensor, self.pixels.compress(self.alive, 0), self._barred)
        if len(corners) > len(self.alive) - np.count_nonzero(self.alive):
            self._thin_out()
        free = (~self.alive).nonzero()[0][: len(corners)]
        self.pixels[free] = corners[: len(free)]
        self.alive[free] = True
        self.born[free] = self.frame
        slots = self.alive.nonzero()[0]
        self.whitener[:, slots], bias = self._texture.about(tensor, self.pixels.take(slots, 0))
        self._reference.renew(image, self.frame, self.pixels, slots, bias)

    def _thin_out(self) -> None:
        """Keep the oldest track of each cell, to make room where there is none."""
        self._keep_oldest(self._corners.cell_of)

    def _drop_twins(self) -> None:
        """Of tracks that have run into one another keep the oldest."""
        self._keep_oldest(self._twin_cell)

    def _twin_cell(self, pixels: NDArray[np.float32]) -> NDArray[np.int64]:
        place = (pixels / _TWIN_PX).astype(np.int64)
        return np.asarray(place[:, 1] * self._twin_columns + place[:, 0])

    def _keep_oldest(self, cell_of: Callable[[NDArray[np.float32]], NDArray[np.int64]]) -> None:
        """Of the tracks in each cell keep the oldest."""
        slots = self.alive.nonzero()[0]
        slots = slots.take(self.born.take(slots).argsort(kind="stable"))
        cell = cell_of(self.pixels.take(slots, 0))
        # the youngest is written first, the oldest last
        self._oldest[cell[::-1]] = slots[::-1]
        self.alive[slots.compress(self._oldest.take(cell) != slots)] = False


def _larger(way: NDArray[Any]) -> NDArray[Any]:
    """The larger (n,) of the sizes of both components of (n, 2)."""
    size = np.abs(way)
    return np.maximum(size[:, 0], size[:, 1])
