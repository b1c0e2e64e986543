"""A scenario flown in lockstep: world, vehicle, link and pipeline one after the other, in simulated time alone.

The same scenario gives the same flight, bit for bit, as fast as the machine computes it.
"""

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2

from companion.core.approach import Ordered
from companion.core.core import Output, Processed
from companion.core.decision_logic import LandRequest
from companion.core.landing_watch import LandingWatch
from companion.live.kept_mask import KeptMask
from companion.live.live_pipeline import LivePipeline
from companion.messages.messages import Message
from companion.settings.settings import Settings
from companion.simulation.flight_record import FlightRecord
from companion.simulation.flight_result import FlightResult, FlownStep, PathPoint, Request, path_point
from companion.simulation.ground import PATCH_M, Patch, fitness, measurable, patch
from companion.simulation.hardware import NAV_LAND, LocalControls
from companion.simulation.pilot import Pilot
from companion.simulation.scenario import Scenario
from companion.simulation.scene import Scene, sensor_errors
from companion.simulation.virtual_link import VirtualLink
from drivers.cameras.checks import FrameCheck
from drivers.files.camera_info import EQUIDISTANT, CameraInfo, write_camera_info
from drivers.samples import Frame, Refusal, Sample
from drivers.simulated.vehicle.autopilot_protocol import AutopilotProtocol
from drivers.simulated.vehicle.flight_controller import FlightController
from drivers.simulated.vehicle.sensors import Sensors
from drivers.simulated.vehicle.telemetry_streams import TelemetryStreams
from landing.decision.orders import OrderKind, State
from landing.ground.landing_area import LandingArea

EPOCH_US = 1_700_000_000_000_000
STEP_HZ = 200
PATH_EVERY_S = 0.05
LONGEST_LANDING_S = 60.0
STANDS_S = 2.0
"""How long it stands on the ground, disarmed, before the flight is over."""

PRECISION_LANDING = {"PLND_ENABLED": 1.0, "PLND_TYPE": 1.0}
"""Parameters of an ArduCopter that follows LANDING_TARGET."""

Progress = Callable[[float, float], None]
"""Called with the time flown and the time there is."""


@dataclass(frozen=True, slots=True)
class LockstepOptions:
    """How far a flight is followed."""

    truth_every: int = 0
    """Every so many frames the truth is computed, to know how long fit ground was in view; 0: never."""
    stop_at_request: bool = False
    """The first request ends the flight, but for the landing itself, which nobody watches; so does giving back."""
    kept_mask: KeptMask | None = None
    """What an earlier flight found to stand still in the picture, and where this one leaves it."""
    record: Path | None = None
    """Leave a flight folder with the truth of every frame here (which costs as much as a frame)."""


def fly(
    scenario: Scenario,
    config: Path | None = None,
    overrides: Sequence[str] = (),
    options: LockstepOptions | None = None,
    progress: Progress = lambda done, total: None,
) -> FlightResult:
    """Fly a scenario to its end; what happened."""
    cv2.setNumThreads(1)
    with TemporaryDirectory() as directory:
        scene = Scene(scenario, threads=False)
        settings = flight_settings(scenario, scene, Path(directory), config, overrides)
        return _Flight(scenario, scene, settings, options or LockstepOptions()).run(progress)


def flight_settings(
    scenario: Scenario, scene: Scene, directory: Path, config: Path | None, overrides: Sequence[str]
) -> Settings:
    """The settings of a flight, with the simulated camera's calibration written into ``directory``."""
    lens = scene.lens
    calibration = directory / "camera.yaml"
    believed = lens.matrix.copy()
    believed[:2, :2] *= scenario.camera.focal_believed
    info = CameraInfo(
        lens.width,
        lens.height,
        tuple(map(float, believed.ravel())),
        tuple(map(float, lens.distortion)),
        EQUIDISTANT if lens.equidistant else "plumb_bob",
        name="simulated",
    )
    write_camera_info(calibration, info)
    settings = scenario.flight_settings(config, overrides)
    return replace(
        settings,
        camera=replace(settings.camera, source="simulated", calibration=str(calibration)),
        mavlink=replace(settings.mavlink, connection=settings.mavlink.connection or "simulated"),
    )


