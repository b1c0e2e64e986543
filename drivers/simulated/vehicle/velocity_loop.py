"""The loop from a velocity that is asked for to the attitude and thrust that give it."""

import math
from dataclasses import dataclass

from drivers.samples import GRAVITY
from drivers.simulated.vehicle.quaternion import Vector, from_thrust_and_yaw
from drivers.simulated.vehicle.vehicle import AttitudeCommand, Multirotor


@dataclass(frozen=True, slots=True)
class FlightGains:
    """Loops around the airframe; defaults near ArduCopter's."""

    position: float = 1.0
    """Velocity asked for per metre of error, 1/s."""
    velocity: float = 2.2
    """Acceleration per velocity error, 1/s."""
    velocity_integral: float = 0.8
    """1/s^2; takes out the wind."""
    vertical: float = 4.0
    max_tilt: float = math.radians(30)
    max_speed: float = 5.0
    max_climb: float = 2.5
    max_sink: float = 1.5
    max_acceleration: float = 4.0
    """Horizontal, of the velocity asked for, m/s^2."""
    braking: float = 2.5
    """Deceleration that a stopping point is computed with, m/s^2 (WPNAV_ACCEL)."""
    land_speed: float = 0.5
    land_speed_high: float = 1.5
    """Above ``land_slow_below_m`` over home."""
    land_slow_below_m: float = 10.0
    rtl_altitude_m: float = 15.0
    disarm_delay_s: float = 10.0
    landed_disarm_s: float = 1.0


class VelocityLoop:
    """Acceleration-limited velocity, proportional and integral; its memory is the wind's share."""

    def __init__(self, vehicle: Multirotor, gains: FlightGains) -> None:
        self._vehicle, self._gains = vehicle, gains
        self._shaped: Vector = (0.0, 0.0, 0.0)
        """The velocity asked for, after the acceleration limit."""
        self._integral = [0.0, 0.0, 0.0]

    def trim(self, yaw: float) -> None:
        """Lean into the mean wind as a vehicle does that has hung in it for a while."""
        vehicle, wind = self._vehicle, self._vehicle.wind
        north = vehicle.airframe.drag * (vehicle.velocity[0] - wind.north)
        east = vehicle.airframe.drag * (vehicle.velocity[1] - wind.east)
        self._integral = [north, east, 0.0]
        self._shaped = vehicle.velocity
        vehicle.attitude = from_thrust_and_yaw((north, east, -GRAVITY), yaw)
        vehicle.thrust = math.sqrt(north * north + east * east + GRAVITY * GRAVITY)

    def take_over(self) -> None:
        """Begin from the velocity there is; on the ground from nothing."""
        if self._vehicle.on_ground:
            self._shaped = (0.0, 0.0, 0.0)
            self._integral = [0.0, 0.0, 0.0]
        else:
            self._shaped = self._vehicle.velocity

    def command(self, wanted: Vector, yaw: float, dt: float) -> AttitudeCommand:
        """Attitude and thrust for a velocity (NED) and a heading; to be called every ``dt`` seconds."""
        g, v = self._gains, self._vehicle.velocity
        step = g.max_acceleration * dt
        dn, de = wanted[0] - self._shaped[0], wanted[1] - self._shaped[1]
        size = math.hypot(dn, de)
        shrink = 1.0 if size <= step else step / size
        dd = min(max(wanted[2] - self._shaped[2], -step), step)
        self._shaped = (
            self._shaped[0] + dn * shrink,
            self._shaped[1] + de * shrink,
            self._shaped[2] + dd,
        )
        error = [self._shaped[i] - v[i] for i in range(3)]
        if not self._vehicle.on_ground:
            for i in range(2):
                self._integral[i] = min(max(self._integral[i] + g.velocity_integral * error[i] * dt, -5), 5)
        n = g.velocity * error[0] + self._integral[0]
        e = g.velocity * error[1] + self._integral[1]
        limit = math.tan(g.max_tilt) * GRAVITY
        size = math.hypot(n, e)
        if size > limit:
            n, e = n * limit / size, e * limit / size
        up = self._climb_acceleration(-self._shaped[2], dt) + GRAVITY
        attitude = from_thrust_and_yaw((n, e, -GRAVITY), yaw)
        return AttitudeCommand(attitude, up / self._lift_share())

    def thrust_for_climb(self, climb: float, dt: float) -> float:
        """Thrust for a rate of climb at whatever attitude there is."""
        self._shaped = (self._vehicle.velocity[0], self._vehicle.velocity[1], -climb)
        return (GRAVITY + self._climb_acceleration(climb, dt)) / self._lift_share()

    def _climb_acceleration(self, climb: float, dt: float) -> float:
        error = climb + self._vehicle.velocity[2]
        if not self._vehicle.on_ground:
            self._integral[2] = min(max(self._integral[2] + 1.0 * error * dt, -4), 4)
        return min(max(self._gains.vertical * error + self._integral[2], -5.0), 5.0)

    def _lift_share(self) -> float:
        """Cosine of the tilt, bounded: tilting loses lift."""
        _, x, y, _ = self._vehicle.attitude
        return max(0.5, 1 - 2 * (x * x + y * y))


def stopping_point(vehicle: Multirotor, gains: FlightGains) -> Vector:
    """Where ArduCopter's LAND goes: as far ahead as its position controller needs to stop, not back to here.

    AC_PosControl's stopping point: linear up to the speed at which the deceleration is ``braking``.
    """
    v, (north, east, down) = vehicle.velocity, vehicle.position
    speed, gain, braking = math.hypot(v[0], v[1]), gains.position, gains.braking
    linear = braking / gain
    slow = speed <= linear
    away_s = 1 / gain if slow else (linear / (2 * gain) + speed * speed / (2 * braking)) / speed
    return (north + v[0] * away_s, east + v[1] * away_s, down)
