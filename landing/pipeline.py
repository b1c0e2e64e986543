"""The whole way from one observation to one estimate of the surface below."""

import math
from collections.abc import Callable
from copy import copy
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from landing.decision.decision import against_flat
from landing.errors import LandingError
from landing.estimate import SurfaceEstimate
from landing.ground.appearance import AppearanceChange
from landing.ground.border import Border
from landing.ground.ground import Ground
from landing.ground.ground_velocity import passage
from landing.ground.roughness import Relief, ReliefMap
from landing.motion.contradictions import Contradictions, velocity_chi2
from landing.motion.fixed_parts import FixedParts, Mask
from landing.motion.views import Views
from landing.observation import Observation
from landing.options import EstimatorOptions, Options
from landing.plane.height import BetterHeight, Height, along_axis, height, of_sources
from landing.plane.map_estimator import MapEstimator
from landing.plane.plane import Plane
from landing.plane.quadratic import QuadraticEstimator
from landing.plane.surface import surface
from landing.plane.time_offset import TimeOffsetFilter
from landing.plane.turn_comparison import TurnComparison
from landing.reasons import Status
from landing.rotations import euler_from_matrix
from landing.track_view import track_view
from landing.vision.camera import CameraModel
from landing.vision.homography import towards
from landing.vision.rolling_shutter import Motion

Array = NDArray[np.float64]

_READOUT_STEP_S = 0.0005
"""Change of what is known of the rows' readout at which the tracks are moved."""
_SLOW, _HIDDEN = 0.2, 0.02
"""Velocity, m/s, below which its ratio to the ventral flow is not used; share of the picture that turns out not to show
the ground from which slow estimates of the motion begin anew."""


class Estimator(Protocol):
    """A method: views in, plane out."""

    def step(self, views: Views) -> Plane:
        """The plane at the newest view."""
        ...

    def read_out(self, change_s: float) -> None:
        """The rows' readout is known to be longer by so much: all views' tracks have been moved."""


ESTIMATORS: dict[str, Callable[[EstimatorOptions, float, int], Estimator]] = {
    "quadratic": QuadraticEstimator,
    "map": MapEstimator,
}
"""Methods by the name that ``estimator.method`` takes, each made from (options, focal_px, capacity)."""


