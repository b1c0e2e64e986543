"""What the simulated autopilot believes of itself: the truth with gyro noise and bias and a slow attitude error."""

import math
import random
from dataclasses import dataclass, field

from drivers.simulated.vehicle.quaternion import Quaternion, Vector, from_euler, multiply
from drivers.simulated.vehicle.vehicle import Multirotor


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """Standard deviations; 0 is a perfect sensor."""

    gyro_noise: float = 0.0
    """White noise of one reading, rad/s."""
    gyro_bias: float = 0.0
    """A constant a flight, drawn once per axis, rad/s."""
    attitude_error: float = 0.0
    """Of roll and pitch (yaw: twice as much), rad; wanders with ``attitude_time_s`` as an EKF's error does."""
    attitude_time_s: float = 8.0
    velocity_noise: float = 0.0
    """m/s, white."""
    velocity_error: float = 0.0
    """m/s, wanders as the attitude's error."""
    velocity_lag_s: float = 0.0
    """Time constant of a filter that follows the velocity slowly, as with a weak GPS; 0: none."""
    velocity_scale: float = 1.0
    """Of the reported velocity; zeros came from an ArduCopter whose EKF had no source of velocity, in SITL."""


@dataclass(slots=True)
class Sensors:
    """Readings of one vehicle; ``step`` lets the slow errors wander."""

    vehicle: Multirotor
    errors: SensorErrors = field(default_factory=SensorErrors)
    seed: int = 2
    _random: random.Random = field(init=False, repr=False)
    _bias: Vector = field(init=False)
    _tilt: list[float] = field(init=False)
    _drift: list[float] = field(init=False)
    _slow: Vector = field(init=False)

    def __post_init__(self) -> None:
        self._random = random.Random(self.seed)
        e, draw = self.errors, self._random.gauss
        self._bias = (draw(0, e.gyro_bias), draw(0, e.gyro_bias), draw(0, e.gyro_bias))
        self._tilt = [draw(0, e.attitude_error), draw(0, e.attitude_error), draw(0, 2 * e.attitude_error)]
        self._drift = [draw(0, e.velocity_error) for _ in range(3)]
        self._slow = self.vehicle.velocity

    def step(self, dt: float) -> None:
        """Advance the slow errors by ``dt`` seconds."""
        e = self.errors
        follows = 1.0 if e.velocity_lag_s <= 0 else 1.0 - math.exp(-dt / e.velocity_lag_s)
        now, slow = self.vehicle.velocity, self._slow
        self._slow = (
            slow[0] + follows * (now[0] - slow[0]),
            slow[1] + follows * (now[1] - slow[1]),
            slow[2] + follows * (now[2] - slow[2]),
        )
        if e.attitude_error <= 0.0 and e.velocity_error <= 0.0:
            return
        keep = math.exp(-dt / e.attitude_time_s)
        kick = math.sqrt(1.0 - keep * keep)
        for i in range(3):
            share = 2.0 if i == 2 else 1.0
            self._tilt[i] = keep * self._tilt[i] + self._random.gauss(0, kick * share * e.attitude_error)
            self._drift[i] = keep * self._drift[i] + self._random.gauss(0, kick * e.velocity_error)

    def gyro(self) -> Vector:
        """Body rates in rad/s, FRD."""
        noise, n = self._random.gauss, self.errors.gyro_noise
        r, b = self.vehicle.rates, self._bias
        return (r[0] + b[0] + noise(0, n), r[1] + b[1] + noise(0, n), r[2] + b[2] + noise(0, n))

    def attitude(self) -> Quaternion:
        """ned_from_body as estimated."""
        return multiply(from_euler(*self._tilt), self.vehicle.attitude)

    def velocity(self) -> Vector:
        """NED, m/s, as estimated."""
        noise, n = self._random.gauss, self.errors.velocity_noise
        v = self.vehicle.velocity if self.errors.velocity_lag_s <= 0 else self._slow
        d, scale = self._drift, self.errors.velocity_scale
        north, east, down = (scale * (v[i] + d[i] + noise(0, n)) for i in range(3))
        return (north, east, down)
