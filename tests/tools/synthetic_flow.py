"""Exact tracks over a plane by the two-view model, with noise and outliers, and the bound on any estimate from them;
and flights of a camera over points of the ground, as the estimators see them.

Nothing here uses the estimators' own model: a point of the newest frame is put on the surface Z = h + aX + bY,
moved into the older camera's axes and projected there.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from landing.motion.views import View, Views
from landing.options import TrackingOptions
from landing.plane.planefit import FitPrior, PlaneFit, fit_plane
from landing.rotations import exp_so3
from landing.vision.camera import CameraModel

Array = NDArray[np.float64]

FOCAL_PX = 256.0
HALF_VIEW = 0.5
NOISE_PX = 0.1
POINTS = 200
OUTLIER_PX = 8.0
ROTATION_STD = np.array((5e-4, 5e-4, 1.5e-3))
SLOPES_DEG = (0.0, 15.0, 30.0, 45.0, 60.0)
MOTIONS = ("x", "y", "z", "mixed")
TAUS = (50.0, 10.0)
FAILED_SIGMAS = 7.0


@dataclass(frozen=True)
class Tracks:
    """``new`` and ``old`` (n, 2) normalised with noise; ``outlier`` (n,); what they were made from."""

    new: Array
    old: Array
    whitener: Array
    outlier: NDArray[np.bool_]
    measured: Array
    x: Array


def seen_from_older(new: Array, x: Array, measured: Array) -> Array:
    """Old points (n, 2) of new points (n, 2); ``x`` (8,) is t, a, b, d as the fit orders them."""
    depth = 1.0 / (1.0 - x[3] * new[:, 0] - x[4] * new[:, 1])
    on_surface = np.column_stack((new, np.ones(len(new)))) * depth[:, None]
    older = (on_surface - x[:3]) @ (measured @ exp_so3(x[5:])).T
    return older[:, :2] / older[:, 2:]


def whitener(n: int, noise_px: float = NOISE_PX) -> Array:
    """(3, n) of tracks that are equally good in all directions."""
    c = np.full(n, FOCAL_PX / noise_px)
    return np.stack((c, np.zeros(n), c))


def displacement_over_height(motion: str, tau: float) -> Array:
    """t (3,), newest to older, of a camera that moves 1 / tau of its height from the older exposure on."""
    moved = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1), "mixed": (0.6, -0.5, 0.6)}[motion]
    step = np.array(moved, np.float64) / tau
    return -step / (1 - step[2])


def tracks(
    rng: np.random.Generator,
    t: Array,
    a: float,
    b: float,
    outliers: float = 0.0,
    measured: Array | None = None,
    rotation_std: Array = ROTATION_STD,
    points: int = POINTS,
    noise_px: float = NOISE_PX,
) -> Tracks:
    """Tracks of random points; the measured rotation is wrong by a draw from its prior."""
    rotation = np.eye(3) if measured is None else measured
    x = np.concatenate((t, (a, b), rng.standard_normal(3) * rotation_std))
    new = rng.uniform(-HALF_VIEW, HALF_VIEW, (points, 2))
    old = seen_from_older(new, x, rotation) + rng.standard_normal((points, 2)) * noise_px / FOCAL_PX
    outlier = np.zeros(points, bool)
    outlier[: round(outliers * points)] = True
    old[outlier] += rng.uniform(-OUTLIER_PX, OUTLIER_PX, (int(outlier.sum()), 2)) / FOCAL_PX
    return Tracks(new, old, whitener(points, noise_px or NOISE_PX), outlier, rotation, x)


def bound(made: Tracks, prior: FitPrior, noise_px: float = NOISE_PX) -> Array:
    """Cramer-Rao bound (8, 8) with the priors, from the tracks that are no outliers."""
    new, step = made.new[~made.outlier], 1e-6
    columns = []
    for k in range(8):
        up, down = made.x.copy(), made.x.copy()
        up[k] += step
        down[k] -= step
        change = seen_from_older(new, up, made.measured) - seen_from_older(new, down, made.measured)
        columns.append(change.ravel() / (2 * step))
    jacobian = np.array(columns) * FOCAL_PX / noise_px
    known = np.full(8, prior.displacement_std**-2.0)
    known[3:5] = prior.slope_std**-2.0
    known[5:] = prior.rotation_std**-2.0
    return np.linalg.inv(jacobian @ jacobian.T + np.diag(known))


@dataclass(frozen=True)
class Trial:
    """One fit: errors (2,) of (a, b), the bound's and the stated covariance (2, 2) of them; None: no fit."""

    case: tuple[str, float, float, float]
    error: Array
    bound: Array
    stated: Array
    found: bool

    @property
    def failed(self) -> bool:
        """No fit, or a slope further off than chance allows."""
        return not self.found or self.in_bounds > FAILED_SIGMAS

    @property
    def in_bounds(self) -> float:
        """Length of the error in units of the bound."""
        return float(np.sqrt(self.error @ np.linalg.solve(self.bound, self.error)))

    @property
    def normalised(self) -> Array:
        """Errors (2,) over their stated standard deviations."""
        return np.abs(self.error) / np.sqrt(np.diag(self.stated))


