"""A simulated multirotor as a rigid body: attitude loop, thrust along the body axis, drag, wind, ground contact.

In: a command for attitude and thrust, or for the rotors, at every step. Out: position and velocity (world NED, m and
m/s), attitude (quaternion ned_from_body), body rates (body FRD, rad/s), specific force (m/s^2) and touchdowns. Plain
floats are used instead of arrays, because a step then costs only some 15 microseconds. The same seed and the same
commands give the same flight, bit for bit.
"""

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field

from drivers.errors import DriverError
from drivers.samples import GRAVITY
from drivers.simulated.vehicle.quaternion import (
    Quaternion,
    Vector,
    from_euler,
    multiply,
    normalised,
    rotate,
    to_euler,
)

LIFT_OFF = 1.05
"""Vertical thrust over weight at which a standing vehicle leaves the ground."""
HOP_S = 0.3
"""A contact after a shorter time in the air does not count as a touchdown."""
Ground = Callable[[float, float], float]
"""Height of the surface in m, up, at (north, east)."""


def level_ground(north: float, east: float) -> float:
    """The plane at height 0."""
    return 0.0


@dataclass(frozen=True, slots=True)
class Airframe:
    """Constants of the airframe; the defaults fit a quadrotor of some 1.5 kg."""

    attitude_gain: float = 8.0
    """Commanded body rate per radian of attitude error, 1/s."""
    rate_lag_s: float = 0.05
    """Time constant with which the body rates follow their command."""
    thrust_lag_s: float = 0.04
    """Time constant with which thrust and torques follow theirs."""
    max_rate: float = 4.0
    """Largest roll or pitch rate, rad/s."""
    max_yaw_rate: float = 1.5
    max_thrust: float = 2.2 * GRAVITY
    """Largest thrust over mass, m/s^2."""
    drag: float = 0.35
    """Linear drag over mass against the air, 1/s."""
    spin_damping: float = 1.0
    """Decay of the body rates without torque, 1/s; counts with RotorCommand only."""
    leg_m: float = 0.12
    """Body's reference point (and camera) above the ground when it stands."""
    leg_span_m: float = 0.4
    """Distance between the legs; the tilt of the ground below a standing vehicle is measured over it."""


@dataclass(frozen=True, slots=True)
class Wind:
    """Mean wind (m/s, the direction in which the air moves), gusts, and body rates from turbulence."""

    north: float = 0.0
    east: float = 0.0
    gust_std: float = 0.0
    """Standard deviation of the gusts per horizontal axis, m/s; a third of it vertically."""
    gust_time_s: float = 1.5
    shake_std: float = 0.0
    """Standard deviation of the body rates that turbulence adds to the commanded ones, rad/s."""


@dataclass(slots=True)
class AttitudeCommand:
    """What the flight controller commands, when the attitude loop is the airframe's."""

    attitude: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """ned_from_body."""
    thrust: float = 0.0
    """Thrust over mass along body -z, m/s^2; 0 with the motors off."""


@dataclass(frozen=True, slots=True)
class RotorCommand:
    """What the rotors do, when an external autopilot closes the attitude loop."""

    thrust: float
    """Sum over mass along body -z, m/s^2."""
    spin: Vector
    """Angular acceleration in body axes, rad/s^2."""


@dataclass(frozen=True, slots=True)
class TouchDown:
    """A touchdown: time, place and speed at the contact."""

    time_s: float
    position: Vector
    velocity: Vector
    """Just before the contact."""
    ground_tilt_rad: float
    """The ground's inclination over the leg span."""


