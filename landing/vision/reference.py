"""The picture that tracks are matched against, as the plane seen last makes it look."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from landing.options import TrackingOptions
from landing.vision.camera import CameraModel
from landing.vision.homography import Warp, apply, stretch

Points = NDArray[np.float64]
Image = NDArray[Any]

_NOTHING = np.empty((0, 0), np.uint8)
_WARP_FROM_PX = 0.3
"""Deformation at a patch's edge from which the picture is warped."""
_STEP_PX = 4.0
_BESIDE = np.array(((_STEP_PX, 0.0), (0.0, _STEP_PX)), np.float32)
"""Steps to the right and down by which a deformation is given."""


@dataclass(frozen=True, slots=True)
class Appearance:
    """A picture to match tracks against, where they are in it (n, 2) px, and the bias (n, 2) px of their matches."""

    image: Image
    pixels: NDArray[np.float32]
    bias: NDArray[np.float32]


class Reference:
    """One frame's picture with the tracks' places in it; ``known`` is false before the first."""

    def __init__(self, camera: CameraModel, options: TrackingOptions) -> None:
        self.camera, self.options = camera, options
        n = options.max_features
        self.image: Image = _NOTHING
        self.frame = -1
        self.count = 0
        """Tracks when it was taken."""
        self.pixels = np.zeros((n, 2), np.float32)
        self._warp = Warp(camera)
        self._warped: tuple[Image, Points] | None = None
        """The picture warped by a homography, and that."""
        self._beside = np.zeros((2, n, 2))
        """Normalised points a step to the right of the tracks, and a step below them."""
        self._bias = np.zeros((2, 4, n))
        """What a deformation does to matches, as in ``Texture.about``."""

    def renew(
        self, image: Image, frame: int, pixels: NDArray[np.float32], slots: NDArray[np.intp], bias: Points
    ) -> None:
        """Take another frame: ``pixels`` of all slots; of the used ones, ``slots`` (n,), the ``bias`` (2, 4, n)."""
        self.image, self.frame, self.count, self._warped = image, frame, len(slots), None
        self.pixels[:] = pixels
        self._bias[..., slots] = bias
        if len(slots):
            beside = (pixels.take(slots, 0) + _BESIDE[:, None]).reshape(-1, 2)
            self._beside[:, slots] = self.camera.undistort(beside).reshape(2, -1, 2)

    @property
    def known(self) -> bool:
        """Whether there is one."""
        return self.image is not _NOTHING

    def forget(self) -> None:
        """There is no reference."""
        self.image, self._warped = _NOTHING, None

    def forget_warp(self) -> None:
        """The homography that it was warped by was wrong."""
        self._warped = None

    def seen_from(
        self, slots: NDArray[np.intp], points: Points, there: NDArray[np.float32], new_from_reference: Points
    ) -> Appearance:
        """What a frame sees of it, for a homography of normalised points.

        ``points`` (n, 2) are the normalised places of the tracks ``slots`` in the reference, ``there`` (n, 2) px where
        the homography takes them. Where patches deform by more than ``_WARP_FROM_PX`` at their edges the picture is
        warped, and a warped one serves as long as they look alike to that.
        """
        beside = self._beside.take(slots, 1).reshape(-1, 2)
        deformed = self._steps(new_from_reference, beside, there)
        limit = _WARP_FROM_PX / (self.options.window_px / 2)
        if stretch(new_from_reference) <= limit:
            image, pixels = self.image, self.pixels.take(slots, 0)
            deformed -= _BESIDE[..., None]
        else:
            image, warp = self._warped_to(new_from_reference, limit)
            pixels = self.camera.project(apply(warp, points)).astype(np.float32)
            deformed -= self._steps(warp, beside, pixels)
        # (x, y of the way, step right or down, n): rows of the deformation
        deformation = deformed.transpose(1, 0, 2).reshape(4, -1)
        bias = (self._bias.take(slots, 2) * deformation).sum(axis=1) / _STEP_PX
        return Appearance(image, pixels, np.asarray(bias.T, np.float32))

    def _warped_to(self, new_from_reference: Points, limit: float) -> tuple[Image, Points]:
        if self._warped is None or stretch(new_from_reference @ np.linalg.inv(self._warped[1])) > limit:
            self._warped = self._warp(self.image, new_from_reference), new_from_reference
        return self._warped

    def _steps(self, homography: Points, beside: Points, there: NDArray[np.float32]) -> Points:
        """Where the steps to the right and down (2, 2, n) px go, from ``there`` (n, 2)."""
        moved = self.camera.project(apply(homography, beside)).reshape(2, -1, 2) - there
        return np.asarray(moved.transpose(0, 2, 1))
