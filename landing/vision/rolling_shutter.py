"""Rolling shutter: places as they are in the picture, and the same points at the frame's time.

Row r of H is exposed readout (r / (H - 1) - 1/2) after the middle row, whose time is the frame's. A point p = (x, y, 1)
seen dt after the middle row was then at

    p + (w x p) dt + omega (n . p) dt

made homogeneous again, with w the camera's rate of turn, omega = V / h its velocity over height and n the plane's
normal, all in the camera's axes: first order in dt.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from landing.rotations import skew
from landing.vision.camera import CameraModel
from landing.vision.tracking import FeatureTracker

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Motion:
    """The camera's motion over the plane: omega = V / h (3,) 1/s and the normal n = (-a, -b, 1) (3,)."""

    omega: Array
    normal: Array


class Rows:
    """The tracks of the last frames at their frames' times, in the tracker's ring.

    With a global shutter these are the places in the pictures, and nothing is computed.
    """

    def __init__(self, camera: CameraModel, tracker: FeatureTracker) -> None:
        self._tracker, self._last_row = tracker, camera.height - 1
        self.readout_s = camera.readout_s or 0.0
        self.ring = tracker.history
        """Normalised places (HISTORY, slots, 2) at the frames' times."""
        if self.readout_s:
            self.ring = np.full_like(tracker.history, np.nan)
        self._velocity = np.zeros((tracker.HISTORY, 3, 3))
        """What moves homogeneous points back to the middle row's time, per second, in every frame."""
        self._turn = np.zeros((3, 3))

    def places(self, frame: int) -> Array:
        """Normalised places (slots, 2) of all tracks at a frame's time, NaN where there is no track."""
        return self.ring[frame % self._tracker.HISTORY]

    def step(self, turn_rate: Array | None, motion: Motion | None) -> None:
        """The tracker has taken another frame: ``turn_rate`` (3,) rad/s of the camera, the motion expected."""
        if not self.readout_s:
            return
        self._turn = np.zeros((3, 3)) if turn_rate is None else skew(turn_rate)
        self.saw(motion)

    def saw(self, motion: Motion | None) -> None:
        """The newest frame's motion as it was measured."""
        if not self.readout_s:
            return
        place = self._tracker.frame % self._tracker.HISTORY
        velocity = self._velocity[place]
        velocity[:] = self._turn
        if motion is not None:
            velocity += np.outer(motion.omega, motion.normal)
        self._move(place)

    def _move(self, place: int) -> None:
        """Put a frame's tracks where they were at its middle row's time."""
        tracker = self._tracker
        p = tracker.history[place]
        dt = (tracker.pixel_history[place, :, 1] / self._last_row - 0.5) * self.readout_s
        velocity = self._velocity[place]
        moved = (p @ velocity[:, :2].T + velocity[:, 2]) * dt[:, None]
        np.add(p, moved[:, :2], out=self.ring[place])
        self.ring[place] /= 1.0 + moved[:, 2:]
