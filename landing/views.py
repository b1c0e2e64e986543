"""The last frames as the estimators see them: tracks, times and attitudes of each."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from landing.camera import CameraModel
from landing.observation import Observation
from landing.options import TrackingOptions
from landing.tracking import FeatureTracker, TrackPair

Array = NDArray[np.float64]


_GAPS = np.array((1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 17, 20, 24, 29, 35, 42, 50, 60, 72, 86), np.intp)
"""Baselines looked at, in frames."""


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
        self._attitudes = np.full((FeatureTracker.HISTORY, 3, 3), np.nan)
        """ned_from_camera of the last frames, in the tracker's ring; NaN where unknown."""

    def step(self, observation: Observation, new_from_previous: Array | None) -> None:
        """Take the next exposure; ``new_from_previous`` as in ``FeatureTracker.step``."""
        ned_from_camera = None
        if observation.ned_from_body is not None:
            ned_from_camera = observation.ned_from_body @ self.camera.body_from_camera
        self.tracker.step(observation.image, new_from_previous)
        view = View(observation.frame, observation.time_s, ned_from_camera, observation.rotation_std_rad)
        self._views.append(view)
        self._attitudes[self.tracker.frame % FeatureTracker.HISTORY] = (
            np.nan if ned_from_camera is None else ned_from_camera
        )
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

    def rotation(self, gap: int, before: int = 0) -> Array | None:
        """old_from_new (3, 3) over ``gap`` frames up to ``before`` frames ago, None without both attitudes."""
        old, new = self.view(gap + before).ned_from_camera, self.view(before).ned_from_camera
        return None if old is None or new is None else old.T @ new

    def stack(self, gaps: NDArray[np.intp], slots: NDArray[np.intp] | None = None) -> tuple[TrackPair, Array]:
        """Tracks and their derotated places (g, n, 2) in the frames ``gaps`` (g,) before the newest.

        Without ``slots`` the tracks common to all of them; else those, NaN where a track is younger.
        """
        longest = int(gaps.max())
        if slots is None:
            tracks = self.tracker.pair(longest)
        else:
            tracker = self.tracker
            new, old = (tracker.history[(tracker.frame - k) % tracker.HISTORY, slots] for k in (0, longest))
            tracks = TrackPair(longest, slots, new, old, tracker.whitener[:, slots])
        return tracks, self._derotated(gaps, tracks.slots)

    def baseline_std(self, gap: int) -> float:
        """Standard deviation (rad, per axis) of the measured rotation over ``gap`` frames."""
        return float(np.hypot(self.view(gap).rotation_std_rad, self.newest.rotation_std_rad) / np.sqrt(2))

    def _derotated(self, gaps: NDArray[np.intp], slots: NDArray[np.intp]) -> Array:
        tracker = self.tracker
        place = (tracker.frame - gaps) % tracker.HISTORY
        old = tracker.history[place[:, None], slots]
        newest, attitudes = self.newest.ned_from_camera, self._attitudes[place]
        if newest is None or np.isnan(attitudes[:, 0, 0]).any():
            return old
        turn = attitudes.transpose(0, 2, 1) @ newest
        q = old @ turn[:, :2]
        q += turn[:, 2:]
        return q[..., :2] / q[..., 2:]

    def profile(self, sample: int) -> tuple[NDArray[np.intp], Array, Array]:
        """Gaps (g,), how many tracks each has in common with the newest frame, and their RMS flow after derotation.

        The gaps grow by about a fifth; the flow is measured on about ``sample`` tracks, the oldest first.
        """
        gaps = _GAPS[self.longest >= _GAPS]
        tracker = self.tracker
        slots = np.flatnonzero(tracker.alive)
        born = tracker.born[slots]
        count = (born[:, None] <= tracker.frame - gaps).sum(axis=0).astype(np.float64)
        slots = slots[np.argsort(born, kind="stable")]
        reach = max(int(count[-1]), min(sample, len(slots)))
        slots = slots[:reach][:: max(1, reach // sample)]
        new = tracker.history[tracker.frame % tracker.HISTORY, slots]
        square = ((self._derotated(gaps, slots) - new) ** 2).sum(axis=2)
        known = np.isfinite(square)
        total = np.where(known, square, 0.0).sum(axis=1)
        return gaps, count, np.sqrt(total / np.maximum(known.sum(axis=1), 1))

    def baseline(self, gap: int, before: int = 0) -> Baseline:
        """The frame ``before`` frames ago against the one ``gap`` frames older."""
        tracks = self.tracker.pair(gap, before)
        old, new = self.view(gap + before), self.view(before)
        measured = self.rotation(gap, before)
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