def trials(count: int, outliers: float, seed: int, cut: float = 5.0) -> Iterator[Trial]:
    """``count`` fits of every motion, tau and slope."""
    prior = FitPrior(ROTATION_STD)
    rng = np.random.default_rng(seed)
    for motion, tau, slope_deg in itertools.product(MOTIONS, TAUS, SLOPES_DEG):
        slope = np.tan(np.radians(slope_deg))
        for _ in range(count):
            bearing = rng.uniform(0, 2 * np.pi)
            a, b = slope * np.cos(bearing), slope * np.sin(bearing)
            made = tracks(rng, displacement_over_height(motion, tau), a, b, outliers)
            fit = fit_plane(made.new, made.old, made.measured, made.whitener, prior, cut=cut)
            yield trial((motion, tau, slope_deg, outliers), made, fit, prior)


def trial(
    case: tuple[str, float, float, float], made: Tracks, fit: PlaneFit | None, prior: FitPrior
) -> Trial:
    """A fit held against the truth."""
    least = bound(made, prior)[3:5, 3:5]
    if fit is None:
        return Trial(case, np.zeros(2), least, least, False)
    error = np.array((fit.a, fit.b)) - made.x[3:5]
    return Trial(case, error, least, fit.covariance[3:5, 3:5], True)


def efficiency(found: list[Trial]) -> float:
    """Share of the bound reached: RMS of the errors in units of the bound, inverted; 1 is the best there is."""
    square = [t.in_bounds**2 / 2 for t in found if not t.failed]
    return float(1 / np.sqrt(np.mean(square)))


def ground(
    rng: np.random.Generator,
    rise_north: float,
    rise_east: float,
    down_m: float,
    side_m: float,
    points: int = 300,
) -> Array:
    """Points (n, 3) NED of a plane that rises by tangents to north and east and lies ``down_m`` below the origin."""
    place = rng.uniform(-side_m / 2, side_m / 2, (points, 2))
    return np.column_stack((place, down_m - place @ (rise_north, rise_east)))


class Flight:
    """A camera over points of the ground: what ``Views`` holds after each frame, without images."""

    def __init__(self, points_ned: Array, rng: np.random.Generator, noise_px: float = NOISE_PX) -> None:
        self.points, self.rng, self.noise_px = points_ned, rng, noise_px
        self.camera = CameraModel.from_focal(256, 256, FOCAL_PX)
        self.views = Views(self.camera, TrackingOptions(max_features=len(points_ned)))
        self.views.tracker.whitener[:] = whitener(len(points_ned), noise_px or NOISE_PX)
        self._lost = np.zeros(len(points_ned), bool)

    def step(
        self,
        time_s: float,
        position_ned: Array,
        ned_from_body: Array | None = None,
        measured: Array | None = None,
        known: bool = True,
        velocity_ned: Array | None = None,
        velocity_age_s: float = 0.0,
        body_rate: Array | None = None,
        late_s: float = 0.0,
    ) -> Views:
        """The next exposure; ``measured`` is what the autopilot says of the attitude, without it the truth."""
        tracker, camera = self.views.tracker, self.camera
        attitude = np.eye(3) if ned_from_body is None else ned_from_body
        measured = attitude if measured is None else measured
        space = (self.points - position_ned) @ (attitude @ camera.body_from_camera)
        place = space[:, :2] / space[:, 2:]
        pixel = camera.project(place) + self.rng.standard_normal(place.shape) * self.noise_px
        inside = (space[:, 2] > 0) & ((pixel > 0) & (pixel < (camera.width, camera.height))).all(axis=1)
        tracker.frame += 1
        self._lost |= tracker.alive & ~inside
        fresh = inside & ~tracker.alive & ~self._lost
        tracker.born[fresh] = tracker.frame
        tracker.alive[:] = inside & ~self._lost
        tracker.pixels[:] = pixel
        row = tracker.history[tracker.frame % tracker.HISTORY]
        row[:] = np.nan
        row[tracker.alive] = camera.undistort(pixel[tracker.alive])
        turned = measured @ camera.body_from_camera if known else None
        rate = None if body_rate is None else body_rate @ camera.body_from_camera
        self.views.add(
            View(tracker.frame, time_s, turned, 1e-5, velocity_ned, velocity_age_s, 0.0, rate, late_s)
        )
        return self.views


def main() -> None:
    """Print the figures of 84 fits a case, 10,080 in all."""
    for outliers in (0.0, 0.3, 0.5):
        found = list(trials(84, outliers, 1))
        normalised = np.concatenate([t.normalised for t in found if not t.failed])
        median, p95 = np.percentile(normalised, (50, 95))
        failed = [t for t in found if t.failed]
        print(
            f"outliers {outliers:.0%}: efficiency {efficiency(found):.3f}, errors over stated sigma"
            f" {median:.2f} / {p95:.2f}, {len(failed)} failures in {len(found)}"
        )
        for motion, tau in itertools.product(MOTIONS, TAUS):
            part = [t for t in found if t.case[:2] == (motion, tau)]
            print(f"  {motion:5} tau {tau:2.0f}: {efficiency(part):.3f}")
        for bad in failed[:10]:
            print("  failed", bad.case, bad.found, bad.in_bounds, bad.error)


if __name__ == "__main__":
    main()
