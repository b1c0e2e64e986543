"""How late a camera's time stamps are: the rotation the pictures show against the one the autopilot measured.

Between two frames the exact plane fit finds the camera's rotation from the tracks alone (the measured rotation only
starts it, with a prior too loose to matter). Shifting the measured rotation in time until both agree gives the offset:
a cross-correlation, weighted by the information of each pair of frames. Its minimum is found below the sampling
by a parabola; leaving out one stretch of the flight after another (jackknife) gives the uncertainty.

In: the samples of a recorded flight, the calibrated camera and the settings. Out: the offset in s with one sigma,
positive when stamps are later than the exposures.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from companion.clocks.lag import jackknife, minimum, robust_costs
from companion.core.sync import ReadyFrame, Synchroniser
from companion.errors import LandslopeError
from companion.settings.settings import Settings
from drivers.samples import Attitude, Sample
from landing.options import Limits
from landing.plane.planefit import FitPrior, fit_plane
from landing.rotations import log_so3, matrix_from_euler
from landing.vision.camera import CameraModel
from landing.vision.tracking import FeatureTracker

Array = NDArray[np.float64]

HALF_FRAME_S = 0.008
"""Half an interval of the fastest usual camera: spans are met to the nearest frame."""


@dataclass(frozen=True, slots=True)
class TimeOffsetOptions:
    """What a measurement of the offset may cost, and when it is refused."""

    span_s: Annotated[float, Limits(0.02, 0.5, "s", "between two frames that are compared")] = 0.1
    every_s: Annotated[float, Limits(0.005, 0.5, "s", "from one comparison to the next")] = 0.05
    search_s: Annotated[float, Limits(0.02, 0.5, "s", "largest offset looked for, both ways")] = 0.25
    step_s: Annotated[float, Limits(0.001, 0.02, "s", "step of the search")] = 0.004
    rotation_std_rad: Annotated[
        float, Limits(0.01, 1, "rad", "how little the measured rotation is believed")
    ] = 0.1
    min_tracks: Annotated[int, Limits(10, 500, "", "tracks that a pair of frames must share")] = 30
    min_pairs: Annotated[int, Limits(20, 10_000, "", "fewest pairs of frames")] = 100
    min_swing_rad_s: Annotated[
        float, Limits(0.01, 5, "rad/s", "smallest standard deviation of the rate of turn, all axes together")
    ] = 0.02
    min_correlation: Annotated[float, Limits(0.1, 1, "", "smallest correlation of both rotations")] = 0.7
    max_std_s: Annotated[float, Limits(0.0005, 0.05, "s", "largest uncertainty of the result")] = 0.005
    blocks: Annotated[int, Limits(4, 100, "", "stretches that are left out one at a time")] = 12


@dataclass(frozen=True, slots=True)
class TimeOffset:
    """How late the stamps are, in seconds, one sigma, and what it rests on.

    ``shifts`` (m,) s and ``cost`` (m,) are the curve whose minimum it is; ``swing_rad_s`` how unevenly it turned.
    """

    offset_s: float
    std_s: float
    correlation: float
    swing_rad_s: float
    pairs: int
    shifts: Array = field(compare=False)
    cost: Array = field(compare=False)


@dataclass(frozen=True, slots=True)
class _Pair:
    """Two frames: boot times in s, and the rotation vector (3,) of old_from_new in the camera with its covariance."""

    old_s: float
    new_s: float
    turn: Array
    information: Array


def measure_time_offset(
    samples: Iterable[Sample], camera: CameraModel, settings: Settings, options: TimeOffsetOptions
) -> TimeOffset:
    """The offset of a flight's samples; raises LandslopeError when the flight has too little information."""
    attitudes, pairs = _observe(samples, camera, settings, options)
    if len(pairs) < options.min_pairs:
        raise LandslopeError(
            f"only {len(pairs)} pairs of frames could be followed, {options.min_pairs} are needed: fly longer, over "
            "ground with texture, in light"
        )
    motion = _Motion(attitudes)
    swing = _swing(motion, pairs)
    if swing < options.min_swing_rad_s:
        raise LandslopeError(
            f"the flight has too little rotation: the rate of turn varies by {swing:.3f} rad/s, "
            f"{options.min_swing_rad_s:g} is needed; rock the vehicle by hand or fly back and forth briskly"
        )
    shifts, terms = _search(motion, pairs, camera.body_from_camera, options)
    offset, at_edge = minimum(shifts, terms.sum(axis=1))
    if at_edge:
        raise LandslopeError(
            f"no agreement within {options.search_s:g} s: is the mount (camera.mount_*_deg) or the calibration wrong?"
        )
    predicted = motion.turns(pairs, offset, camera.body_from_camera)
    correlation = _correlation(np.array([pair.turn for pair in pairs]), predicted)
    if correlation < options.min_correlation:
        raise LandslopeError(
            f"the pictures' rotation and the measured one do not go together (correlation {correlation:.2f}, "
            f"{options.min_correlation:g} is needed): is the mount (camera.mount_*_deg) or the calibration wrong?"
        )
    std = jackknife(shifts, terms, offset, options.blocks)
    if std > options.max_std_s:
        raise LandslopeError(
            f"the offset would be {offset * 1e3:+.1f} ms, but uncertain by {std * 1e3:.1f} ms; more rotation "
            "or a longer flight is needed"
        )
    return TimeOffset(offset, std, correlation, swing, len(pairs), shifts, terms.sum(axis=1))


