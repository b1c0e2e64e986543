"""Who flies the simulated vehicle, and how a scenario's pilot reaches its controls."""

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any, Protocol

from companion.errors import LandslopeError
from companion.simulation.scenario import Scenario
from companion.simulation.scene import Scene, sensor_errors
from drivers.commands import NAV_LAND
from drivers.simulated.vehicle.ardupilot_json import PORT, JsonBackend
from drivers.simulated.vehicle.autopilot import LinkFaults, SimulatedAutopilot
from drivers.simulated.vehicle.flight_controller import FlightController
from drivers.simulated.vehicle.followed import FollowedClock, FollowedVehicle
from drivers.simulated.vehicle.mavlink_pilot import MavlinkPilot
from drivers.simulated.vehicle.vehicle import Multirotor

STEP_HZ = 250.0
WAITING_POSES = 1000
ASK_POSES_S = 2.0
POSE_WAIT_S = 0.02
SITL_S = 60.0
"""How long a SITL may take to send its first packet."""

Hook = Callable[[float], None]


class Controls(Protocol):
    """What a pilot has in hand."""

    vehicle: Multirotor

    def listen(self) -> None:
        """Take in what the autopilot says; to be called some twenty times a second."""

    def get_ready(self) -> bool:
        """Whether the autopilot may be armed; to be repeated until it may."""

    def get_airborne(self, height_m: float) -> None:
        """Ask for mode, arming and takeoff; to be repeated until the vehicle flies."""

    def fly(self, velocity: tuple[float, float, float], yaw: float) -> None:
        """A velocity, NED in m/s, and a heading in rad."""

    def set_mode(self, name: str) -> None:
        """Switch the flight mode."""

    def set_channel(self, channel: int, pulse_us: int) -> None:
        """Move a switch of the radio."""


class LocalControls:
    """The controls of the built-in autopilot, at hand."""

    def __init__(self, controller: FlightController) -> None:
        self._controller = controller
        self.vehicle = controller.vehicle

    def listen(self) -> None:
        """There is nothing to hear."""

    def get_ready(self) -> bool:
        return True

    def get_airborne(self, height_m: float) -> None:
        c = self._controller
        if not c.armed:
            c.set_mode("GUIDED")
            if c.arm():
                c.take_off(height_m)

    def fly(self, velocity: tuple[float, float, float], yaw: float) -> None:
        self._controller.fly(velocity, yaw)

    def set_mode(self, name: str) -> None:
        self._controller.set_mode(name)

    def set_channel(self, channel: int, pulse_us: int) -> None:
        self._controller.pulse_us[channel - 1] = pulse_us


class Hardware(Protocol):
    """An autopilot with its physics, running by itself."""

    connection: str
    """Where the daemon finds it."""
    controls: Controls

    def start(self, before_step: Hook, after_step: Hook) -> None:
        """Let time run; the hooks are called around every step of the physics."""

    def stop(self) -> None:
        """End."""

    @property
    def now_s(self) -> float:
        """Simulated time at this moment."""

    @property
    def armed(self) -> bool:
        """Whether the motors are on."""

    @property
    def mode(self) -> str:
        """The flight mode by name; empty when not known."""

    def apply_faults(self, scene: Scene, flown_s: float) -> None:
        """Break what the scenario breaks at this time of the flight."""


class BuiltIn:
    """The simulated autopilot in a thread, ``speed`` times as fast as real time."""

    def __init__(self, scenario: Scenario, scene: Scene, speed: float) -> None:
        link = scenario.link
        self.autopilot = SimulatedAutopilot(
            "udpin:127.0.0.1:0",
            scene.vehicle,
            errors=sensor_errors(scenario),
            link=LinkFaults((link.delay_min_s, max(link.delay_min_s, link.delay_max_s)), link.loss),
            since_boot_s=link.since_boot_s,
            step_hz=STEP_HZ,
            speed=speed,
            seed=scenario.basics.seed,
        )
        self.autopilot.set_answer(NAV_LAND, link.land_answer)
        self.connection = f"udpout:127.0.0.1:{self.autopilot.port}"
        self.controls: Controls = LocalControls(self.autopilot.controller)
        self._rebooted = False
        start = scenario.start
        if start.height_m > 0:
            self.autopilot.controller.start_airborne(start.mode)
            self.controls.set_channel(3, 1500)

    def start(self, before_step: Hook, after_step: Hook) -> None:
        self.autopilot.before_step, self.autopilot.after_step = before_step, after_step
        self.autopilot.start()

    def stop(self) -> None:
        self.autopilot.stop()

    @property
    def now_s(self) -> float:
        return self.autopilot.now_s

    @property
    def armed(self) -> bool:
        return self.autopilot.controller.armed

    @property
    def mode(self) -> str:
        return self.autopilot.controller.mode

    def apply_faults(self, scene: Scene, flown_s: float) -> None:
        self.autopilot.link.silent = scene.fault("link_silent", flown_s) is not None
        reboot = scene.fault("autopilot_reboot", flown_s)
        if reboot is not None and not self._rebooted:
            self._rebooted = True
            self.autopilot.reboot(reboot.seconds)


