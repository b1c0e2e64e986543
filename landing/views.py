"""The last frames as the estimators see them: tracks, times and attitudes of each."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from landing.camera import CameraModel
from landing.observation import Observation
from landing.options import TrackingOptions
from landing.tracking import FeatureTracker, TrackPair

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class View:
    """One exposure: its time, ned_from_camera (3, 3) or None, and the trust in rotations measured from it."""

    frame: int
    time_s: float
    ned_from_camera: Array | None
    rotation_std_rad: float


@dataclass(frozen=True, slots=True)
class Baseline:
    """Two exposures and the tracks common to both.

    ``old_from_new`` (3, 3) is the measured rotation, or the identity when ``derotated`` is false;
    ``derotated_old`` (n, 2) the old points turned into the newest camera's axes.
    """

    gap: int
    interval_s: float
    tracks: TrackPair
    old_from_new: Array
    derotated: bool
    rotation_std_rad: float
    derotated_old: Array

    @property
    def flow(self) -> Array:
        """Derotated displacement old to new (n, 2), normalised."""
        return self.tracks.new - self.derotated_old


class Views:
    """Follows the tracks and remembers when and from which attitude each frame was seen."""

    def __init__(self, camera: CameraModel, options: TrackingOptions) -> None:
        self.camera = camera
        self.tracker = FeatureTracker(camera, options)
        self._views: list[View] = []
        self._start = 0

    def step(self, observation: Observation, new_from_previous: Array | None) -> None:
        """Take the next exposure; ``new_from_previous`` as in ``FeatureTracker.step``."""
        ned_from_camera = None
        if observation.ned_from_body is not None:
            ned_from_camera = observation.ned_from_body @ self.camera.body_from_camera
        self.tracker.step(observation.image, new_from_previous)
        view = View(observation.frame, observation.time_s, ned_from_camera, observation.rotation_std_rad)
        self._views.append(view)
        if len(self._views) > FeatureTracker.HISTORY:
            del self._views[0]

    def reset(self) -> None:
        """Forget everything: the next frame starts anew."""
        self.tracker.reset()
        self._views.clear()

    @property
    def newest(self) -> View:
        """The exposure of the last step."""
        return self._views[-1]

    @property
    def longest(self) -> int:
        """The largest gap there is."""
        return min(self.tracker.longest(), len(self._views) - 1)

    def view(self, gap: int) -> View:
        """The exposure ``gap`` frames before the newest."""
        return self._views[-1 - gap]

    def rotation(self, gap: int) -> Array | None:
        """old_from_new (3, 3) over ``gap`` frames, None without both attitudes."""
        old, new = self.view(gap).ned_from_camera, self.newest.ned_from_camera
        return None if old is None or new is None else old.T @ new

    def baseline(self, gap: int) -> Baseline:
        """Newest frame against the one ``gap`` frames older."""
        tracks = self.tracker.pair(gap)
        old, new = self.view(gap), self.newest
        measured = self.rotation(gap)
        rotation = np.eye(3) if measured is None else measured
        std = float(np.hypot(old.rotation_std_rad, new.rotation_std_rad) / np.sqrt(2))
        return Baseline(
            gap,
            new.time_s - old.time_s,
            tracks,
            rotation,
            measured is not None,
            std,
            derotate(tracks.old, rotation),
        )


def derotate(old: Array, old_from_new: Array) -> Array:
    """Old points (n, 2) as a camera in the newest attitude would see them (removes the paper's rotation terms)."""
    q = old @ old_from_new[:2] + old_from_new[2]
    return q[:, :2] / q[:, 2:]
