"""A scenario flown closed loop with the real daemon: MAVLink over a socket, MAVSDK, zenoh, threads and all."""

import os
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from companion.errors import LandslopeError
from companion.live.daemon import Daemon
from companion.live.inputs import Inputs
from companion.live.publisher import endpoints
from companion.messages.messages import TOPICS, Event, Message
from companion.settings.settings import Settings
from companion.simulation.flight_record import add_truth, folders_in
from companion.simulation.flight_result import FlightResult, PathPoint, Request, path_point
from companion.simulation.ground import fitness, patch
from companion.simulation.hardware import BuiltIn, Hardware, Sih, Sitl
from companion.simulation.lockstep import PATH_EVERY_S, STANDS_S, flight_settings
from companion.simulation.pilot import Pilot
from companion.simulation.scenario import Scenario
from companion.simulation.scene import Scene
from drivers.bus import Delivery, Subscription
from drivers.cameras.interface import Camera, Notify, ReaderLimits
from drivers.cameras.reader import ReaderCamera
from drivers.errors import DriverError
from drivers.simulated.vehicle.ardupilot_json import PORT
from drivers.simulated.world.live_camera import SimulatedGrabber
from drivers.simulated.world.truth import FrameTruth
from drivers.system import host_clock

READY_S = 20.0
"""How long MAVSDK, link and camera may take to find each other."""
BEGINS_S = 180.0
"""How much simulated time an autopilot may take until the flight begins: ArduCopter's estimator took 40 s."""
SETTLE_S = 1.0
"""Simulated time that the vehicle hangs still once they have."""
POLL_S = 0.05
WATCH_PORT = 7447
"""Where a flight that others may watch listens, unless the settings say so."""
DRAIN_S = 0.5
BEHIND_S, BEHIND = 0.5, (2.0, 15.0)
"""The flight waits so long, of real time, for a camera that is so many frames behind; with more it is opened again."""
SAME_EXPOSURE_US = 2000
TYPES = {topic.name: topic.type for topic in TOPICS if topic.type is not None}
Progress = Callable[[float, float], None]


@dataclass(frozen=True, slots=True)
class ArduPilot:
    """Where a SITL is reached: MAVLink of the daemon and of the pilot, and the physics' UDP port."""

    connection: str = "tcp:127.0.0.1:5760"
    pilot: str = "tcp:127.0.0.1:5762"
    physics_port: int = PORT


@dataclass(frozen=True, slots=True)
class Px4:
    """Where a PX4 with SIH is reached: MAVLink of the daemon and of the pilot."""

    connection: str = "udpin:127.0.0.1:14540"
    pilot: str = "udpin:127.0.0.1:14550"


@dataclass(frozen=True, slots=True)
class LiveOptions:
    """How a flight is flown."""

    speed: float = 1.0
    """Simulated over real time."""
    record: Path | None = None
    """Where a flight folder is left."""
    watch: bool = False
    """Keep the vehicle's name and its bus as the settings say, for others to watch."""
    autopilot: ArduPilot | Px4 | None = None
    """Fly a real autopilot in simulation instead of the built-in one."""


def fly_live(
    scenario: Scenario,
    config: Path | None = None,
    overrides: Sequence[str] = (),
    options: LiveOptions | None = None,
    progress: Progress = lambda done, total: None,
) -> FlightResult:
    """Fly a scenario to its end, or until KeyboardInterrupt; what happened."""
    options = options or LiveOptions()
    cv2.setNumThreads(1)
    with ExitStack() as stack:
        directory = Path(stack.enter_context(TemporaryDirectory()))
        scene = Scene(scenario)
        settings = flight_settings(scenario, scene, directory, config, overrides)
        hardware = _hardware(scenario, scene, options)
        flight = _LiveFlight(scenario, scene, hardware, settings, options, stack)
        return flight.run(progress)


def _hardware(scenario: Scenario, scene: Scene, options: LiveOptions) -> Hardware:
    a = options.autopilot
    if a is None:
        return BuiltIn(scenario, scene, options.speed)
    if isinstance(a, Px4):
        return Sih(scenario, scene, a.connection, a.pilot)
    return Sitl(scenario, scene, a.connection, a.pilot, a.physics_port)


