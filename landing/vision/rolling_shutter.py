"""Rolling shutter: places as they are in the picture, and the same points at the frame's time.

Row r of H is exposed readout (r / (H - 1) - 1/2) after the middle row, whose time is the frame's. A point p = (x, y, 1)
seen dt after the middle row was then at

    p + (w x p) dt + omega (n . p) dt

made homogeneous again, with w the camera's rate of turn, omega = V / h its velocity over height and n the plane's
normal, all in the camera's axes: first order in dt.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from landing.rotations import skew
from landing.vision.camera import CameraModel
from landing.vision.homography import RowMoves
from landing.vision.tracking import FeatureTracker

Array = NDArray[np.float64]

UNKNOWN_STD_S = 0.016
"""Doubt about a readout that is not set, about 0, one sigma: common sensors have 0 to 33 ms."""

TURN_STD = 0.01
"""Error of the rate of turn in a frame, one sigma of an axis, rad/s: vibration, noise, the rest of a filter's delay."""

_TURNS = np.stack([skew(axis) for axis in np.eye(3)])
"""Cross products with the axes (3, 3, 3)."""


@dataclass(frozen=True, slots=True)
class Motion:
    """The camera's motion over the plane: omega = V / h (3,) 1/s and the normal n = (-a, -b, 1) (3,).

    ``std`` (3,) 1/s is the standard deviation of omega.
    """

    omega: Array
    normal: Array
    std: Array = field(default_factory=lambda: np.zeros(3))


class Rows:
    """The tracks of the last frames at their frames' times, in the tracker's ring.

    With a global shutter these are the places in the pictures, and nothing is computed. ``known``: the camera's
    readout is set; else ``readout_s`` is what has been found of it so far.
    """

    def __init__(self, camera: CameraModel, tracker: FeatureTracker) -> None:
        self._tracker, self._last_row = tracker, camera.height - 1
        self.known = camera.readout_s is not None
        self.readout_s = camera.readout_s or 0.0
        self.std_s = 0.0 if self.known else UNKNOWN_STD_S
        self._active = not self.known or self.readout_s != 0
        self.ring = np.full_like(tracker.history, np.nan) if self._active else tracker.history
        """Normalised places (HISTORY, slots, 2) at the frames' times."""
        self._velocity = np.zeros((tracker.HISTORY, 3, 3))
        """What moves homogeneous points back to the middle row's time, per second, in every frame."""
        self._motions: list[Motion | None] = [None] * tracker.HISTORY
        self._turn = np.zeros((3, 3))
        self._unseen = 0
        """How many of the newest frames have no motion over the plane yet."""

    def places(self, frame: int) -> Array:
        """Normalised places (slots, 2) of all tracks at a frame's time, NaN where there is no track."""
        return self.ring[frame % self._tracker.HISTORY]

    @property
    def moving(self) -> bool:
        """Whether the newest frame's motion over the plane is known, or of no use."""
        return not self._active or self._unseen == 0

    def step(self, turn_rate: Array | None, motion: Motion | None) -> None:
        """The tracker has taken another frame: ``turn_rate`` (3,) rad/s of the camera, the motion expected."""
        if not self._active:
            return
        self._turn = np.zeros((3, 3)) if turn_rate is None else skew(turn_rate)
        place = self._tracker.frame % self._tracker.HISTORY
        self._velocity[place] = self._turn
        self._motions[place] = motion
        if motion is None:
            self._unseen = min(self._unseen + 1, self._tracker.HISTORY)
        else:
            self._unseen = 0
            self._velocity[place] += np.outer(motion.omega, motion.normal)
        self._move(place)

    def saw(self, motion: Motion) -> None:
        """The newest frame's motion as it was measured; it stands for those before it that have none, too."""
        if not self._active:
            return
        frame, size = self._tracker.frame, self._tracker.HISTORY
        over_plane = np.outer(motion.omega, motion.normal)
        self._velocity[frame % size] = self._turn
        for k in range(max(1, min(self._unseen, frame + 1))):
            place = (frame - k) % size
            self._velocity[place] += over_plane
            self._motions[place] = motion
            self._move(place)
        self._unseen = 0

    def read_out(self, readout_s: float) -> None:
        """Take another readout: all remembered places move."""
        self.readout_s = readout_s
        for place in range(min(self._tracker.frame + 1, self._tracker.HISTORY)):
            self._move(place)

    def moves(self, gap: int, slots: NDArray[np.intp]) -> Array:
        """How the places (n, 2) of ``slots``, ``gap`` frames before the newest, move per second of readout."""
        place = (self._tracker.frame - gap) % self._tracker.HISTORY
        p, moved = self._velocity_of(place)
        return np.asarray((moved[:, :2] - p * moved[:, 2:]).take(slots, 0))

    def errors(self, gap: int, slots: NDArray[np.intp]) -> Array | None:
        """How the places of ``slots``, ``gap`` frames before the newest, move (k, n, 2) with each error of the motion.

        The errors are those of the frame's rate of turn and of its motion over the plane, each of unit variance.
        None: no rows, or no motion.
        """
        place = (self._tracker.frame - gap) % self._tracker.HISTORY
        motion = self._motions[place]
        if not self._active or self.readout_s == 0 or motion is None:
            return None
        p = self._tracker.history[place].take(slots, 0)
        row_s = (self._tracker.pixel_history[place, :, 1].take(slots) / self._last_row - 0.5) * self.readout_s
        homogeneous = np.column_stack((p, np.ones(len(p))))
        depth = homogeneous @ motion.normal
        turned = np.matmul(homogeneous, (_TURNS * TURN_STD).transpose(0, 2, 1))
        over_plane = np.zeros_like(turned)
        for axis, std in enumerate(motion.std.tolist()):
            over_plane[axis, :, axis] = std * depth
        moved = np.concatenate((turned, over_plane)) * row_s[:, None]
        return np.asarray(moved[..., :2] - p * moved[..., 2:])

    def moves_of(self, gap: int) -> RowMoves | None:
        """For warps: the moves (3, 3) over the readout in the newest frame and ``gap`` before it; None: no rows."""
        if not self._active or self.readout_s == 0:
            return None
        newest, size = self._tracker.frame, self._tracker.HISTORY
        here, there = (self._velocity[(newest - k) % size] * self.readout_s for k in (0, gap))
        return here, there

    def _velocity_of(self, place: int) -> tuple[Array, Array]:
        """Normalised places (slots, 2) in a picture, and how homogeneous ones (slots, 3) move per second of readout."""
        tracker, velocity = self._tracker, self._velocity[place]
        p = tracker.history[place]
        share = tracker.pixel_history[place, :, 1] / self._last_row - 0.5
        return p, (p @ velocity[:, :2].T + velocity[:, 2]) * share[:, None]

    def _move(self, place: int) -> None:
        """Put a frame's tracks where they were at its middle row's time."""
        p, moved = self._velocity_of(place)
        moved *= self.readout_s
        np.add(p, moved[:, :2], out=self.ring[place])
        self.ring[place] /= 1.0 + moved[:, 2:]
