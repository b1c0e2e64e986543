"""A picture that stands still while the vehicle turns is no picture: a camera, or what lies behind it, hangs.

Drivers refuse pictures that repeat bit for bit; noise, a text overlay or a codec make a standing picture differ. Then
the derotated flow is the vehicle's own rotation, and a plane seems to pass by.
"""

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.settings.settings import HealthSettings
from landing.vision.camera import CameraModel

SMALL_PX = 64
"""Pictures are compared at about this width: averaged over so many pixels, noise hardly counts."""

LOOKS = 12
"""Pictures kept of the window."""


@dataclass(frozen=True, slots=True)
class _Look:
    time_s: float
    picture: NDArray[np.float32]
    ned_from_camera: NDArray[np.float64]

    @property
    def axis(self) -> NDArray[np.float64]:
        """The optical axis (3,) in NED."""
        return self.ned_from_camera[:, 2]


class FrozenCamera:
    """Pure: fed with every picture and the attitude at its exposure.

    Two pictures are compared that are up to ``frozen_window_s`` apart, between which the vehicle turned enough to move
    the picture by ``frozen_turn_px``. When they differ by less than ``frozen_share`` of what the turn alone would have
    changed, that is a witness; ``frozen_witnesses`` in a row make the camera frozen, until a picture is new.
    """

    def __init__(self, settings: HealthSettings, camera: CameraModel) -> None:
        self._s = settings
        self._camera = camera
        self._reduction = max(1.0, camera.width / SMALL_PX)
        self._size = (round(camera.width / self._reduction), round(camera.height / self._reduction))
        self._looks: deque[_Look] = deque()
        self._witnesses = 0
        self.frozen = False

    def step(self, time_s: float, image: NDArray[np.uint8], ned_from_body: NDArray[np.float64]) -> bool:
        """Take one picture (height, width) and the attitude (3, 3) at its exposure; whether the camera is frozen."""
        picture = cv2.resize(image, self._size, interpolation=cv2.INTER_AREA).astype(np.float32)
        look = _Look(time_s, picture, ned_from_body @ self._camera.body_from_camera)
        while self._looks and not 0 <= time_s - self._looks[0].time_s <= self._s.frozen_window_s:
            self._looks.popleft()
        then, turn, turn_px = self._furthest(look)
        if self.frozen or turn_px >= self._s.frozen_turn_px:
            still = self._still(then, look, turn, turn_px)
            self._witnesses = self._witnesses + 1 if still else 0
            self.frozen = self._witnesses >= self._s.frozen_witnesses or (self.frozen and still)
        if not self._looks or time_s - self._looks[-1].time_s >= self._s.frozen_window_s / LOOKS:
            self._looks.append(look)
        return self.frozen

    def _furthest(self, now: _Look) -> tuple[_Look, NDArray[np.float64], float]:
        """The look between which and now rotation alone moves the middle of the picture most.

        And how far: (2,) and its length, in pixels of the full image.
        """
        if not self._looks:
            return now, np.zeros(2), 0.0
        axes = np.array([old.axis for old in self._looks]) @ now.ned_from_camera
        turns = self._camera.focal_px * axes[:, :2] / np.maximum(axes[:, 2:], 1e-6)
        lengths2 = (turns * turns).sum(axis=1)
        most = int(lengths2.argmax())
        return self._looks[most], turns[most], float(np.sqrt(lengths2[most]))

    def _still(self, then: _Look, now: _Look, turn: NDArray[np.float64], turn_px: float) -> bool:
        """Whether the picture changed by far less than the turn alone (at least the smallest that counts) would do."""
        if turn_px < self._s.frozen_turn_px:
            turn = np.array([self._s.frozen_turn_px, 0.0])
        moved = cv2.warpAffine(
            now.picture,
            np.hstack([np.eye(2), turn[:, None] / self._reduction]),
            self._size,
            borderMode=cv2.BORDER_REPLICATE,
        )
        expected = float(np.abs(now.picture - moved).mean())
        return float(np.abs(now.picture - then.picture).mean()) < self._s.frozen_share * expected
