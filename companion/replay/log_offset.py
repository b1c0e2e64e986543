"""The companion's time of an autopilot's log that says nothing of it: found from the rotation in pictures and log.

Between two frames the exact plane fit finds the camera's rotation from the tracks alone. The log's attitudes give the
rotation of the body over any such span. A search over the whole log finds where both agree, and a finer one refines it
(``companion.clocks.lag``). Two answers from separate stretches of the flight must agree: a place in the log that fits
by chance fits one of them.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from companion.clocks.lag import jackknife, minimum, robust_costs
from companion.errors import LandslopeError
from drivers.samples import Attitude, Frame
from landing.options import TrackingOptions
from landing.plane.planefit import FitPrior, fit_plane
from landing.rotations import log_so3, matrix_from_euler
from landing.vision.camera import CameraModel
from landing.vision.tracking import FeatureTracker

Array = NDArray[np.float64]

SPAN_S, EVERY_S, HALF_FRAME_S = 0.1, 0.05, 0.008
"""Between two frames that are compared, from one comparison to the next, and half an interval of a fast camera."""
ROTATION_STD = 0.3
"""rad; of the turn over a span, about none at all: what the fit starts from."""
MIN_TRACKS, MIN_PAIRS, MAX_PAIRS = 30, 100, 3000
COARSE_PAIRS = 500
STEP_S = 0.02
"""Grid of the search over the whole log, and how many pairs it takes."""
TOLERATED = 10.0
"""Chi-square of three degrees up to which an error counts as noise: what the tracks' covariance leaves out included."""
FINE_S, FINE_STEP_S = 0.06, 0.004
STRETCH_S = 4.0
"""Even and odd stretches of this length must give the same answer."""
AGREE_S = 0.1
BLOCKS = 12
MIN_STD_S, MAX_STD_S = 0.001, 0.01
HELP = "fly back and forth briskly, or replay such a flight with its vehicle.tlog"


@dataclass(frozen=True, slots=True)
class LogOffset:
    """Companion's time minus the log's boot time in microseconds, one sigma in s, and what it rests on."""

    offset_us: int
    std_s: float
    pairs: int


@dataclass(frozen=True, slots=True)
class _Turns:
    """Turns of the body seen in the pictures: times (n,) s since ``zero_us``, vectors (n, 3), information (n, 3, 3)."""

    zero_us: int
    old: Array
    new: Array
    turn: Array
    information: Array


def align_log(
    attitudes: list[Attitude], frames: Iterable[Frame], camera: CameraModel, tracking: TrackingOptions
) -> LogOffset:
    """Where the frames lie in the log; LandslopeError where the flight turns too little, or nothing agrees."""
    turns = _turns(frames, camera, tracking)
    log = _Log(attitudes)
    lag_s = _coarse(log, turns)
    shifts: Array = (
        lag_s
        + np.arange(-round(FINE_S / FINE_STEP_S), round(FINE_S / FINE_STEP_S) + 1, dtype=np.float64)
        * FINE_STEP_S
    )
    terms = robust_costs(
        lambda s: turns.turn - log.turned(turns.old + s, turns.new + s), turns.information, shifts
    )
    lag_s, at_edge = minimum(shifts, terms.sum(axis=1))
    if at_edge:
        raise LandslopeError(f"the pictures' turns fit nowhere in the autopilot's log: {HELP}")
    std_s = max(jackknife(shifts, terms, lag_s, BLOCKS), MIN_STD_S)
    if std_s > MAX_STD_S:
        raise LandslopeError(
            f"the autopilot's log could be aligned by rotation to {std_s * 1e3:.1f} ms only, {MAX_STD_S * 1e3:g} are "
            f"needed: {HELP}"
        )
    offset_us = turns.zero_us - log.zero_us - round(lag_s * 1e6)
    return LogOffset(offset_us, std_s, len(turns.old))


