"""Appearance change: new ground at a side whose brightness differs from the view behind it, not measured yet.

Parallax shows a step only after some pixels of motion, and hardly where it lies in the shade. Its brightness changes
at once.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from landing.ground.border import SIDES
from landing.options import EstimatorOptions
from landing.vision.camera import CameraModel

Image = NDArray[np.uint8]

_OUTER, _INNER = 6, slice(24, 48)
"""Lines along a side: what has just come in, and what is known."""
_DARK = 8.0
"""Grey levels added to both: in the dark a ratio of few levels means nothing."""
_LEARNT, _LARGEST = 0.02, 2.0
"""Share of a frame in what is usual, and the largest change that is learnt from as it is, over what is usual."""
_LEAST_SHOWN = 0.3
"""Share of the lines that must show ground to be compared."""
_FIRST = 8
"""What is assumed at first counts as so many frames."""


class _Usual:
    """How bright one side of the view is against what lies behind it, and how bright it usually is (vignetting)."""

    def __init__(self, axis: int, far: bool, least: float) -> None:
        self._axis, self._far, self._least = axis, far, least
        self._usual = math.nan
        self._scatter = 2 * least
        self._seen = _FIRST

    def step(self, image: Image, shown: Image | None) -> float:
        """How unusual a picture is, over what is usual (one: as usual); ``shown`` is zero where no ground can be."""
        outer, inner = (self._brightness(image, shown, part) for part in (slice(_OUTER), _INNER))
        if outer is None or inner is None:
            return 0.0
        now = math.log((outer + _DARK) / (inner + _DARK))
        if math.isnan(self._usual):
            self._usual = now
        away = (now - self._usual) / self._scatter
        learnt = max(_LEARNT, 1 / self._seen)
        self._usual += learnt * max(-_LARGEST, min(_LARGEST, away)) * self._scatter
        if abs(away) <= _LARGEST:
            self._seen += 1
            self._scatter = max(self._least, self._scatter * math.sqrt(1 + learnt * (away * away - 1)))
        return abs(away)

    def take_mask(self, before: Image | None, now: Image | None) -> None:
        """Other pixels count from now on; where they do at this side, what is usual is learnt anew."""
        for part in (slice(_OUTER), _INNER):
            old, new = (None if shown is None else self._lines(shown)[part] for shown in (before, now))
            if not _same(old, new):
                self._usual, self._scatter, self._seen = math.nan, 2 * self._least, _FIRST

    def _brightness(self, image: Image, shown: Image | None, part: slice) -> float | None:
        """Of some lines along the side, what shows ground of them; None where too little does."""
        lines, mask = self._lines(image)[part], None if shown is None else self._lines(shown)[part]
        if mask is not None and cv2.countNonZero(mask) < _LEAST_SHOWN * mask.size:
            return None
        return float(cv2.mean(lines, mask=mask)[0])

    def _lines(self, image: Image) -> Image:
        lines = image if self._axis == 1 else image.T
        return lines[::-1] if self._far else lines


class AppearanceChange:
    """Compares the brightness of sides with that of the view behind them, and with what is usual there."""

    def __init__(self, options: EstimatorOptions, camera: CameraModel, kept_px: float) -> None:
        self._kept_px = kept_px
        self._left_px = dict.fromkeys(range(len(SIDES)), 0.0)
        self._possible = min(camera.width, camera.height) >= 2 * _INNER.stop
        self._sigmas = options.appearance_change_sigmas
        self._sides = [_Usual(axis, far, options.appearance_change / self._sigmas) for axis, far in SIDES]
        self._shown: Image | None = None
        self.take_mask(camera)

    def take_mask(self, camera: CameraModel) -> None:
        """The camera's mask has changed: what is usual is learnt anew where it did."""
        before, self._shown = (
            self._shown,
            None if camera.mask is None else np.where(camera.mask, 0, 255).astype(np.uint8),
        )
        for side in self._sides:
            side.take_mask(before, self._shown)

    def step(self, image: Image, sides: set[int], moved_px: float = math.inf) -> set[int]:
        """The sides (numbers in ``border.SIDES``) where ground looks different from the rest and is not measured yet.

        ``sides`` are those of the raw image (height, width) at which ground has come in, ``moved_px`` how far the view
        has moved since the frame before: what changed stays in doubt until it is far enough in to be measured.
        """
        if not self._possible:
            return set()
        for number in self._left_px:
            self._left_px[number] -= moved_px
        for number in sides:
            if self._sides[number].step(image, self._shown) > self._sigmas:
                self._left_px[number] = self._kept_px
        return {number for number, left_px in self._left_px.items() if left_px > 0}


def _same(a: Image | None, b: Image | None) -> bool:
    """Whether two masks show the same pixels; None shows all."""
    if a is None and b is None:
        return True
    if a is None or b is None:
        return bool(np.all(a if b is None else b))
    return np.array_equal(a, b)