@dataclass(slots=True)
class Multirotor:
    """The vehicle's true state; ``step`` advances it by ``dt`` seconds."""

    airframe: Airframe = field(default_factory=Airframe)
    wind: Wind = field(default_factory=Wind)
    ground: Ground = level_ground
    highest_ground: float = math.inf
    """No ground is higher (m, up): above it the height of the ground is not computed, which saves time."""
    seed: int = 1
    position: Vector = (0.0, 0.0, 0.0)
    velocity: Vector = (0.0, 0.0, 0.0)
    attitude: Quaternion = (1.0, 0.0, 0.0, 0.0)
    rates: Vector = (0.0, 0.0, 0.0)
    """Body rates, rad/s."""
    specific_force: Vector = (0.0, 0.0, -GRAVITY)
    """What an accelerometer measures: acceleration without gravity, body axes, m/s^2."""
    thrust: float = 0.0
    """Over mass, m/s^2; it follows the command with a lag."""
    time_s: float = 0.0
    on_ground: bool = True
    touch_downs: list[TouchDown] = field(default_factory=list)
    gust: Vector = (0.0, 0.0, 0.0)
    shake: Vector = (0.0, 0.0, 0.0)
    _lifted_s: float = 0.0
    _spin: Vector = (0.0, 0.0, 0.0)
    _random: random.Random = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._random = random.Random(self.seed)
        if self.on_ground:
            self.place(self.position[0], self.position[1], yaw=self.euler[2])

    def place(
        self,
        north: float,
        east: float,
        height: float | None = None,
        yaw: float = 0.0,
        velocity: Vector = (0, 0, 0),
    ) -> None:
        """Stand on the ground at (north, east), or hang ``height`` m above it with a velocity."""
        below = self.ground(north, east)
        up = below + (self.airframe.leg_m if height is None else height)
        if height is not None and height < self.airframe.leg_m:
            raise DriverError(
                f"start height {height} m is below the legs' {self.airframe.leg_m} m; start higher"
            )
        self.position = (north, east, -up)
        self.velocity = velocity
        self.rates = (0.0, 0.0, 0.0)
        self.on_ground = height is None
        self.thrust = 0.0 if self.on_ground else GRAVITY
        self.attitude = self._standing_attitude(yaw) if self.on_ground else from_euler(0.0, 0.0, yaw)

    @property
    def euler(self) -> Vector:
        """Roll, pitch, yaw, rad."""
        return to_euler(self.attitude)

    @property
    def height_above_ground(self) -> float:
        """Of the body's reference point, m."""
        return -self.position[2] - self.ground(self.position[0], self.position[1])

    def step(self, dt: float, command: AttitudeCommand | RotorCommand) -> None:
        """Advance by ``dt`` seconds under a constant command (explicit Euler, trapezoidal for the position)."""
        self.time_s += dt
        self._blow(dt)
        body = self.airframe
        self.thrust += (min(max(command.thrust, 0.0), body.max_thrust) - self.thrust) * min(
            1.0, dt / body.thrust_lag_s
        )
        lift = rotate(self.attitude, (0.0, 0.0, -self.thrust))
        if self.on_ground:
            if -lift[2] <= GRAVITY * LIFT_OFF or command.thrust <= 0.0:
                self._stand(dt)
                return
            self.on_ground = False
            self._lifted_s = self.time_s
        self._turn(dt, command)
        w, v, g = self.wind, self.velocity, self.gust
        drag = (
            -body.drag * (v[0] - w.north - g[0]),
            -body.drag * (v[1] - w.east - g[1]),
            -body.drag * (v[2] - g[2]),
        )
        force = (lift[0] + drag[0], lift[1] + drag[1], lift[2] + drag[2])
        q = self.attitude
        self.specific_force = rotate((q[0], -q[1], -q[2], -q[3]), force)
        acceleration = (force[0], force[1], force[2] + GRAVITY)
        new = (v[0] + acceleration[0] * dt, v[1] + acceleration[1] * dt, v[2] + acceleration[2] * dt)
        p = self.position
        self.position = (
            p[0] + 0.5 * (v[0] + new[0]) * dt,
            p[1] + 0.5 * (v[1] + new[1]) * dt,
            p[2] + 0.5 * (v[2] + new[2]) * dt,
        )
        self.velocity = new
        if -self.position[2] - body.leg_m > self.highest_ground:
            return
        if self.height_above_ground < body.leg_m and self._sinking_into_ground():
            self._touch()

    def _sinking_into_ground(self) -> bool:
        """Whether vehicle and ground approach each other: over an edge they can, although the vehicle flies level."""
        n, e, _ = self.position
        vn, ve, vd = self.velocity
        ahead = 0.01
        rise = (self.ground(n + vn * ahead, e + ve * ahead) - self.ground(n, e)) / ahead
        return -vd - rise < 0.05

    def _touch(self) -> None:
        n, e, _ = self.position
        if self.time_s - self._lifted_s > HOP_S:
            self.touch_downs.append(
                TouchDown(self.time_s, self.position, self.velocity, self._ground_tilt(n, e))
            )
        self.position = (n, e, -(self.ground(n, e) + self.airframe.leg_m))
        self.velocity = (0.0, 0.0, 0.0)
        self.on_ground = True

    def _ground_slopes(self, north: float, east: float) -> tuple[float, float]:
        """Rise over run to the north and to the east, over the leg span."""
        half = self.airframe.leg_span_m / 2
        to_north = (self.ground(north + half, east) - self.ground(north - half, east)) / (2 * half)
        to_east = (self.ground(north, east + half) - self.ground(north, east - half)) / (2 * half)
        return to_north, to_east

    def _ground_tilt(self, north: float, east: float) -> float:
        return math.atan(math.hypot(*self._ground_slopes(north, east)))

    def _standing_attitude(self, yaw: float) -> Quaternion:
        """The attitude of a vehicle that stands on the slope below it with the given heading."""
        to_north, to_east = self._ground_slopes(self.position[0], self.position[1])
        ahead = to_north * math.cos(yaw) + to_east * math.sin(yaw)
        aside = -to_north * math.sin(yaw) + to_east * math.cos(yaw)
        pitch = math.atan(ahead)
        return from_euler(-math.atan(aside * math.cos(pitch)), pitch, yaw)

    def _stand(self, dt: float) -> None:
        """At rest on the ground: the attitude settles to the slope within some 0.1 s."""
        target = self._standing_attitude(self.euler[2])
        mix = min(1.0, dt / 0.1)
        sign = 1.0 if sum(a * b for a, b in zip(self.attitude, target, strict=True)) >= 0 else -1.0
        a = self.attitude
        self.attitude = normalised(
            (
                a[0] + mix * (sign * target[0] - a[0]),
                a[1] + mix * (sign * target[1] - a[1]),
                a[2] + mix * (sign * target[2] - a[2]),
                a[3] + mix * (sign * target[3] - a[3]),
            )
        )
        self.rates = (0.0, 0.0, 0.0)
        self.velocity = (0.0, 0.0, 0.0)
        q = self.attitude
        self.specific_force = rotate((q[0], -q[1], -q[2], -q[3]), (0.0, 0.0, -GRAVITY))

    def _turn(self, dt: float, command: AttitudeCommand | RotorCommand) -> None:
        q = self.attitude
        if isinstance(command, RotorCommand):
            self._spin_up(dt, command)
        else:
            self._pursue(dt, command)
        r, half = self.rates, 0.5 * dt
        self.attitude = normalised(multiply(q, (1.0, r[0] * half, r[1] * half, r[2] * half)))

    def _spin_up(self, dt: float, command: RotorCommand) -> None:
        """Angular acceleration with the rotors' lag, turbulence and damping -> body rates."""
        body, r = self.airframe, self.rates
        mix = min(1.0, dt / body.thrust_lag_s)
        a, b = self._spin, command.spin
        self._spin = (a[0] + (b[0] - a[0]) * mix, a[1] + (b[1] - a[1]) * mix, a[2] + (b[2] - a[2]) * mix)
        push = tuple(
            self._spin[i] + self.shake[i] / body.rate_lag_s - body.spin_damping * r[i] for i in range(3)
        )
        self.rates = (r[0] + push[0] * dt, r[1] + push[1] * dt, r[2] + push[2] * dt)

    def _pursue(self, dt: float, command: AttitudeCommand) -> None:
        """Attitude error -> wanted body rates -> rates with a lag."""
        body, q = self.airframe, self.attitude
        error = multiply((q[0], -q[1], -q[2], -q[3]), command.attitude)
        gain = 2.0 * body.attitude_gain * (1.0 if error[0] >= 0 else -1.0)
        limits = (body.max_rate, body.max_rate, body.max_yaw_rate)
        mix = min(1.0, dt / body.rate_lag_s)
        r, s = self.rates, self.shake
        wanted = [min(max(gain * error[i + 1], -limits[i]), limits[i]) + s[i] for i in range(3)]
        self.rates = (
            r[0] + (wanted[0] - r[0]) * mix,
            r[1] + (wanted[1] - r[1]) * mix,
            r[2] + (wanted[2] - r[2]) * mix,
        )

    def _blow(self, dt: float) -> None:
        """Gusts and turbulence as Ornstein-Uhlenbeck processes."""
        w = self.wind
        if w.gust_std > 0.0:
            keep = math.exp(-dt / w.gust_time_s)
            kick = w.gust_std * math.sqrt(1.0 - keep * keep)
            noise = self._random.gauss
            g = self.gust
            self.gust = (
                g[0] * keep + noise(0, kick),
                g[1] * keep + noise(0, kick),
                g[2] * keep + noise(0, kick / 3),
            )
        if w.shake_std > 0.0:
            keep = math.exp(-dt / 0.15)
            kick = w.shake_std * math.sqrt(1.0 - keep * keep)
            noise = self._random.gauss
            s = self.shake
            self.shake = (
                s[0] * keep + noise(0, kick),
                s[1] * keep + noise(0, kick),
                s[2] * keep + noise(0, kick / 3),
            )