def _refuse_faults(scenario: Scenario, whose: str) -> None:
    """LandslopeError for what only the built-in autopilot can be made to do."""
    broken = [f.kind for f in scenario.faults if f.kind in ("link_silent", "autopilot_reboot")]
    if broken or scenario.link.land_answer != "normal":
        what = ", ".join(broken) or f"land_answer = {scenario.link.land_answer}"
        raise LandslopeError(f"{what} is a fault of the built-in autopilot; it cannot be had with {whose}")


class _Piloted:
    """What the pilot's link says of an autopilot that runs by itself; nothing before there is one."""

    _pilot: MavlinkPilot | None = None

    @property
    def armed(self) -> bool:
        return self._pilot is not None and self._pilot.armed

    @property
    def mode(self) -> str:
        return self._pilot.mode_name if self._pilot is not None else ""

    def apply_faults(self, scene: Scene, flown_s: float) -> None:
        """Camera faults are the scene's own; others were refused."""


class Sitl(_Piloted):
    """An ArduCopter SITL that takes its physics from here; ``pilot`` is a second MAVLink port of it."""

    def __init__(
        self, scenario: Scenario, scene: Scene, connection: str, pilot: str, port: int = PORT
    ) -> None:
        _refuse_faults(scenario, "ArduPilot's")
        start = scenario.start
        scene.vehicle.place(start.north_m, start.east_m, None, scene.heading)
        self.connection = connection
        self.backend = JsonBackend(scene.vehicle, port)
        self._pilot_connection = pilot
        self._pilot: MavlinkPilot | None = None
        self._vehicle = scene.vehicle

    def start(self, before_step: Hook, after_step: Hook) -> None:
        self.backend.before_step, self.backend.after_step = before_step, after_step
        self.backend.start()
        if not self.backend.connected.wait(SITL_S):
            port = self.backend.port
            self.backend.stop()
            why = f": {self.backend.problem}" if self.backend.problem else ""
            raise LandslopeError(
                f"no SITL asked for its physics within {SITL_S:g} s{why}; start it with "
                f"'arducopter --model JSON:127.0.0.1' (its packets come to UDP port {port})"
            )
        self._pilot = MavlinkPilot(self._pilot_connection)
        self.controls: Controls = _RemoteControls(self._pilot, self._vehicle)

    def stop(self) -> None:
        self.backend.stop()
        if self._pilot is not None:
            self._pilot.close()

    @property
    def now_s(self) -> float:
        return self.backend.now_s


class Sih(_Piloted):
    """A PX4 whose own simulation flies (SIH); the scene's vehicle follows its poses, reported over the pilot's link."""

    def __init__(self, scenario: Scenario, scene: Scene, connection: str, pilot: str) -> None:
        _refuse_faults(scenario, "PX4's")
        self.connection = connection
        self._pilot_connection = pilot
        self._vehicle = scene.vehicle
        start = scenario.start
        self._followed = FollowedVehicle(scene.vehicle, (start.north_m, start.east_m))
        self._pilot: MavlinkPilot | None = None
        self._before: Hook = lambda time_s: None
        self._after: Hook = lambda time_s: None
        self._reported: deque[Any] = deque(maxlen=WAITING_POSES)
        self._clock = FollowedClock()
        self._taken_s = 0.0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="sih", daemon=True)

    def start(self, before_step: Hook, after_step: Hook) -> None:
        self._before, self._after = before_step, after_step
        self._pilot = MavlinkPilot(self._pilot_connection, follow=self._reported.append)
        self.controls: Controls = _RemoteControls(self._pilot, self._vehicle)
        self._thread.start()

    def stop(self) -> None:
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
        if self._pilot is not None:
            self._pilot.close()

    @property
    def now_s(self) -> float:
        now_s = self._clock.now_s()
        return self._vehicle.time_s if now_s is None else now_s

    def _run(self) -> None:
        """One pose after the other; each is a step of the physics for those who look on."""
        assert self._pilot is not None
        asked_s = -ASK_POSES_S
        while not self._stop.is_set():
            self._pilot.listen(POSE_WAIT_S)
            if time.monotonic() - asked_s > ASK_POSES_S and time.monotonic() - self._taken_s > ASK_POSES_S:
                asked_s = time.monotonic()
                self._pilot.ask_poses()
            while self._reported:
                self._take(self._reported.popleft())

    def _take(self, message: Any) -> None:
        if message.get_type() != "ODOMETRY":
            self._followed.true_pose(message)
            return
        self._before(self._vehicle.time_s)
        if self._followed.odometry(message):
            self._taken_s = time.monotonic()
            self._clock.feed(self._vehicle.time_s, self._taken_s)
            self._after(self._vehicle.time_s)


class _RemoteControls:
    """The controls of an autopilot at the other end of a link."""

    def __init__(self, pilot: MavlinkPilot, vehicle: Multirotor) -> None:
        self._pilot = pilot
        self.vehicle = vehicle

    def listen(self) -> None:
        self._pilot.listen()

    def get_ready(self) -> bool:
        self._pilot.get_ready()
        return self._pilot.may_arm

    def get_airborne(self, height_m: float) -> None:
        self._pilot.get_airborne(height_m)

    def fly(self, velocity: tuple[float, float, float], yaw: float) -> None:
        if self._pilot.mode_name == "GUIDED":
            self._pilot.fly(velocity, yaw)

    def set_mode(self, name: str) -> None:
        self._pilot.set_mode(name)

    def set_channel(self, channel: int, pulse_us: int) -> None:
        self._pilot.set_channel(channel, pulse_us)