def _observe(
    samples: Iterable[Sample], camera: CameraModel, settings: Settings, options: TimeOffsetOptions
) -> tuple[list[Attitude], list[_Pair]]:
    """All attitudes, and the rotation between frames that are ``span_s`` apart, stamps taken as they are."""
    synchroniser = Synchroniser(settings, telemetry=True)
    synchroniser.offset_us = 0
    tracker = FeatureTracker(camera, settings.tracking)
    attitudes: list[Attitude] = []
    pairs: list[_Pair] = []
    seen: list[tuple[float, Array]] = []

    def take(frames: list[ReadyFrame]) -> None:
        for ready in frames:
            if isinstance(ready.attitude, str) or ready.boot_us is None:
                tracker.reset()
                seen.clear()
                continue
            body_camera = camera.body_from_camera
            seen.append((ready.boot_us * 1e-6, ready.attitude.ned_from_body @ body_camera))
            tracker.step(ready.frame.image)
            if not pairs or seen[-1][0] - pairs[-1].new_s >= options.every_s - HALF_FRAME_S:
                pair = _pair(tracker, seen, options)
                if pair is not None:
                    pairs.append(pair)

    for sample in samples:
        if isinstance(sample, Attitude):
            attitudes.append(sample)
        ready, notices = synchroniser.feed(sample)
        if any(notice.name == "autopilot_rebooted" for notice in notices):
            raise LandslopeError("the autopilot rebooted in this flight: take another one")
        take(ready)
    take(synchroniser.flush("attitude_late"))
    return attitudes, pairs


def _pair(
    tracker: FeatureTracker, seen: list[tuple[float, Array]], options: TimeOffsetOptions
) -> _Pair | None:
    """The rotation between the newest frame and the one ``span_s`` before it, from the tracks."""
    new_s, ned_from_new = seen[-1]
    gap = next(
        (k for k in range(1, len(seen)) if new_s - seen[-1 - k][0] >= options.span_s - HALF_FRAME_S), 0
    )
    if not gap or gap > tracker.longest():
        return None
    old_s, ned_from_old = seen[-1 - gap]
    tracks = tracker.pair(gap)
    if len(tracks.slots) < options.min_tracks:
        return None
    measured = ned_from_old.T @ ned_from_new
    prior = FitPrior(rotation_std=np.full(3, options.rotation_std_rad))
    fit = fit_plane(tracks.new, tracks.old, measured, tracks.whitener, prior)
    if fit is None or not fit.converged:
        return None
    information: Array = np.linalg.inv(fit.covariance[5:, 5:]).astype(np.float64)
    return _Pair(old_s, new_s, log_so3(fit.old_from_new), information)


