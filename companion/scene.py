"""The hardware of a scenario: world, camera, vehicle, sensors and the pilot who flies its legs."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from companion.scenario import ENABLE_CHANNEL, Fault, Leg, Scenario
from drivers.simulated.camera import SensorOptions, SimulatedCamera
from drivers.simulated.flight_controller import FlightController
from drivers.simulated.lens import Lens
from drivers.simulated.pose_history import PoseHistory
from drivers.simulated.render import Renderer
from drivers.simulated.sensors import SensorErrors
from drivers.simulated.truth import FrameTruth
from drivers.simulated.vehicle import Ground, Multirotor, Wind
from drivers.simulated.world import World
from landing.camera import CameraModel, body_from_camera

TEXTURE_SIZE = 512
SETPOINT_S = 0.05
SWITCH_ON_US = 2000
HEIGHT_GAIN = 1.2
"""Climb per metre of height that is missing, 1/s."""
MAX_FOLLOW_M_S = 1.2
"""Fastest climb or sink with which a height over the ground is followed."""


class Pilot:
    """Flies the legs in GUIDED until somebody else takes over; knows the ground as a range finder does."""

    def __init__(self, scenario: Scenario, controller: FlightController) -> None:
        self._legs = scenario.legs
        self._start = scenario.start
        self._controller = controller
        self._faults = [f for f in scenario.faults if f.kind == "mode_change"]
        self._heading = math.radians(scenario.start.heading_deg)
        self._next_s = 0.0
        self._legs_from_s: float | None = None
        self._switched = False
        self._enable_s = scenario.pilot.switch_on_s

    @property
    def flying(self) -> bool:
        """Whether the legs have begun."""
        return self._legs_from_s is not None

    def step(self, time_s: float) -> None:
        """To be called before every step of the physics."""
        if time_s < self._next_s:
            return
        self._next_s = time_s + SETPOINT_S
        if time_s >= self._enable_s > 0:
            self._controller.pulse_us[ENABLE_CHANNEL - 1] = SWITCH_ON_US
        for fault in self._faults:
            if time_s >= fault.at_s:
                self._faults.remove(fault)
                self._controller.set_mode(fault.mode)
                return
        if self._legs_from_s is None and not self._in_the_air(time_s):
            return
        leg = self._leg(time_s - (self._legs_from_s or 0.0))
        if leg is not None:
            self._fly(leg)

    def _in_the_air(self, time_s: float) -> bool:
        c = self._controller
        if self._start.height_m > 0:
            if self._start.mode != "GUIDED":
                c.pulse_us[2] = 1500
            self._legs_from_s = time_s
            return True
        if not c.armed and not self._switched:
            self._switched = c.set_mode("GUIDED") and c.arm() and c.take_off(self._start.take_off_m)
        elif c.vehicle.height_above_ground > 0.95 * self._start.take_off_m:
            self._legs_from_s = time_s
        return self._legs_from_s is not None

    def _leg(self, flown_s: float) -> Leg | None:
        for leg in self._legs:
            if flown_s < leg.seconds:
                return leg
            flown_s -= leg.seconds
        return None

    def _fly(self, leg: Leg) -> None:
        c = self._controller
        self._heading += math.radians(leg.turn_deg_s) * SETPOINT_S
        cos, sin = math.cos(self._heading), math.sin(self._heading)
        north = leg.forward_m_s * cos - leg.right_m_s * sin
        east = leg.forward_m_s * sin + leg.right_m_s * cos
        climb = leg.climb_m_s
        if leg.height_m > 0:
            missing = leg.height_m - self._height(north, east)
            climb = min(max(HEIGHT_GAIN * missing, -MAX_FOLLOW_M_S), MAX_FOLLOW_M_S)
        c.fly((north, east, -climb), self._heading)

    def _height(self, north_m_s: float, east_m_s: float) -> float:
        """Over the ground, smoothed over the way of half a second to either side, as filters do it."""
        v = self._controller.vehicle
        n, e, down = v.position
        grounds = [v.ground(n + s * north_m_s, e + s * east_m_s) for s in (-0.5, -0.25, 0.0, 0.25, 0.5)]
        return -down - sum(grounds) / len(grounds)


class Scene:
    """All of a scenario's hardware but the autopilot's link. Times are simulated seconds, from 0."""

    def __init__(self, scenario: Scenario) -> None:
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
        height = start.height_m or None
        self.vehicle.place(start.north_m, start.east_m, height, math.radians(start.heading_deg))
        self.lens, self.camera_model = _optics(scenario)
        renderer = Renderer(
            self.world, self.lens, texture_seed=scenario.basics.texture_seed, texture_size=TEXTURE_SIZE
        )
        self.camera = SimulatedCamera(renderer, _sensor(scenario), seed=scenario.basics.seed)
        # A renderer is not safe for threads: the truth may be asked for while a picture is being made.
        judge = Renderer(
            self.world, self.lens, texture_seed=scenario.basics.texture_seed, texture_size=TEXTURE_SIZE
        )
        self._judge = SimulatedCamera(judge, _sensor(scenario), seed=scenario.basics.seed)
        self.poses = PoseHistory()
        self.poses.add(self.vehicle)
        self._frozen: NDArray[np.uint8] | None = None

    def begin(self, controller: FlightController) -> Pilot:
        """Put the vehicle into the air where the scenario begins there; the pilot of the flight."""
        if self.scenario.start.height_m > 0:
            controller.start_airborne(self.scenario.start.mode)
        return Pilot(self.scenario, controller)

    def picture(self, number: int, time_s: float, flown_s: float) -> NDArray[np.uint8] | None:
        """What the camera delivers of the exposure at ``time_s``, ``flown_s`` into the scenario's flight; or None."""
        if self._fault("camera_lost", flown_s):
            return None
        if self._fault("camera_frozen", flown_s) and self._frozen is not None:
            return self._frozen
        image = self.camera.expose(number, time_s, self.poses.at)
        if self._fault("camera_dark", flown_s):
            image = (image // 64).astype(np.uint8)
        self._frozen = image
        return image

    def truth(self, number: int, time_s: float) -> FrameTruth:
        """The truth of the exposure at ``time_s``; its time counts from the autopilot's boot."""
        truth = self._judge.truth(number, time_s, self.poses.at)
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
    )


def _optics(scenario: Scenario) -> tuple[Lens, CameraModel]:
    """The lens, and the camera model that is its exact calibration."""
    c = scenario.camera
    mount = body_from_camera(
        *(math.radians(a) for a in (c.mount_roll_deg, c.mount_pitch_deg, c.mount_yaw_deg))
    )
    plain = Lens.from_fov(c.width_px, c.height_px, c.fov_deg, mount)
    distortion = np.zeros(5)
    distortion[: len(c.distortion)] = c.distortion[:5]
    lens = Lens(c.width_px, c.height_px, plain.matrix, distortion, mount)
    return lens, CameraModel(c.width_px, c.height_px, lens.matrix, distortion, mount)


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
    )


def _since_boot(truth: FrameTruth, boot_s: float) -> FrameTruth:
    return replace(truth, time_boot_s=truth.time_boot_s + boot_s)
