"""The last frames as the estimators see them: tracks, times and attitudes of each."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from landing.observation import Observation
from landing.options import TrackingOptions
from landing.rotations import exp_so3
from landing.vision.camera import CameraModel
from landing.vision.lens_doubt import LensDoubt
from landing.vision.rolling_shutter import Motion, Rows
from landing.vision.tracking import FeatureTracker, TrackPair

Array = NDArray[np.float64]


_GAPS = np.array((1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 17, 20, 24, 29, 35, 42, 50, 60, 72, 86), np.intp)
"""Baselines looked at, in frames."""
_LATE_STEP_S = 0.002
"""Change of the lateness at which the attitudes of earlier frames are put right."""
_LATE_ANEW_S = 0.02
"""Change of the lateness at which they are given up: the rate of turn then does not carry them so far."""


@dataclass(frozen=True, slots=True)
class View:
    """One exposure: its time, ned_from_camera (3, 3) or None, the trust in rotations measured from it, the vehicle's
    velocity (3,) m/s NED or None with its age and noise, the camera's rate of turn (3,) rad/s about its own axes or
    None, the lateness that the attitude allows for, the velocity's slow error over the assumed one, and how far the
    attitude wanders (3,) in rad per root second, about the camera's axes, or None."""

    frame: int
    time_s: float
    ned_from_camera: Array | None
    rotation_std_rad: float
    velocity_ned: Array | None = None
    velocity_age_s: float = 0.0
    velocity_noise: float = 0.0
    turn_rate: Array | None = None
    late_s: float = 0.0
    velocity_factor: float = 1.0
    wander: Array | None = None


@dataclass(frozen=True, slots=True)
class Baseline:
    """Two exposures and the tracks common to both.

    ``old_from_new`` (3, 3) is the measured rotation, or the identity when ``derotated`` is false, ``rotation_std_rad``
    (3,) its standard deviation about the camera's axes. ``moves``: how the
    new and the old points (n, 2) move per second of a readout that is not set.
    """

    gap: int
    interval_s: float
    tracks: TrackPair
    old_from_new: Array
    derotated: bool
    rotation_std_rad: Array
    moves: tuple[Array, Array] | None = None

    @property
    def derotated_old(self) -> Array:
        """The old points (n, 2) turned into the newest camera's axes."""
        return derotate(self.tracks.old, self.old_from_new)

    @property
    def flow(self) -> Array:
        """Derotated displacement old to new (n, 2), normalised."""
        return self.tracks.new - self.derotated_old