def _turns(frames: Iterable[Frame], camera: CameraModel, tracking: TrackingOptions) -> _Turns:
    tracker = FeatureTracker(camera, tracking)
    prior = FitPrior(rotation_std=np.full(3, ROTATION_STD))
    stamps: list[int] = []
    found: list[tuple[int, int, Array, Array]] = []
    for frame in frames:
        stamps.append(frame.stamp_us)
        tracker.step(frame.image)
        ages = [(stamps[-1] - stamp) * 1e-6 for stamp in stamps[-1 : -2 - tracker.longest() : -1]]
        gap = next((k for k, age in enumerate(ages) if age >= SPAN_S - HALF_FRAME_S), 0)
        last_us = found[-1][1] if found else -math.inf
        if not gap or ages[gap] > 2 * SPAN_S or stamps[-1] - last_us < (EVERY_S - HALF_FRAME_S) * 1e6:
            continue
        tracks = tracker.pair(gap)
        if len(tracks.slots) < MIN_TRACKS:
            continue
        fit = fit_plane(tracks.new, tracks.old, np.eye(3), tracks.whitener, prior)
        if fit is not None and fit.converged:
            covariance = np.asarray(fit.covariance[5:, 5:], np.float64)
            found.append((stamps[-1 - gap], stamps[-1], log_so3(fit.old_from_new), covariance))
        if len(found) == MAX_PAIRS:
            break
    if len(found) < MIN_PAIRS:
        raise LandslopeError(
            f"the autopilot's log says nothing of the companion's time, and only {len(found)} pairs of frames could be "
            f"followed to find it from the rotation, {MIN_PAIRS} are needed: {HELP}"
        )
    turn_to_body = camera.body_from_camera
    zero_us = found[0][0]
    old, new = (np.array([(pair[k] - zero_us) * 1e-6 for pair in found]) for k in (0, 1))
    turn = np.array([turn_to_body @ pair[2] for pair in found])
    information = np.array([np.linalg.inv(turn_to_body @ pair[3] @ turn_to_body.T) for pair in found])
    return _Turns(zero_us, old, new, turn, information)


class _Log:
    """The body's turns by the log, small ones as vectors that add up."""

    def __init__(self, attitudes: list[Attitude]) -> None:
        times, keep = np.unique([attitude.boot_us for attitude in attitudes], return_index=True)
        chosen = [attitudes[k] for k in keep]
        rotations = [matrix_from_euler(a.roll, a.pitch, a.yaw) for a in chosen]
        steps = [log_so3(old.T @ new) for old, new in pairwise(rotations)]
        self.zero_us = int(times[0])
        self.times: Array = (times - times[0]) * 1e-6
        self._sum = np.vstack([np.zeros(3), np.cumsum(np.array(steps).reshape(-1, 3), axis=0)])

    def turned(self, old: Array, new: Array) -> Array:
        """Rotation vectors (n, 3) from times ``old`` to ``new`` (n,) in s since ``zero_us``; none beyond the log."""
        sums = [[np.interp(at, self.times, axis) for axis in self._sum.T] for at in (old, new)]
        return np.subtract(sums[1], sums[0]).T


def _coarse(log: _Log, turns: _Turns) -> float:
    """The time in the log of the pictures' zero, to a step of the grid; two parts of the flight must agree on it.

    Lags at which less than half of the turns lie within the log are not tried.
    """
    middle, end_s = (turns.old + turns.new) / 2, float(log.times[-1])
    lags = np.arange(-float(middle[-1]), end_s, STEP_S)
    within = np.searchsorted(middle, end_s - lags) - np.searchsorted(middle, -lags)
    lags = lags[within >= len(middle) / 2]
    if not len(lags):
        raise LandslopeError(f"the autopilot's log is shorter than half of the pictures' flight; {HELP}")
    chosen = slice(None, None, math.ceil(len(middle) / COARSE_PAIRS))
    old, new, turn = turns.old[chosen], turns.new[chosen], turns.turn[chosen]
    roots = np.linalg.cholesky(turns.information[chosen])
    odd = (old // STRETCH_S) % 2 == 1
    parts = np.empty((len(lags), 2))
    for row, lag in enumerate(lags):
        errors = np.einsum("nij,ni->nj", roots, turn - log.turned(old + lag, new + lag))
        terms = np.log1p((errors**2).sum(axis=1) / TOLERATED)  # Cauchy: a fit that failed has little weight
        parts[row] = terms[odd].sum(), terms[~odd].sum()
    best = [float(lags[k]) for k in parts.argmin(axis=0)]
    if abs(best[0] - best[1]) > AGREE_S:
        raise LandslopeError(
            f"two parts of the flight fit the autopilot's log {abs(best[0] - best[1]):.1f} s apart: the pictures turn "
            f"too little to decide, it is another flight's log, or the mount (camera.mount_*_deg) is wrong; {HELP}"
        )
    return float(lags[parts.sum(axis=1).argmin()])