class _Flight:
    def __init__(
        self, scenario: Scenario, scene: Scene, settings: Settings, options: LockstepOptions
    ) -> None:
        self._scenario, self._scene, self._options = scenario, scene, options
        self._limit_deg = settings.decision.max_inclination_deg
        self._radius_m = settings.vehicle.landing_radius_m
        seed = scenario.basics.seed
        self._controller = FlightController(scene.vehicle)
        self._sensors = Sensors(scene.vehicle, sensor_errors(scenario), seed + 1)
        streams = TelemetryStreams(self._controller, self._sensors, boot_s=-scenario.link.since_boot_s)
        protocol = AutopilotProtocol(self._controller, streams)
        protocol.set_answer(NAV_LAND, scenario.link.land_answer)
        self._link = VirtualLink(scenario, settings, streams, protocol, EPOCH_US, options.record is not None)
        airborne = scenario.start.height_m > 0
        if settings.landing.procedure == "landing_target":
            # as docs/procedure_autopilots.md asks for
            self._controller.parameters.values.update(PRECISION_LANDING)
        if airborne:
            self._controller.start_airborne(scenario.start.mode)
        self._pilot = Pilot(scenario, LocalControls(self._controller), airborne)
        self._pipeline = LivePipeline(settings, self._take, kept_mask=options.kept_mask)
        self._watch = LandingWatch(settings.landing, settings.decision.dwell_s, self._pipeline)
        record, rate_hz = options.record, scenario.camera.rate_hz
        self._record = None if record is None else FlightRecord(record, settings, rate_hz)
        self.result = FlightResult(scenario.name, EPOCH_US, limit_deg=self._limit_deg)
        self._frames: deque[tuple[int, Frame | Refusal]] = deque()
        self._check = FrameCheck()
        self._truths: deque[tuple[int, float]] = deque(maxlen=200)
        self._next_frame = 0
        self._rebooted = False
        self._fit_s = self._chance_s = 0.0
        self._area = LandingArea(scene.camera_model, settings.decision, settings.tracking)

    def run(self, progress: Progress) -> FlightResult:
        started = time.perf_counter()
        vehicle, result = self._scene.vehicle, self.result
        dt = 1.0 / STEP_HZ
        steps, every = 0, round(PATH_EVERY_S * STEP_HZ)
        stood_s = 0.0
        while vehicle.time_s < self._scenario.basics.duration_s and stood_s < STANDS_S:
            self._pilot.step(vehicle.time_s)
            vehicle.step(dt, self._controller.step(dt))
            steps += 1
            vehicle.time_s = steps * dt
            self._sensors.step(dt)
            self._scene.poses.add(vehicle)
            self._faults(vehicle.time_s)
            self._expose(vehicle.time_s)
            self._deliver(vehicle.time_s)
            if steps % every == 0:
                result.path.append(self._point())
                progress(vehicle.time_s, self._scenario.basics.duration_s)
            if vehicle.on_ground and not self._controller.armed and self._pilot.flying:
                stood_s += dt
            if self._options.stop_at_request and (result.requests or self._gave_back):
                break
        self._pipeline.finish()
        if result.requests and self._options.stop_at_request:
            self._land_unwatched()
        result.duration_s = vehicle.time_s
        if vehicle.touch_downs:
            touch = vehicle.touch_downs[0]
            result.touch_down = touch
            result.touch_ground = self._patch(touch.position[0], touch.position[1])
        if self._record is not None:
            result.folder = self._record.close(self._link.packets or [])
        result.elapsed_s = time.perf_counter() - started
        return result

    @property
    def _gave_back(self) -> bool:
        steps = self.result.steps
        return bool(steps) and steps[-1].step.state is State.GIVE_BACK

    def _land_unwatched(self) -> None:
        """The rest of the flight by physics alone."""
        vehicle, dt = self._scene.vehicle, 1.0 / STEP_HZ
        self._controller.set_mode("LAND")
        end_s = vehicle.time_s + LONGEST_LANDING_S
        while not vehicle.on_ground and vehicle.time_s < end_s:
            vehicle.step(dt, self._controller.step(dt))

    def _faults(self, time_s: float) -> None:
        self._link.silent = self._scene.fault("link_silent", time_s) is not None
        reboot = self._scene.fault("autopilot_reboot", time_s)
        if reboot is not None and not self._rebooted:
            self._rebooted = True
            self._link.reboot(time_s, reboot.seconds)

    def _expose(self, time_s: float) -> None:
        """Take the next picture once its whole exposure lies in the past."""
        camera = self._scenario.camera
        due_s = 0.1 + self._next_frame / camera.rate_hz
        if time_s < due_s + 0.5 * (camera.exposure_s + camera.readout_s):
            return
        number = self._next_frame
        self._next_frame += 1
        image = self._scene.picture(number, due_s, due_s)
        if image is None:
            return
        stamp_us = EPOCH_US + round((due_s + camera.late_s) * 1e6)
        arrival_us = EPOCH_US + round(max(due_s + camera.latency_s, time_s) * 1e6)
        frame = self._check.check(Frame(number, stamp_us, arrival_us, image))
        self._frames.append((arrival_us, frame))
        if isinstance(frame, Refusal):
            return
        self._truths.append((number, due_s))
        every = self._options.truth_every
        if self._record is not None:
            self._record.frame(frame, self._scene.truth(number, due_s))
        if every and number % every == 0 and self._pilot.flying and not self.result.requests:
            self._watch_fit(number, due_s, every / camera.rate_hz)

    def _watch_fit(self, number: int, time_s: float, period_s: float) -> None:
        """How long clearly fit ground has been in view with the pilot's consent."""
        result = self.result
        truth = self._scene.truth(number, time_s)
        word = fitness(truth, self._limit_deg)
        result.unfit_seen |= word == "unfit"
        fit = word == "fit" and time_s >= self._scenario.pilot.switch_on_s
        self._fit_s = self._fit_s + period_s if fit else 0.0
        result.longest_fit_s = max(result.longest_fit_s, self._fit_s)
        chance = fit and measurable(truth, self._area, self._scene.camera_model)
        self._chance_s = self._chance_s + period_s if chance else 0.0
        result.longest_chance_s = max(result.longest_chance_s, self._chance_s)

    def _deliver(self, time_s: float) -> None:
        samples: list[Sample] = self._link.step(time_s)
        now_us = EPOCH_US + round(time_s * 1e6)
        while self._frames and self._frames[0][0] <= now_us:
            samples.append(self._frames.popleft()[1])
        samples.sort(key=lambda s: s.arrival_us)
        self._pipeline.feed(samples)
        if not samples:
            self._pipeline.tick(now_us)

    def _take(self, output: Output) -> None:
        if self._record is not None:
            self._record.output(output)
        if isinstance(output, LandRequest):
            self._request(output)
        elif isinstance(output, Ordered):
            self._order(output)
        elif isinstance(output, Processed):
            pass
        else:
            self.result.add(output)
            self._watched(output)

    def _request(self, request: LandRequest) -> None:
        time_s = self._scene.vehicle.time_s
        exposed_s = dict(self._truths).get(request.frame, time_s)
        truth = self._scene.truth(request.frame, exposed_s)
        where = self._point()
        self.result.requests.append(
            Request(
                time_s,
                request.frame,
                where,
                truth,
                fitness(truth, self._limit_deg),
                self._patch(where.north_m, where.east_m),
            )
        )
        self._link.land(time_s)

    def _watched(self, message: Message) -> None:
        """The watch over the landing holds as the daemon's does."""
        watched = self._watch.feed(message)
        if watched is None:
            return
        if self._record is not None:
            self._record.output(watched.event)
        self.result.add(watched.event)
        if watched.hold:
            self._pipeline.hold()
            self._link.hold(self._scene.vehicle.time_s)

    def _order(self, ordered: Ordered) -> None:
        """The procedure's orders reach the autopilot as the command to land does."""
        time_s, order = self._scene.vehicle.time_s, ordered.order
        vehicle = self._scene.vehicle
        self.result.steps.append(FlownStep(time_s, ordered.step, vehicle.position, vehicle.velocity))
        if order.kind is OrderKind.START:
            self._pilot.gave_away = True
        elif order.kind is OrderKind.VELOCITY:
            self._link.fly(time_s, order.velocity_ned)
        elif order.kind is OrderKind.STOP:
            self._link.hold(time_s)
        elif order.kind is OrderKind.TARGET:
            self._link.target(time_s, order.target_ned, ordered.time_unix_us)

    def _patch(self, north_m: float, east_m: float) -> Patch:
        """The ground about a place; a procedure that chose it is held to the disc that the settings ask for."""
        radius_m = self._radius_m if self.result.steps else PATCH_M
        return patch(self._scene.world, north_m, east_m, radius_m)

    def _point(self) -> PathPoint:
        vehicle = self._scene.vehicle
        return path_point(vehicle, vehicle.time_s, self._controller.mode)