class _Motion:
    """The measured attitude at any moment of the flight."""

    def __init__(self, attitudes: list[Attitude]) -> None:
        times, keep = np.unique([a.boot_us * 1e-6 for a in attitudes], return_index=True)
        chosen = [attitudes[k] for k in keep]
        self.times = times
        self.attitude = np.array([matrix_from_euler(a.roll, a.pitch, a.yaw) for a in chosen])
        steps = np.swapaxes(self.attitude[:-1], 1, 2) @ self.attitude[1:]
        self.steps = np.array([log_so3(step) for step in steps])

    def at(self, times: Array) -> Array:
        """ned_from_body (n, 3, 3) at boot times (n,) in s, held at the ends."""
        k = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.steps) - 1)
        share = np.clip((times - self.times[k]) / (self.times[k + 1] - self.times[k]), 0, 1)
        return self.attitude[k] @ _exp(share[:, None] * self.steps[k])

    def turns(self, pairs: list[_Pair], shift_s: float, body_from_camera: Array) -> Array:
        """Rotation vectors (n, 3) of old_from_new in the camera, exposures ``shift_s`` before their stamps."""
        old = self.at(np.array([pair.old_s for pair in pairs]) - shift_s)
        new = self.at(np.array([pair.new_s for pair in pairs]) - shift_s)
        return _log(np.swapaxes(old, 1, 2) @ new) @ body_from_camera


def _search(
    motion: _Motion, pairs: list[_Pair], body_from_camera: Array, options: TimeOffsetOptions
) -> tuple[Array, Array]:
    """Shifts (m,) and the robust cost (m, n) of every pair at every shift."""
    steps = round(options.search_s / options.step_s)
    shifts: Array = np.arange(-steps, steps + 1, dtype=np.float64) * options.step_s
    seen = np.array([pair.turn for pair in pairs])
    information = np.array([pair.information for pair in pairs])
    return shifts, robust_costs(
        lambda shift: seen - motion.turns(pairs, shift, body_from_camera), information, shifts
    )


def _swing(motion: _Motion, pairs: list[_Pair]) -> float:
    """Standard deviation of the measured rate of turn about its mean, rad/s, root of the sum over the axes."""
    span = np.array([pair.new_s - pair.old_s for pair in pairs])
    rates = motion.turns(pairs, 0.0, np.eye(3)) / span[:, None]
    return float(np.sqrt(rates.var(axis=0).sum()))


def _correlation(seen: Array, measured: Array) -> float:
    a, b = seen - np.median(seen, axis=0), measured - np.median(measured, axis=0)
    return float((a * b).sum() / (math.sqrt(float((a * a).sum() * (b * b).sum())) + 1e-12))


def _exp(vectors: Array) -> Array:
    """Rotations (n, 3, 3) of rotation vectors (n, 3) (Rodrigues)."""
    angle = np.linalg.norm(vectors, axis=1)
    safe = np.where(angle > 1e-9, angle, 1.0)
    x, y, z = (vectors / safe[:, None]).T
    zero = np.zeros_like(x)
    k = np.array(((zero, -z, y), (z, zero, -x), (-y, x, zero))).transpose(2, 0, 1)
    sine, versine = np.sin(angle)[:, None, None], (1 - np.cos(angle))[:, None, None]
    return np.eye(3) + sine * k + versine * (k @ k)


def _log(rotations: Array) -> Array:
    """Rotation vectors (n, 3) of rotations (n, 3, 3) well below half a turn."""
    r = rotations
    axis = np.stack((r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]), axis=1) / 2
    sine = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(sine, (np.trace(r, axis1=1, axis2=2) - 1) / 2)
    return axis * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 1.0)[:, None]
