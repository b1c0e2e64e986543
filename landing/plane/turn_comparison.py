"""The rotation that the pictures show over a quarter of a second, against the vehicle's.

An autopilot's level and heading wander by milliradians within a second, whether the vehicle turns or not, which over
the baseline of a plane is as much as a wrong focal length does to a gentle turn. Over a short time they wander little,
and the vehicle turns by many times that. So the rotation is found from the tracks of a short time alone, with next to
no trust in the measured one: a fit with a narrow prior has settled the difference in part by slopes and displacement.
"""

import math

import numpy as np
from numpy.typing import NDArray

from landing.motion.views import Views
from landing.plane.plane import Plane
from landing.plane.planefit import FitPrior, PlaneFit, fit_plane
from landing.rotations import log_so3

Array = NDArray[np.float64]

_SPANS_S = (0.25, 0.1)
"""Between the two frames compared; the shorter one where too few tracks last for the longer."""
_EVERY_S = 0.1
"""From one comparison to the next."""
_TRACKS, _LEAST_TRACKS = 60, 20
"""Tracks that a rotation is fitted to, and fewest."""
_EXPLAINED = 0.6
"""Share of the tracks that a fit from the plane must explain, or it starts from a homography."""
_LOOSE_RAD = 0.1
"""Trust in the measured rotation, one sigma of an axis."""
_LEVEL_RAD, _HEADING_RAD, _WANDERS_S = math.radians(0.4), math.radians(0.8), 8.0
"""Errors of an autopilot's level and heading, one sigma of an axis, and their correlation time, s.

Of an estimator that is not at its best: vibration, a compass near currents, a GPS that wanders."""
_PATCHES = 4.0
"""Places of a view whose relief is independent: neighbours share it. A plane's motion needs as many."""
_LENS_SHARE = 0.03
"""Error of a rotation seen through the lens, as a share of it, one sigma: of focal length, distortion and mount."""


def picture_rotation(views: Views, span_s: float, plane: Plane | None = None) -> tuple[int, PlaneFit] | None:
    """The gap of about ``span_s`` before the newest frame, and the fit of its tracks that all but ignores attitudes.

    ``plane`` at the newest frame is where the fit starts, as far as it explains the tracks: it ends at the same place
    as from a homography of the tracks, which costs four times as much. None with too few tracks, without both
    attitudes, or where the fit does not settle.
    """
    gap = views.reach(span_s)
    slots = views.tracker.common(gap)
    measured = views.rotation(gap)
    if len(slots) < _LEAST_TRACKS or measured is None:
        return None
    tracks = views.over(gap, slots[:: max(1, len(slots) // _TRACKS)])
    loose = FitPrior(rotation_std=np.full(3, _LOOSE_RAD))
    fit = None
    if plane is not None and np.isfinite((*plane.omega, plane.noise)).all():
        interval_s = views.newest.time_s - views.view(gap).time_s
        start = plane.omega * -interval_s, plane.a, plane.b
        # what the plane refused is refused in the first step, which leads from afar: the motion was another one before
        carried = plane.weights(len(views.tracker.alive)).take(tracks.slots), max(plane.noise, 1.0)
        fit = fit_plane(tracks.new, tracks.old, measured, tracks.whitener, loose, start, carried)
    if fit is None or not fit.converged or np.count_nonzero(fit.weight) < _EXPLAINED * len(tracks.new):
        fit = fit_plane(tracks.new, tracks.old, measured, tracks.whitener, loose)
    return None if fit is None or not fit.converged else (gap, fit)


class TurnComparison:
    """Feed it every frame's views; ``step`` gives chi-square and degrees of freedom, ten times a second."""

    def __init__(self, attitude_error_std_rad: float) -> None:
        """``attitude_error_std_rad``: error of an attitude that changes as the vehicle turns, one sigma."""
        self._attitude_error_std_rad = attitude_error_std_rad
        self._last_s = -math.inf

    def step(self, views: Views, late_std_s: float, plane: Plane | None = None) -> tuple[float, int]:
        """Compare the newest rotation, where frames lie ``late_std_s`` off; (0, 0): nothing to compare.

        ``plane`` is that of the newest frame, None: not known.
        """
        newest = views.newest
        if newest.ned_from_camera is None or views.longest < 1:
            return 0.0, 0
        if 0 <= newest.time_s - self._last_s < 0.9 * _EVERY_S:
            return 0.0, 0
        self._last_s = newest.time_s
        for span_s in _SPANS_S:
            seen = picture_rotation(views, span_s, plane)
            if seen is not None and _explains(seen[1]):
                gap, fit = seen
                spread = _uneven(fit) + self._doubt(views, gap, newest.ned_from_camera, late_std_s)
                return float(fit.d @ np.linalg.solve(spread, fit.d)), 3
        return 0.0, 0

    def _doubt(self, views: Views, gap: int, ned_from_camera: Array, late_std_s: float) -> Array:
        """Covariance (3, 3), camera axes, of the measured rotation over ``gap`` frames and of how the lens shows it."""
        newest, old = views.newest, views.view(gap)
        # the change of an error that forgets itself (Ornstein and Uhlenbeck) over the interval
        wandered = 2 * (1 - math.exp(-(newest.time_s - old.time_s) / _WANDERS_S))
        level, heading = wandered * _LEVEL_RAD**2, wandered * _HEADING_RAD**2
        doubt = ned_from_camera.T @ np.diag((level, level, heading)) @ ned_from_camera
        rotation = views.rotation(gap)
        turn = 0.0 if rotation is None else float(np.linalg.norm(log_so3(rotation)))
        all_axes = 2 * self._attitude_error_std_rad**2 + (_LENS_SHARE * turn) ** 2
        doubt += np.diag(all_axes + np.square(views.baseline_std(gap)))
        change = views.turn_change(gap)
        if change is not None:
            late = change[0] * late_std_s
            doubt += np.outer(late, late)
        if newest.turn_rate is not None:
            doubt += np.diag(np.square(newest.turn_rate * views.rows.std_s))
        return np.asarray(doubt, np.float64)


def _explains(fit: PlaneFit) -> bool:
    """Whether a fit speaks of a rotation: close to the ground, at takeoff, matches are so wrong that any one does."""
    return fit.noise < fit.prior.noise_cap and int(np.count_nonzero(fit.weight)) >= _LEAST_TRACKS


def _uneven(fit: PlaneFit) -> Array:
    """Covariance (3, 3) of the rotation that a fit found, where the ground is not one plane.

    What tracks are off beyond the noise of their matches is relief, a roof beside the ground below it: they do not
    average it as they average noise.
    """
    matching = max(fit.noise, 1.0) ** -2
    alike = max(np.count_nonzero(fit.weight) / _PATCHES, 1.0)
    spread: Array = fit.covariance[5:, 5:] * (matching + (1 - matching) * alike)
    return spread