class Views:
    """Follows the tracks and remembers when and from which attitude each frame was seen."""

    def __init__(self, camera: CameraModel, options: TrackingOptions) -> None:
        self.camera = camera
        self.tracker = FeatureTracker(camera, options)
        self.rows = Rows(camera, self.tracker)
        """The tracks at their frames' times; what is measured from them takes these places."""
        self._lens = LensDoubt(camera)
        self._views: list[View] = []
        slots = len(self.tracker.alive)
        self._rays = np.full((FeatureTracker.HISTORY, 3, slots), np.nan)
        """The tracks of the frames before the newest, turned into the world's axes; in the tracker's ring."""
        self._known = np.zeros(FeatureTracker.HISTORY, bool)
        """Whether the attitude that this takes was known."""
        self._time_s = np.zeros(FeatureTracker.HISTORY)
        self._velocity = np.full((FeatureTracker.HISTORY, 3), np.nan)
        self._velocity_age_s = np.full(FeatureTracker.HISTORY, math.inf)
        """Time, velocity (NED) and its age of every frame, in the tracker's ring."""
        self._late_s = 0.0
        self.corrected = False
        """Whether the newest exposure put earlier attitudes right."""

    def step(
        self, observation: Observation, new_from_previous: Array | None, motion: Motion | None = None
    ) -> None:
        """Take the next exposure; ``new_from_previous`` as in ``FeatureTracker.step``.

        ``motion`` is what is expected of the camera's motion over the plane, in the axes of this exposure.
        """
        ned_from_camera = None
        if observation.ned_from_body is not None:
            ned_from_camera = observation.ned_from_body @ self.camera.body_from_camera
        self.tracker.step(observation.image, new_from_previous)
        o = observation
        rate = None if o.turn_rate is None else o.turn_rate @ self.camera.body_from_camera
        self.add(
            View(
                o.frame,
                o.time_s,
                ned_from_camera,
                o.rotation_std_rad,
                o.velocity_ned,
                o.velocity_age_s,
                o.velocity_noise,
                rate,
                o.late_s,
                o.velocity_factor,
                _about_camera(o.rotation_wander, self.camera.body_from_camera),
            ),
            motion,
        )

    def add(self, view: View, motion: Motion | None = None) -> None:
        """Take an exposure into which the tracker has followed its tracks."""
        self.corrected = abs(view.late_s - self._late_s) > _LATE_STEP_S
        if self.corrected:
            self._correct(view.late_s)
        if self._views:
            self._turn(self.tracker.frame - 1, self._views[-1].ned_from_camera)
        place = self.tracker.frame % FeatureTracker.HISTORY
        known = view.velocity_ned is not None
        self._time_s[place] = view.time_s
        self._velocity[place] = view.velocity_ned if known else math.nan
        self._velocity_age_s[place] = view.velocity_age_s if known else math.inf
        self.rows.step(view.turn_rate, motion)
        self._views.append(view)
        if len(self._views) > FeatureTracker.HISTORY:
            del self._views[0]

    def _correct(self, late_s: float) -> None:
        """Put the attitudes of earlier frames right for a lateness that is known better now."""
        anew = abs(late_s - self._late_s) > _LATE_ANEW_S
        self._late_s = late_s
        for k, view in enumerate(self._views):
            if view.ned_from_camera is None or view.turn_rate is None:
                continue
            if anew:
                self._views[k] = replace(view, ned_from_camera=None, late_s=late_s)
                self._turn(self.tracker.frame - len(self._views) + k, None)
                continue
            turned = view.ned_from_camera @ exp_so3(view.turn_rate * (view.late_s - late_s))
            self._views[k] = replace(view, ned_from_camera=turned, late_s=late_s)
            self._turn(self.tracker.frame - len(self._views) + k, turned)

    def read_out(self, readout_s: float) -> None:
        """Take another readout of the rows: all tracks of earlier frames move."""
        self.rows.read_out(readout_s)
        for k, view in enumerate(self._views[:-1]):
            self._turn(self.tracker.frame - len(self._views) + 1 + k, view.ned_from_camera)

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
        """old_from_new (3, 3) over the last ``gap`` frames, None without both attitudes."""
        old, new = self.view(gap).ned_from_camera, self.newest.ned_from_camera
        return None if old is None or new is None else old.T @ new

    def measured(self, gap: int) -> bool:
        """Whether the rotation over the last ``gap`` frames is known."""
        return self.newest.ned_from_camera is not None and self.view(gap).ned_from_camera is not None

    def turn_change(self, gap: int) -> tuple[Array, Array] | None:
        """The error (3,) rad of ``rotation(gap)`` for each second of lateness, and what of it is taken out already."""
        rotation, old, new = self.rotation(gap), self.view(gap), self.newest
        if rotation is None or old.turn_rate is None or new.turn_rate is None:
            return None
        before = old.turn_rate @ rotation
        return before - new.turn_rate, before * old.late_s - new.turn_rate * new.late_s

    def stack(self, gaps: NDArray[np.intp], slots: NDArray[np.intp] | None = None) -> tuple[TrackPair, Array]:
        """Tracks and their derotated places (g, n, 2) in the frames ``gaps`` (g,) before the newest.

        Without ``slots`` the tracks common to all of them; else those, NaN where a track is younger.
        """
        longest = int(gaps.max())
        if slots is None:
            slots = self.tracker.common(longest)
        tracks = self.over(longest, slots)
        return tracks, self._derotated(gaps, tracks.slots)

    def over(self, gap: int, slots: NDArray[np.intp]) -> TrackPair:
        """The tracks ``slots`` in the newest frame and in the one ``gap`` frames older, NaN where they are younger."""
        new, old = (self.rows.places(self.tracker.frame - k).take(slots, 0) for k in (0, gap))
        return TrackPair(gap, slots, new, old, self.tracker.whitener.take(slots, 1))

    def reach(self, span_s: float) -> int:
        """The largest gap within ``span_s`` of the newest frame, at least one."""
        views, longest = self._views, self.longest
        oldest_s, gap = views[-1].time_s - span_s, 1
        while gap < longest and views[-2 - gap].time_s >= oldest_s:
            gap += 1
        return gap

    def detour(
        self, gaps: NDArray[np.intp], max_age_s: float, max_acceleration: float
    ) -> tuple[Array, Array] | None:
        """The vehicle's velocity (3,) m/s at the newest frame, and what its changes did (g, 3) m, in camera axes.

        The latter is where the camera was ``gaps`` (g,) frames ago, less where it would have been at the newest
        velocity. None unless the velocity is known at every frame since, at most ``max_age_s`` old and never changing
        by more than ``max_acceleration`` (m/s^2).
        """
        ned_from_camera = self.newest.ned_from_camera
        place = (self.tracker.frame - np.arange(int(gaps.max()) + 1)) % FeatureTracker.HISTORY
        if ned_from_camera is None or self._velocity_age_s.take(place).max() > max_age_s:
            return None
        velocity, time_s = self._velocity.take(place, 0), self._time_s.take(place)
        newer, older = velocity[:-1], velocity[1:]
        interval_s = (time_s[1:] - time_s[:-1])[:, None]
        if (np.abs(older - newer) > max_acceleration * -interval_s).any():
            return None
        # by the trapezium rule
        steps = ((older + newer) / 2 - velocity[0]) * interval_s
        return velocity[0] @ ned_from_camera, steps.cumsum(axis=0).take(gaps - 1, 0) @ ned_from_camera

    def baseline_std(self, gap: int) -> Array:
        """Standard deviation (3,) rad, about the camera's axes, of the measured rotation over ``gap`` frames."""
        newest, old = self.newest, self.view(gap)
        std = np.full(3, math.hypot(old.rotation_std_rad, newest.rotation_std_rad) / math.sqrt(2))
        if newest.wander is None:
            return std
        walked: Array = np.hypot(std, newest.wander * math.sqrt(max(newest.time_s - old.time_s, 0.0)))
        return walked

    def _turn(self, frame: int, turn: Array | None) -> None:
        """Turn the tracks of a frame into the world's axes."""
        place = frame % self.tracker.HISTORY
        self._known[place] = turn is not None
        if turn is not None:
            self._rays[place] = np.dot(turn[:, :2], self.rows.ring[place].T) + turn[:, 2:]

    def _derotated(self, gaps: NDArray[np.intp], slots: NDArray[np.intp]) -> Array:
        """Places (g, n, 2) of tracks in the frames ``gaps`` before the newest, as if taken in its attitude."""
        tracker, newest = self.tracker, self.newest.ned_from_camera
        place = (tracker.frame - gaps) % tracker.HISTORY
        if newest is None or not self._known.take(place).all():
            return self.rows.ring[place[:, None], slots]
        q = np.matmul(newest.T, self._rays.take(place, 0).take(slots, 2))
        q[:, :2] /= q[:, 2:]
        return q[:, :2].transpose(0, 2, 1)

    def profile(self, least: float, share: float, sample: int) -> tuple[NDArray[np.intp], Array, Array]:
        """Gaps (g,), how many tracks each has in common with the newest frame, and their RMS flow after derotation.

        The gaps grow by about a fifth, as far as they keep at least ``least`` tracks and ``share`` of those of gap 1,
        which is always there; the flow is that of about ``sample`` tracks which reach back over all of them.
        """
        tracker = self.tracker
        slots = tracker.alive.nonzero()[0]
        age = tracker.frame - tracker.born.take(slots)
        gaps = _GAPS[self.longest >= _GAPS]
        rising = np.sort(age)
        count = len(age) - rising.searchsorted(gaps).astype(np.float64)
        # it falls with the gap
        reach = max(1, int(np.count_nonzero(count >= max(least, share * count[0]))))
        gaps, count = gaps[:reach], count[:reach]
        slots = slots[age >= gaps[-1]]
        slots = slots[:: max(1, len(slots) // sample)]
        if not len(slots):
            return gaps, count, np.zeros(reach)
        moved = self._derotated(gaps, slots) - self.rows.places(tracker.frame).take(slots, 0)
        moved *= moved
        return gaps, count, np.sqrt((moved[..., 0] + moved[..., 1]).sum(axis=1) / len(slots))

    def baseline(self, gap: int) -> Baseline:
        """The newest frame against the one ``gap`` frames older."""
        tracks = self.over(gap, self.tracker.common(gap))
        measured = self.rotation(gap)
        rotation = np.eye(3) if measured is None else measured
        return Baseline(
            gap,
            self.newest.time_s - self.view(gap).time_s,
            tracks,
            rotation,
            measured is not None,
            self.baseline_std(gap),
            None
            if self.rows.known
            else (self.rows.moves(0, tracks.slots), self.rows.moves(gap, tracks.slots)),
        )

    def lens_moves(self, gap: int, slots: NDArray[np.intp]) -> tuple[Array, Array]:
        """How ``slots`` move (k, n, 2) with each error of the lens, in the newest frame and ``gap`` frames before."""
        tracker = self.tracker
        new, old = (tracker.pixel_history[(tracker.frame - k) % tracker.HISTORY] for k in (0, gap))
        return self._lens.moves(new.take(slots, 0)), self._lens.moves(old.take(slots, 0))

    def row_moves(self, gap: int, slots: NDArray[np.intp]) -> tuple[Array, Array] | None:
        """The same of the errors of the motion within the two frames, which are each frame's own; None: no rows."""
        new, old = self.rows.errors(0, slots), self.rows.errors(gap, slots)
        if new is None or old is None:
            return None
        none = np.zeros_like(new)
        return np.concatenate((new, none)), np.concatenate((none, old))


def derotate(old: Array, old_from_new: Array) -> Array:
    """Old points (n, 2) as a camera in the newest attitude would see them (removes the paper's rotation terms)."""
    q = old @ old_from_new[:2] + old_from_new[2]
    return q[:, :2] / q[:, 2:]


def _about_camera(std: Array | None, body_from_camera: Array) -> Array | None:
    """Standard deviations (3,) about the body's axes as about the camera's; None stays None."""
    if std is None:
        return None
    turned: Array = np.sqrt(np.square(std) @ np.square(body_from_camera))
    return turned