class _LiveFlight:
    def __init__(
        self,
        scenario: Scenario,
        scene: Scene,
        hardware: Hardware,
        settings: Settings,
        options: LiveOptions,
        stack: ExitStack,
    ) -> None:
        self._scenario, self._scene = scenario, scene
        self._airborne = scenario.start.height_m > 0 and options.autopilot is None
        self._camera: ReaderCamera | None = None
        self._pilot: Pilot | None = None
        self._limit_deg = settings.decision.max_inclination_deg
        self._offset_us, self._hardware = round(settings.camera.time_offset_s * 1e6), hardware
        # The companion's clock is the simulation's: on a machine that cannot keep up, both stretch alike.
        self._base_us = host_clock.now_us()
        stack.enter_context(host_clock.driven(lambda: self._clock_us(hardware.now_s)))
        stack.callback(hardware.stop)
        self._zero_s: float | None = None
        self._path_due_s = 0.0
        self._record = options.record
        self._folders = folders_in(options.record)
        self._truths: list[tuple[int, FrameTruth]] = []
        self._exposures: deque[tuple[int, float]] = deque(maxlen=400)
        self.result = FlightResult(scenario.name)
        settings = _wired(settings, hardware.connection, options)
        self._daemon = Daemon(settings, Inputs(settings, self._open_camera))
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._run_daemon, name="daemon", daemon=True)
        reach = settings.zenoh
        if reach.mode == "peer":
            reach = replace(reach, listen=(), connect=reach.listen[:1])
        self._watcher = stack.enter_context(
            Subscription(endpoints(reach), settings.vehicle.name, tuple(TYPES))
        )

    def run(self, progress: Progress) -> FlightResult:
        started = time.perf_counter()
        self._hardware.start(self._before_step, lambda time_s: self._scene.poses.add(self._scene.vehicle))
        self._pilot = Pilot(self._scenario, self._hardware.controls, self._airborne)
        self._thread.start()
        try:
            self._await_ready()
            self._begin()
            self._watch_to_the_end(progress)
        finally:
            self._daemon.stop()
            self._thread.join()
        self._drain(DRAIN_S)
        self._raise_failure()
        result, vehicle = self.result, self._scene.vehicle
        result.duration_s = vehicle.time_s - (self._zero_s or 0.0)
        if vehicle.touch_downs:
            touch = vehicle.touch_downs[0]
            result.touch_down = replace(touch, time_s=touch.time_s - (self._zero_s or 0.0))
            result.touch_ground = patch(self._scene.world, touch.position[0], touch.position[1])
        if self._record is not None:
            result.folder = add_truth(self._record, self._folders, self._truths)
        result.elapsed_s = time.perf_counter() - started
        return result

    # -- the daemon and what stands around it ------------------------------------------------------------

    def _run_daemon(self) -> None:
        try:
            self._daemon.run()
        except (LandslopeError, DriverError) as error:
            self._failure = error

    def _raise_failure(self) -> None:
        if self._failure is not None:
            raise self._failure

    def _clock_us(self, time_s: float) -> int:
        """The companion's clock at a simulated time."""
        return self._base_us + round(time_s * 1e6)

    def _open_camera(self, notify: Notify) -> Camera:
        camera = self._scenario.camera
        lag_s = camera.latency_s + 0.5 * (camera.exposure_s + camera.readout_s)

        def make() -> SimulatedGrabber:
            return SimulatedGrabber(
                self._picture,
                lambda: self._hardware.now_s,
                lambda: self._scene.poses.newest_s,
                lambda time_s: self._clock_us(time_s + camera.late_s),
                rate_hz=camera.rate_hz,
                lag_s=lag_s,
            )

        self._camera = ReaderCamera("simulated", make, ReaderLimits(), notify)
        return self._camera

    def _picture(self, number: int, time_s: float) -> NDArray[np.uint8] | None:
        stamp_us = self._clock_us(time_s + self._scenario.camera.late_s)
        self._exposures.append((stamp_us, time_s))
        if self._record is not None:
            self._truths.append((stamp_us, self._scene.truth(number, time_s)))
        return self._scene.picture(number, time_s, time_s - (self._zero_s or np.inf))

    def _await_ready(self) -> None:
        give_up = time.monotonic() + READY_S
        while not (self._daemon.commander_connected and self._scene.poses.newest_s > SETTLE_S):
            self._raise_failure()
            if time.monotonic() > give_up:
                raise LandslopeError(f"the daemon did not find the simulated autopilot within {READY_S:g} s")
            self._drain(POLL_S)
        found_s = self._scene.vehicle.time_s
        while not (self._pilot is not None and self._pilot.ready):
            self._raise_failure()
            if self._scene.vehicle.time_s - found_s > BEGINS_S:
                raise LandslopeError(
                    f"the autopilot did not arm and take off within {BEGINS_S:g} s of simulated time; its console "
                    "and its STATUSTEXT say which check before arming fails"
                )
            self._drain(POLL_S)

    def _begin(self) -> None:
        zero_s = self._scene.vehicle.time_s
        self.result.epoch_us = self._clock_us(zero_s)
        self._zero_s = zero_s

    def _watch_to_the_end(self, progress: Progress) -> None:
        vehicle = self._scene.vehicle
        zero_s = self._zero_s or 0.0
        stood_from: float | None = None
        while vehicle.time_s - zero_s < self._scenario.basics.duration_s:
            self._raise_failure()
            self._drain(POLL_S)
            progress(vehicle.time_s - zero_s, self._scenario.basics.duration_s)
            if self._pilot is None or not (
                self._pilot.flying and vehicle.on_ground and not self._hardware.armed
            ):
                stood_from = None
            elif stood_from is None:
                stood_from = vehicle.time_s
            elif vehicle.time_s - stood_from > STANDS_S:
                return

    # -- the vehicle's side: called by the physics -------------------------------------------------------

    def _before_step(self, time_s: float) -> None:
        if self._pilot is None:
            return
        if self._zero_s is None:
            self._pilot.wait(time_s)
            return
        flown_s = time_s - self._zero_s
        if isinstance(self._hardware, BuiltIn):
            self._wait_for_frames(time_s, flown_s)
        self._pilot.step(flown_s)
        self._hardware.apply_faults(self._scene, flown_s)
        if flown_s >= self._path_due_s:
            self._path_due_s = flown_s + PATH_EVERY_S
            self.result.path.append(path_point(self._scene.vehicle, flown_s, self._hardware.mode))

    def _wait_for_frames(self, time_s: float, flown_s: float) -> None:
        """On a busy machine the flight becomes slower instead of going on unseen."""
        until = time.monotonic() + BEHIND_S
        while self._behind(time_s, flown_s) and time.monotonic() < until:
            time.sleep(0.001)

    def _behind(self, time_s: float, flown_s: float) -> bool:
        """Whether a frame waits for the daemon, or exposures that are due have not begun."""
        if not (self._camera and self._exposures) or self._scene.fault("camera_lost", flown_s):
            return False
        c = self._scenario.camera
        late_s = time_s - self._exposures[-1][1] - c.latency_s - c.exposure_s - c.readout_s
        return BEHIND[0] < late_s * c.rate_hz < BEHIND[1] or self._camera.status().waiting > 0

    # -- the watcher's side ------------------------------------------------------------------------------

    def _drain(self, seconds: float) -> None:
        """Take messages off the bus for a while."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            delivery = self._watcher.receive(left)
            if delivery is not None and delivery.alive is None and self._zero_s is not None:
                self._message(delivery)

    def _message(self, delivery: Delivery) -> None:
        kind = TYPES.get(delivery.topic)
        if kind is None:
            return
        message: Message = msgspec.json.decode(delivery.payload, type=kind)
        self.result.add(message)
        if isinstance(message, Event) and message.event == "landing_requested":
            self._request(message)

    def _request(self, event: Event) -> None:
        """The truth of the frame that the request speaks of."""
        stamp_us = event.time_unix_us + self._offset_us
        exposed_s = [s for us, s in self._exposures if abs(us - stamp_us) < SAME_EXPOSURE_US]
        zero_s = self._zero_s or 0.0
        time_s = exposed_s[-1] if exposed_s else self._scene.vehicle.time_s
        truth = self._scene.truth(event.frame or 0, time_s)
        n, e, d = (float(x) for x in self._scene.poses.at(time_s).position)
        where = PathPoint(time_s - zero_s, n, e, -d, self._scene.world.height_at(n, e), "GUIDED", 0.0)
        self.result.requests.append(
            Request(
                time_s - zero_s,
                event.frame or 0,
                where,
                truth,
                fitness(truth, self._limit_deg),
                patch(self._scene.world, n, e),
            )
        )


def _wired(settings: Settings, connection: str, options: LiveOptions) -> Settings:
    """The settings with the simulated link, a bus that can be watched, and a name of this process's own."""
    zenoh, vehicle, record = settings.zenoh, settings.vehicle, settings.record
    if zenoh.mode == "peer" and not zenoh.listen:
        port = WATCH_PORT if options.watch else _free_tcp_port()
        zenoh = replace(zenoh, listen=(f"tcp/127.0.0.1:{port}",))
    if not options.watch:
        vehicle = replace(vehicle, name=f"{vehicle.name}-simulated-{os.getpid()}")
    if options.record is not None:
        record = replace(record, directory=str(options.record), when="always")
    mavlink = replace(settings.mavlink, connection=connection)
    return replace(settings, zenoh=zenoh, vehicle=vehicle, mavlink=mavlink, record=record)


def _free_tcp_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
