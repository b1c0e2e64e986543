"""The simulated autopilot's flight modes: what a multirotor firmware does between a command and the airframe.

Numbers and behaviour are ArduCopter's. No sockets, no clock: ``step`` is called with the time that has passed.
"""

import math
from dataclasses import dataclass, field
from typing import Any

from drivers.errors import DriverError
from drivers.samples import GRAVITY
from drivers.simulated.vehicle.firmware import MODES, Firmware
from drivers.simulated.vehicle.parameters import Parameters
from drivers.simulated.vehicle.precision_landing import PrecisionLanding
from drivers.simulated.vehicle.quaternion import Quaternion, Vector, from_euler
from drivers.simulated.vehicle.vehicle import AttitudeCommand, Multirotor
from drivers.simulated.vehicle.velocity_loop import FlightGains, VelocityLoop, stopping_point

NOT_ARMABLE = ("AUTO", "RTL", "LAND", "BRAKE")
STICK_MIDDLE_US, STICK_SPAN_US, STICK_DEAD = 1500, 400, 0.05


@dataclass(slots=True)
class FlightController:
    """Modes, arming and setpoints of one vehicle."""

    vehicle: Multirotor
    gains: FlightGains = field(default_factory=FlightGains)
    firmware: Firmware = field(default_factory=Firmware)
    parameters: Parameters = field(default_factory=Parameters)
    mode: str = "STABILIZE"
    armed: bool = False
    pulse_us: list[int] = field(default_factory=lambda: [1500, 1500, 1000, 1500] + [1000] * 4 + [0] * 10)
    """The radio's channels 1 to 18; 0 where there is none."""
    home: Vector = (0.0, 0.0, 0.0)
    """NED, where it was armed last."""
    texts: list[tuple[int, str]] = field(default_factory=list)
    """What the autopilot says: (MAV_SEVERITY, text), taken away by the link."""
    _kind: str = "hold"
    """GUIDED's submode: hold, takeoff, position, velocity, attitude."""
    _target: Vector = (0.0, 0.0, 0.0)
    _target_velocity: Vector = (0.0, 0.0, 0.0)
    _target_attitude: Quaternion = (1.0, 0.0, 0.0, 0.0)
    _target_climb: float = 0.0
    _target_age_s: float = 0.0
    _yaw: float = 0.0
    _yaw_rate: float | None = None
    _idle_s: float = 0.0
    _loop: VelocityLoop = field(init=False)
    _precision: PrecisionLanding = field(init=False)

    def __post_init__(self) -> None:
        self._loop = VelocityLoop(self.vehicle, self.gains)
        self._precision = PrecisionLanding(self.parameters.values, self.texts)
        self.home = self.vehicle.position
        self._yaw = self.vehicle.euler[2]

    # -- what a ground station or a pilot asks for -------------------------------------------------------

    def set_mode(self, name: str) -> bool:
        """Switch the flight mode; False when the autopilot refuses it."""
        if name not in MODES:
            raise DriverError(f"the simulated autopilot has no mode '{name}'; it has {', '.join(MODES)}")
        if name == "AUTO":
            self.texts.append((2, "Mode change to AUTO failed: no mission"))
            return False
        if not self.firmware.takes(name, self.parameters.values):
            self.texts.append((4, f"Switching to {name} is not available"))
            return False
        if name != self.mode:
            self.mode = name
            self._hold_here()
            if name == "LAND":
                self._target = stopping_point(self.vehicle, self.gains)
            self.firmware.entered(self)
            self._precision.begin(self.vehicle)
        return True

    def landing_target(self, m: Any) -> None:
        """A LANDING_TARGET message."""
        self._precision.take(m, self.firmware.px4, self.vehicle)

    def arm(self, forced: bool = False) -> bool:
        """Start the motors; False when it may not."""
        if self.armed:
            return True
        if self.mode in NOT_ARMABLE and not forced:
            self.texts.append((2, f"Arm: {self.mode} mode not armable"))
            return False
        self.armed = True
        self.home = self.vehicle.position
        self._idle_s = 0.0
        self._hold_here()
        self.texts.append((6, "Arming motors"))
        return True

    def disarm(self, forced: bool = False) -> bool:
        """Stop the motors; refused in the air unless forced."""
        if not self.vehicle.on_ground and not forced:
            return False
        if self.armed:
            self.armed = False
            self.texts.append((6, "Disarming motors"))
        return True

    def start_airborne(self, mode: str = "GUIDED") -> None:
        """Armed and hovering where the vehicle hangs, for flights that begin in the air."""
        self.armed = True
        self.mode = mode
        self._hold_here()
        self._loop.trim(self._yaw)
        n, e, _ = self.vehicle.position
        self.home = (n, e, -(self.vehicle.ground(n, e) + self.vehicle.airframe.leg_m))

    def take_off(self, height_m: float) -> bool:
        """Climb to ``height_m`` over home; only armed, on the ground, in GUIDED."""
        if self.mode != "GUIDED" or not self.armed or not self.vehicle.on_ground or height_m <= 0:
            return False
        p = self.vehicle.position
        self._guide("takeoff")
        self._target = (p[0], p[1], self.home[2] - height_m)
        return True

    def go_to(self, position: Vector, yaw: float | None = None) -> bool:
        """Fly to a place (NED) and hold it; GUIDED, in the air."""
        self.firmware.setpoint_age_s = 0.0
        if not self._guidable():
            return False
        self._guide("position")
        self._target = position
        self._face(yaw, None)
        return True

    def fly(self, velocity: Vector, yaw: float | None = None, yaw_rate: float | None = None) -> bool:
        """Fly with a velocity (NED) until another order or GUID_TIMEOUT has passed; GUIDED, in the air."""
        self.firmware.setpoint_age_s = 0.0
        if not self._guidable():
            return False
        self._guide("velocity")
        self._target_velocity = velocity
        self._face(yaw, yaw_rate)
        return True

    def point(self, attitude: Quaternion, climb: float) -> bool:
        """Hold an attitude (ned_from_body) and a rate of climb (m/s up); GUIDED, in the air."""
        if not self._guidable():
            return False
        self._guide("attitude")
        self._target_attitude = attitude
        self._target_climb = climb
        return True

    @property
    def landed_state(self) -> str:
        """As EXTENDED_SYS_STATE names it: "on_ground", "in_air", "takeoff" or "landing"."""
        if self.vehicle.on_ground:
            return "on_ground"
        if self.mode in ("LAND", "PRECLAND"):
            return "landing"
        return "takeoff" if self.mode == "GUIDED" and self._kind == "takeoff" else "in_air"

    # -- what it makes of that ---------------------------------------------------------------------------

    def step(self, dt: float) -> AttitudeCommand:
        """The command to the airframe for the next ``dt`` seconds."""
        self.firmware.step(self, dt)
        self._precision.step(self.vehicle)
        if not self.armed:
            return AttitudeCommand(self.vehicle.attitude, 0.0)
        self._disarm_when_idle(dt)
        if self.mode == "STABILIZE":
            return self._stabilize(dt)
        if self.mode == "ALT_HOLD":
            return self._alt_hold(dt)
        wanted = self._wanted_velocity(dt)
        if wanted is None:
            return AttitudeCommand(self.vehicle.attitude, 0.3 * GRAVITY if self.armed else 0.0)
        if self.mode == "GUIDED" and self._kind == "attitude":
            return AttitudeCommand(self._target_attitude, self._loop.thrust_for_climb(-wanted[2], dt))
        return self._loop.command(wanted, self._yaw, dt)

    def _wanted_velocity(self, dt: float) -> Vector | None:
        """Velocity NED that the mode asks for; None: stay on the ground with idle motors."""
        v = self.vehicle
        if self.mode in ("LAND", "PRECLAND"):
            return None if v.on_ground else self._land()
        if self.mode == "RTL":
            return self._return_home()
        if self.mode in ("LOITER", "POSHOLD"):
            return self._loiter(dt)
        if self.mode == "BRAKE":
            if v.on_ground:
                return None
            return self._towards(self._target) if self._slow() else self._follow((0.0, 0.0, 0.0))
        return self._guided(dt)

    def _land(self) -> Vector:
        """Down where the mode began, or where LANDING_TARGET says."""
        v = self.vehicle
        high = self.home[2] - v.position[2] > self.gains.land_slow_below_m
        sink = self.gains.land_speed_high if high else self.gains.land_speed
        if self.mode == "PRECLAND":
            self._target, sinks = self._precision.precland(v)
            n, e, d = self._towards(self._target)
            return (n, e, sink if sinks else d)
        place, sinks = (None, True) if self.firmware.px4 else self._precision.land(v)
        north, east = place or self._target[:2]
        self._target = (north, east, v.position[2])
        n, e, _ = self._towards(self._target)
        return (n, e, sink if sinks else 0.0)

    def _guided(self, dt: float) -> Vector | None:
        v = self.vehicle
        if v.on_ground and self._kind != "takeoff":
            return None
        if self._kind == "takeoff":
            if abs(v.position[2] - self._target[2]) < 0.15:
                self._kind = "position"
            n, e, d = self._towards(self._target)
            return (n, e, min(d, -0.3)) if self._kind == "takeoff" else (n, e, d)
        if self._kind == "velocity":
            self._target_age_s += dt
            if self.firmware.px4 or self._target_age_s <= self._timeout_s:
                self._turn(dt)
                return self._follow(self._target_velocity)
            if not self._slow():
                return self._follow((0.0, 0.0, 0.0))
            self._hold_here()
        if self._kind == "attitude":
            self._target_age_s += dt
            if self._target_age_s <= self._timeout_s:
                self._follow(v.velocity)
                return (0.0, 0.0, -self._target_climb)
            self._hold_here()
        if self._kind == "hold" and not self._slow():
            return self._follow((0.0, 0.0, 0.0))
        return self._towards(self._target)

    @property
    def _timeout_s(self) -> float:
        """ArduCopter stops so long after the last velocity, and stays in GUIDED (measured; mode_guided.cpp)."""
        return max(self.parameters.values["GUID_TIMEOUT"], 0.1)

    def _return_home(self) -> Vector | None:
        v, home = self.vehicle, self.home
        if v.on_ground:
            return None
        away = math.hypot(v.position[0] - home[0], v.position[1] - home[1])
        if away > 1.0:
            cruise = min(home[2] - self.gains.rtl_altitude_m, self._target[2])
            if v.position[2] - cruise > 0.5:
                return self._towards((self._target[0], self._target[1], cruise))
            return self._towards((home[0], home[1], cruise))
        n, e, _ = self._towards(home)
        high = home[2] - v.position[2] > self.gains.land_slow_below_m
        return (n, e, self.gains.land_speed_high if high else self.gains.land_speed)

    def _loiter(self, dt: float) -> Vector | None:
        roll, pitch, throttle, yaw = (self._stick(i) for i in range(4))
        if self.vehicle.on_ground and throttle <= 0.1:
            return None
        self._yaw_rate = yaw * 1.5
        self._turn(dt)
        if roll == pitch == throttle == 0.0 and self._slow():
            return self._towards(self._target)
        c, s = math.cos(self._yaw), math.sin(self._yaw)
        speed = self.gains.max_speed
        ahead, aside = -pitch * speed, roll * speed
        climb = throttle * (self.gains.max_climb if throttle > 0 else self.gains.max_sink)
        return self._follow((c * ahead - s * aside, s * ahead + c * aside, -climb))

    def _stabilize(self, dt: float) -> AttitudeCommand:
        roll, pitch, throttle, yaw = (self._stick(i) for i in range(4))
        self._yaw_rate = yaw * 1.5
        self._turn(dt)
        thrust = GRAVITY * (1.0 + throttle)
        if self.pulse_us[2] <= 1100:
            thrust = 0.3 * GRAVITY
        tilt = self.gains.max_tilt
        return AttitudeCommand(from_euler(roll * tilt, pitch * tilt, self._yaw), thrust)

    def _alt_hold(self, dt: float) -> AttitudeCommand:
        roll, pitch, throttle, yaw = (self._stick(i) for i in range(4))
        if self.vehicle.on_ground and throttle <= 0.1:
            return AttitudeCommand(self.vehicle.attitude, 0.3 * GRAVITY)
        self._yaw_rate = yaw * 1.5
        self._turn(dt)
        tilt = self.gains.max_tilt
        climb = throttle * (self.gains.max_climb if throttle > 0 else self.gains.max_sink)
        return AttitudeCommand(
            from_euler(roll * tilt, pitch * tilt, self._yaw), self._loop.thrust_for_climb(climb, dt)
        )

    def _stick(self, channel: int) -> float:
        """A stick's position from -1 to 1, 0 in the dead middle."""
        value = (self.pulse_us[channel] - STICK_MIDDLE_US) / STICK_SPAN_US
        if self.pulse_us[channel] == 0 or abs(value) < STICK_DEAD:
            return 0.0
        return min(max(value, -1.0), 1.0)

    def _towards(self, target: Vector) -> Vector:
        """Velocity to a place, and the place becomes the one to hold."""
        p, g = self.vehicle.position, self.gains
        n, e, d = (g.position * (t - q) for t, q in zip(target, p, strict=True))
        speed = math.hypot(n, e)
        if speed > g.max_speed:
            n, e = n * g.max_speed / speed, e * g.max_speed / speed
        return (n, e, min(max(d, -g.max_climb), g.max_sink))

    def _follow(self, velocity: Vector) -> Vector:
        """The velocity itself, and the place passed is the one to hold afterwards."""
        self._target = self.vehicle.position
        return velocity

    def _turn(self, dt: float) -> None:
        if self._yaw_rate is not None:
            self._yaw = math.remainder(self._yaw + self._yaw_rate * dt, 2 * math.pi)

    def _face(self, yaw: float | None, yaw_rate: float | None) -> None:
        if yaw is not None:
            self._yaw = yaw
        self._yaw_rate = yaw_rate

    def _guidable(self) -> bool:
        return self.mode == "GUIDED" and self.armed and not self.vehicle.on_ground

    def _guide(self, kind: str) -> None:
        self._kind = kind
        self._target_age_s = 0.0

    def _hold_here(self) -> None:
        self._kind = "hold"
        self._target = self.vehicle.position
        self._yaw = self.vehicle.euler[2]
        self._yaw_rate = None
        self._loop.take_over()

    def _slow(self) -> bool:
        return math.hypot(self.vehicle.velocity[0], self.vehicle.velocity[1]) < 0.3

    def _disarm_when_idle(self, dt: float) -> None:
        """ArduCopter's: soon after a landing that was asked for, later when nothing happens on the ground."""
        if not self.vehicle.on_ground:
            self._idle_s = 0.0
            return
        self._idle_s += dt
        landed = self.mode in ("LAND", "RTL")
        if self._idle_s > (self.gains.landed_disarm_s if landed else self.gains.disarm_delay_s):
            self.disarm()