class SurfacePipeline:
    """Observations in, estimates out; deterministic, no clock, no I/O."""

    def __init__(self, camera: CameraModel, options: Options) -> None:
        self.camera = camera = copy(camera)  # its own: parts that are found to stand still join the mask
        self.options = options
        self.views = Views(camera, options.tracking)
        features, window_px = options.tracking.max_features, options.tracking.window_px
        self.estimator = ESTIMATORS[options.estimator.method](options.estimator, camera.focal_px, features)
        self.relief = ReliefMap(options.estimator, camera, features, window_px / 2)
        measured_px = options.ground.baseline * camera.width
        self.border = Border(options.estimator, camera, measured_px)
        self.appearance = AppearanceChange(options.estimator, camera, measured_px)
        self.ground = Ground(options.ground, camera)
        self.better_height = BetterHeight(options.ground.max_scale_std)
        self._given = camera.mask
        self.fixed: FixedParts | None = None
        e = options.estimator
        self.time_offset = TimeOffsetFilter(
            e.time_offset_std_s,
            e.time_offset_drift,
            e.attitude_error_std_rad,
            self.views.rows.readout_s,
            self.views.rows.std_s,
        )
        self.turn_comparison = TurnComparison(e.attitude_error_std_rad)
        self.contradictions = Contradictions()
        self._motion: Motion | None = None
        self._found_height = Height()
        self._border_was_rough = False
        self._last_s = -math.inf

    def step(self, observation: Observation) -> SurfaceEstimate:
        """The surface at this observation. Raises LandingError for an image of another size."""
        image = observation.image
        if image.shape != (self.camera.height, self.camera.width):
            raise LandingError(
                f"frame {observation.frame} is {image.shape[1]} x {image.shape[0]}, the calibration is for"
                f" {self.camera.width} x {self.camera.height}: calibrate for this size"
            )
        if not observation.time_s > self._last_s:
            raise LandingError(
                f"frame {observation.frame} is at {observation.time_s:.6f} s, not after {self._last_s:.6f} s"
            )
        prediction = self._prediction(observation)
        self.views.step(
            observation, None if prediction is None else prediction[0], self._expected(observation)
        )
        self.relief.memory.move(*(prediction or (None, None)))
        passed_s, self._last_s = observation.time_s - self._last_s, observation.time_s
        plane = self.estimator.step(self.views)
        sink = 0.0 if observation.velocity_ned is None else float(observation.velocity_ned[2])
        self.ground.motion.follow(passed_s, lambda: passage(self.views, plane, self.options.estimator), sink)
        confirmed = self.time_offset.confirmed
        self.time_offset.step(self.views, plane)
        if self.time_offset.moved:
            self.ground.forget()
            self.better_height.forget()
            if not confirmed:
                self.contradictions.began_elsewhere()
        self._compare(observation, plane)
        self._apply_readout()
        self._motion = None
        if plane.status == "ok" and math.isfinite(plane.divergence):
            self._motion = Motion(plane.omega, plane.normal, plane.omega_std)
            self.views.rows.saw(self._motion)
        if self.fixed is not None and self.fixed.step(self.views.newest, image, self._motion):
            self._take_mask(self.fixed.mask)
        estimate = self._estimate(observation, plane)
        self.ground.step(self.views, plane, observation, estimate)
        return estimate

    def find_fixed(self, known: Mask | None = None) -> None:
        """Find what stands still in the picture; ``known`` (height, width) is what an earlier flight found."""
        self.fixed = FixedParts(self.camera, known)
        self._take_mask(self.fixed.mask)

    def _take_mask(self, found: Mask) -> None:
        """No track, relief or doubt where the picture does not show the ground."""
        mask = found if self._given is None else self._given | found
        before, self.camera.mask = self.camera.mask, mask if mask.any() else None
        if np.mean(mask if before is None else mask & ~before) > _HIDDEN:
            self.ground.motion.forget()
            self.better_height.forget()
        self.views.tracker.take_mask()
        self.ground.relief.take_mask()
        self.relief.memory.take_mask()
        self.border.barred = self.camera.barred(1)
        self.appearance.take_mask(self.camera)

    def _apply_readout(self) -> None:
        """Take what has been found of the rows' readout, where it is not set."""
        rows, found = self.views.rows, self.time_offset
        if rows.known:
            return
        rows.std_s = found.readout_std_s
        change_s = found.readout_s - rows.readout_s
        if abs(change_s) > _READOUT_STEP_S:
            self.views.read_out(found.readout_s)
            self.estimator.read_out(change_s)

    def _compare(self, observation: Observation, plane: Plane) -> None:
        """The pictures' motion against the gyro's and the autopilot's."""
        rotation, chi2 = (0.0, 0), math.nan
        if self.options.estimator.use_attitude:
            rotation = self.turn_comparison.step(self.views, self.time_offset.std_s, plane)
        ned_from_camera = self.views.newest.ned_from_camera
        if observation.velocity_ned is not None and ned_from_camera is not None and plane.status == "ok":
            velocity = ned_from_camera.T @ observation.velocity_ned
            chi2 = velocity_chi2(velocity, observation.velocity_std, plane.omega, plane.omega_std)
        self._found_height = self._height(observation, plane)
        late = self.time_offset
        ground = self.ground.motion.speed_m_s, self.ground.motion.std_m_s
        self.contradictions.step(
            observation.time_s,
            rotation,
            chi2,
            ground,
            late.late_s,
            late.std_s,
            late.at_bound,
            self._found_height.chi2,
        )
        if set(self.contradictions.failing) - {Status.HEIGHT_CONTRADICTS}:
            late.search()

    def _prediction(self, observation: Observation) -> tuple[Array, Array] | None:
        """This frame's normalised points from the last's: homographies of the last plane and of what is far away."""
        if self._motion is None or not self.views.tracker.frame >= 0 or observation.ned_from_body is None:
            return None
        last = self.views.newest
        if last.ned_from_camera is None:
            return None
        new_from_last = (observation.ned_from_body @ self.camera.body_from_camera).T @ last.ned_from_camera
        omega, normal = self._motion.omega, self._motion.normal
        way = omega * (observation.time_s - last.time_s)
        moved = towards(way.tolist(), normal.tolist())
        return new_from_last @ moved, new_from_last

    def _expected(self, observation: Observation) -> Motion | None:
        """The last motion over the plane in the axes of this exposure, with what the vehicle changed since."""
        last = self._motion
        if last is None or self.views.tracker.frame < 0:
            return None
        newest = self.views.newest
        if observation.ned_from_body is None or newest.ned_from_camera is None:
            return last
        ned_from_camera = observation.ned_from_body @ self.camera.body_from_camera
        last_from_new = newest.ned_from_camera.T @ ned_from_camera
        omega, normal = last.omega @ last_from_new, last.normal @ last_from_new
        if observation.velocity_ned is not None and newest.velocity_ned is not None:
            before, now = newest.velocity_ned @ ned_from_camera, observation.velocity_ned @ ned_from_camera
            square = float(before @ before)
            per_metre = float(omega @ before) / square if square > _SLOW**2 else 0.0
            omega = omega + max(per_metre, 0.0) * (now - before)
        return Motion(omega, normal, last.std)

    def _estimate(self, observation: Observation, plane: Plane) -> SurfaceEstimate:
        o = self.options.estimator
        coverage = self.views.tracker.coverage()
        status = plane.status
        if status == "ok" and coverage < o.min_coverage:
            status = "too_little_texture"
        if self.contradictions.failing:
            status = self.contradictions.failing[0]
        roll = pitch = math.nan
        if observation.ned_from_body is not None:
            roll, pitch, _ = euler_from_matrix(observation.ned_from_body)
        relief_ = self.relief.step(self.views, plane)
        appearance_change: set[int] = set()
        rough_border = suspicious = False
        if relief_ and relief_.roughness <= self.options.decision.max_roughness:
            within, relief_ = relief_, self._with_border(relief_, plane)
            rough_border = relief_ is not within
            suspicious = self._suspicious(relief_)
            appearance_change = self.appearance.step(
                observation.image, self.border.incoming, self.border.moved_px
            )
        unsettled, self._border_was_rough = rough_border and not self._border_was_rough, rough_border
        known: dict[str, Any] = {}
        if math.isfinite(plane.divergence):
            known = {
                "ventral_flow_x": float(plane.omega[0]),
                "ventral_flow_y": float(plane.omega[1]),
                "divergence": plane.divergence,
                "time_to_contact_s": plane.time_to_contact_s,
            }
        if status == "ok":
            known |= self._surface(observation, plane, roll, pitch)
            if relief_:
                known["roughness"], known["roughness_std"] = relief_.roughness, relief_.roughness_std
        estimate = SurfaceEstimate(
            observation.frame,
            observation.time_s,
            status,
            o.method,
            roll_deg=math.degrees(roll),
            pitch_deg=math.degrees(pitch),
            features=int(np.count_nonzero(self.views.tracker.alive)),
            coverage=coverage,
            blind=self.views.tracker.blind(),
            obstacle_points=relief_.obstacle_points if relief_ and status == "ok" else 0,
            unsettled=unsettled,
            suspicious=suspicious,
            appearance_change=bool(appearance_change),
            ground_speed_m_s=self.ground.motion.speed_m_s,
            ground_speed_std_m_s=self.ground.motion.std_m_s,
            tracks=track_view(self.views.tracker, plane, relief_, o.standing_height),
            **known,
        )
        reasons = against_flat(estimate, self.options.decision)
        return replace(estimate, flat=not reasons, against_flat=reasons)

    def _with_border(self, relief_: Relief, plane: Plane) -> Relief:
        """The relief with what stands at the border of the view, looked for only where the rest is even."""
        border_step = self.border.step(self.views, plane)
        if border_step is None:
            return relief_
        if border_step.lasting:
            self.relief.memory.add(border_step.pixels, border_step.height)
        return replace(relief_, roughness=math.sqrt(relief_.roughness**2 + border_step.mean_square))

    def _suspicious(self, relief_: Relief) -> bool:
        """Whether with what may stand at the border it would be too rough."""
        suspect, limit = self.border.suspect, self.options.decision.max_roughness**2
        return suspect is not None and relief_.roughness**2 + suspect.mean_square > limit

    def _surface(self, observation: Observation, plane: Plane, roll: float, pitch: float) -> dict[str, Any]:
        """Fields of the estimate that a plane gives."""
        o, deg = self.options.estimator, math.degrees
        ned_from_camera = self.views.newest.ned_from_camera
        std_a, std_b = (math.sqrt(plane.slope_covariance[k, k]) for k in (0, 1))
        # without the vehicle's attitude taken out, the camera stands for level (the paper's comparison)
        attitude = ned_from_camera if o.use_attitude else self.camera.body_from_camera
        below = surface(
            plane.a,
            plane.b,
            plane.slope_covariance,
            None if ned_from_camera is None else attitude,
            self.camera.body_from_camera,
            roll if o.use_attitude else 0.0,
            pitch if o.use_attitude else 0.0,
            self._attitude_std(observation),
        )
        return {
            "height_m": self._found_height.value_m,
            "height_std_m": self._found_height.std_m,
            "height_source": self._found_height.source,
            "slope_x_deg": deg(math.atan(plane.a)),
            "slope_y_deg": deg(math.atan(plane.b)),
            "slope_x_std_deg": deg(std_a / (1 + plane.a**2)),
            "slope_y_std_deg": deg(std_b / (1 + plane.b**2)),
            "surface_pitch_deg": below.pitch_deg,
            "surface_roll_deg": below.roll_deg,
            "inclination_deg": below.inclination_deg,
            "inclination_std_deg": below.inclination_std_deg,
            "downhill_bearing_deg": below.bearing_deg if below.inclination_deg > 0 else math.nan,
            "inlier_fraction": plane.inlier_fraction,
            "fit_error_px": plane.fit_error * self.camera.focal_px,
        }

    def _attitude_std(self, observation: Observation) -> float:
        """Standard deviation (rad, per axis) of the vehicle's roll and pitch."""
        o, tilt = self.options.estimator, 0.0
        if observation.ned_from_body is not None:
            tilt = math.acos(max(-1.0, min(1.0, float(observation.ned_from_body[2, 2]))))
        return math.hypot(
            math.radians(o.attitude_std_deg), o.attitude_scale_std * tilt, observation.tilt_std_rad
        )

    def _height(self, observation: Observation, plane: Plane) -> Height:
        """The distance to the plane from whatever knows it."""
        o, ned_from_camera = observation, self.views.newest.ned_from_camera
        if plane.status != "ok":
            return Height()
        by_range = along_axis(o.range_m, o.range_std_m, self.camera.body_from_camera[2], plane.normal)
        if o.velocity_ned is None or ned_from_camera is None:
            return of_sources((math.nan, math.nan), by_range, 0.0)
        velocity = ned_from_camera.T @ o.velocity_ned
        limit = self.options.estimator.max_height_std
        ratio = height(velocity, o.velocity_std, plane.omega, plane.omega_std, limit)
        line, slant = self.ground.motion, float(np.linalg.norm(plane.normal))
        by_velocity = self.better_height.step(ratio, (line.distance_m * slant, line.distance_std_m * slant))
        return of_sources(by_velocity, by_range, float(np.linalg.norm(velocity)))
