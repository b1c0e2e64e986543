"""What a scenario puts into the world: ground, camera and vehicle, and the faults of the camera."""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from companion.simulation.scenario import Fault, Scenario
from drivers.simulated.vehicle.pose_history import PoseHistory
from drivers.simulated.vehicle.sensors import SensorErrors
from drivers.simulated.vehicle.vehicle import Ground, Multirotor, Wind
from drivers.simulated.world.camera import SensorOptions, SimulatedCamera
from drivers.simulated.world.lens import Lens
from drivers.simulated.world.render import Renderer
from drivers.simulated.world.truth import FrameTruth
from drivers.simulated.world.world import World
from landing.vision.camera import CameraModel, body_from_camera

TEXTURE_SIZE = 512


def _to_and_fro(step: int, count: int) -> int:
    """Backwards from the newest picture, then forwards again."""
    place = step % (2 * (count - 1))
    return abs(count - 1 - place)


_REPEATS: dict[str, Callable[[int, int], int]] = {
    "camera_frozen": lambda step, count: -1,
    "camera_looped": lambda step, count: (step - 1) % count,
    "camera_to_and_fro": _to_and_fro,
}
"""Fault -> which of ``count`` pictures is shown as the ``step``-th of it."""


class Scene:
    """All of a scenario's hardware but the autopilot's link. Times are simulated seconds, from 0."""

    def __init__(self, scenario: Scenario, *, threads: bool = True) -> None:
        """``threads`` False: pictures and truth are never asked for at the same time."""
        self.scenario = scenario
        self.world: World = scenario.world()
        w = scenario.wind
        towards = math.radians(w.towards_deg)
        wind = Wind(
            w.speed_m_s * math.cos(towards),
            w.speed_m_s * math.sin(towards),
            w.gust_m_s,
            shake_std=w.shake_rad_s,
        )
        ground: Ground = self.world.height_at
        highest = -float(self.world.vertices[:, :, 2].min())
        self.vehicle = Multirotor(wind=wind, ground=ground, highest_ground=highest, seed=scenario.basics.seed)
        start = scenario.start
        self.heading = math.radians(start.heading_deg)
        """Of the nose at the start, rad."""
        self.vehicle.place(start.north_m, start.east_m, start.height_m or None, self.heading)
        self.lens, self.camera_model = _optics(scenario)
        renderer = Renderer(
            self.world, self.lens, texture_seed=scenario.basics.texture_seed, texture_size=TEXTURE_SIZE
        )
        self.camera = SimulatedCamera(renderer, _sensor(scenario), seed=scenario.basics.seed)
        truth_renderer = renderer
        if threads:
            # A renderer is not safe for threads: the truth may be asked for while a picture is being made.
            truth_renderer = Renderer(
                self.world, self.lens, texture_seed=scenario.basics.texture_seed, texture_size=TEXTURE_SIZE
            )
        self._truth_camera = SimulatedCamera(truth_renderer, _sensor(scenario), seed=scenario.basics.seed)
        self.poses = PoseHistory()
        self.poses.add(self.vehicle)
        loops = [f.loop_s for f in scenario.faults if f.kind in _REPEATS]
        self._seen: deque[NDArray[np.uint8]] = deque(
            maxlen=max(2, *(round(s * scenario.camera.rate_hz) for s in (loops or [0])))
        )
        """The pictures of before a fault that shows them again."""
        self._repeated = 0

    def picture(self, number: int, time_s: float, flown_s: float) -> NDArray[np.uint8] | None:
        """What the camera delivers of the exposure at ``time_s``, ``flown_s`` into the scenario's flight; or None."""
        if self._fault("camera_lost", flown_s):
            return None
        repeats = next((k for k in _REPEATS if self._fault(k, flown_s)), "")
        if repeats and self._seen:
            self._repeated += 1
            return self._seen[_REPEATS[repeats](self._repeated, len(self._seen))]
        self._repeated = 0
        image = self.camera.expose(number, time_s, self.poses.at)
        if self._fault("camera_dark", flown_s):
            image = (image // 64).astype(np.uint8)
        self._seen.append(image)
        if self.scenario.camera.mirrored:
            self._seen[-1] = image = np.ascontiguousarray(image[:, ::-1])
        return image

    def truth(self, number: int, time_s: float) -> FrameTruth:
        """The truth of the exposure at ``time_s``; its time counts from the autopilot's boot."""
        truth = self._truth_camera.truth(number, time_s, self.poses.at)
        return _since_boot(truth, self.scenario.link.since_boot_s)

    def fault(self, kind: str, time_s: float) -> Fault | None:
        """The fault of a kind that is going on, if any."""
        return next((f for f in self.scenario.faults if f.kind == kind and f.active(time_s)), None)

    def _fault(self, kind: str, time_s: float) -> bool:
        return self.fault(kind, time_s) is not None


def sensor_errors(scenario: Scenario) -> SensorErrors:
    """The scenario's sensor errors as the driver takes them."""
    s = scenario.sensors
    return SensorErrors(
        gyro_noise=s.gyro_noise_rad_s,
        gyro_bias=s.gyro_bias_rad_s,
        attitude_error=math.radians(s.attitude_error_deg),
        velocity_noise=s.velocity_noise_m_s,
        velocity_error=s.velocity_error_m_s,
        velocity_lag_s=s.velocity_lag_s,
        velocity_scale=s.velocity_scale,
    )


def _optics(scenario: Scenario) -> tuple[Lens, CameraModel]:
    """The lens, and the camera model that is its exact calibration."""
    c = scenario.camera
    mount = body_from_camera(
        *(math.radians(a) for a in (c.mount_roll_deg, c.mount_pitch_deg, c.mount_yaw_deg))
    )
    wide = c.lens == "equidistant"
    plain = Lens.from_fov(c.width_px, c.height_px, c.fov_deg, mount, equidistant=wide)
    distortion = np.zeros_like(plain.distortion)
    distortion[: len(c.distortion)] = c.distortion[: len(distortion)]
    lens = replace(plain, distortion=distortion)
    return lens, CameraModel(c.width_px, c.height_px, lens.matrix, distortion, mount, equidistant=wide)


def _sensor(scenario: Scenario) -> SensorOptions:
    c = scenario.camera
    return SensorOptions(
        noise_sigma=c.noise,
        vignetting=c.vignetting,
        exposure_drift=c.exposure_drift,
        exposure_s=c.exposure_s,
        readout_s=c.readout_s,
        brightness=c.brightness,
        contrast=c.contrast,
        in_view=c.in_view,
    )


def _since_boot(truth: FrameTruth, boot_s: float) -> FrameTruth:
    return replace(truth, time_boot_s=truth.time_boot_s + boot_s)
