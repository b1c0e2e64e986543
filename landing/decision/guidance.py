"""The velocities that the landing procedure asks for: limited speed and acceleration, weave, spiral, descent.

The descent keeps the divergence constant: sink over height, D = v / h (de Croon 2016, "Distance estimation with
efference copies and optical flow maneuvers"; half of an estimate's divergence). A fixed gain on the error of D makes
a vehicle with any delay oscillate below some height, since the same speed changes D by 1 / h; the gain is scheduled
by the height, which is known here (Ho, de Croon, van Kampen, Chu, Mulder 2018, "Adaptive gain control strategy for
constant optical flow divergence landing").
"""

import math

from landing.decision.orders import STILL, Inputs, Vector

ACCELERATION = 1.2
"""Largest change of the velocity asked for, m/s^2, horizontal and vertical."""
LEAD_S = 0.4
"""How much earlier a velocity is asked for than it is to be flown: lag of the vehicle and delay of the pictures."""
POSITION_GAIN = 0.9
"""Speed per metre off the place, 1/s: slower than a velocity loop with its lag and the delay of pictures."""
DIVERGENCE_GAIN, DIVERGENCE_INTEGRAL = 0.4, 0.3
"""Share of an error of the divergence that is answered at once, and in a second (1/s)."""
MOST_CORRECTION = 0.5
"""Most that both make of the divergence asked for: pictures that say more are not believed."""
WEAVE_SHARE, WEAVE_PERIOD_S = 0.18, 6.0
"""Radius of the circle on which the vehicle comes down, over its height, and how long a round takes. Straight below a
straight descent the view shows no relief (it is the focus of expansion), so nothing would be known there. A velocity
loop follows a turn of one radian in a second; a faster one it exaggerates."""
WEAVE_ACCELERATION = 0.5 * ACCELERATION
"""The circle's own: the rest is left for gusts."""
WEAVE_GROWTH = 0.3
"""Largest change of its radius, m/s."""

SPIRAL_NEAR_M, SPIRAL_WAITS_S = 1.5, 4.0
"""A place on the spiral waits for a vehicle that is farther away; so long, for it may lie behind fence or roof."""


def towards(from_ned: Vector, to_ned: Vector, speed: float) -> tuple[float, float]:
    """Horizontal velocity to a place, at most ``speed``, such that it can be stopped there."""
    north, east = to_ned[0] - from_ned[0], to_ned[1] - from_ned[1]
    way = math.hypot(north, east)
    if not way > 0:
        return 0.0, 0.0
    asked = min(POSITION_GAIN * way, math.sqrt(ACCELERATION * way), speed)
    return north / way * asked, east / way * asked


def limited(velocity: Vector, speed: float) -> Vector:
    """The velocity, its horizontal and vertical parts at most ``speed`` each; no speed for what is no number."""
    if not all(map(math.isfinite, velocity)):
        return STILL
    north, east, down = map(float, velocity)
    size = math.hypot(north, east)
    shrink = 1.0 if size <= speed else speed / size
    return north * shrink, east * shrink, min(max(down, -speed), speed)


class Shaper:
    """Velocities asked for change no faster than ``ACCELERATION``."""

    def __init__(self) -> None:
        self.velocity = STILL
        self._time_s = math.nan

    def begin(self, time_s: float, velocity: Vector) -> None:
        """From the velocity there is."""
        self.velocity, self._time_s = velocity, time_s

    def step(self, time_s: float, wanted: Vector, speed: float) -> Vector:
        """The velocity to ask for now."""
        dt = time_s - self._time_s
        self._time_s = time_s
        most = ACCELERATION * min(max(dt, 0.0), 0.5) if math.isfinite(dt) else 0.0
        wanted, now = limited(wanted, speed), limited(self.velocity, speed)
        north, east = wanted[0] - now[0], wanted[1] - now[1]
        size = math.hypot(north, east)
        share = 1.0 if size <= most else most / size
        down = min(max(wanted[2] - now[2], -most), most)
        self.velocity = limited((now[0] + north * share, now[1] + east * share, now[2] + down), speed)
        return self.velocity


class Descent:
    """Sink at a constant divergence, and the circle that keeps the ground below known."""

    def __init__(self, divergence: float) -> None:
        self._divergence = divergence
        self._sum = 0.0
        self._time_s = self._round_s = math.nan
        self._turned = self._radius = 0.0

    def begin(self, time_s: float) -> None:
        """Of a new descent; the circle goes on."""
        self._sum, self._time_s = 0.0, time_s

    def sink(self, time_s: float, height_m: float, approach: float, share: float) -> float:
        """Speed down, m/s. ``approach`` 1/s: what the view shows of it; ``share`` of the divergence to come down by."""
        dt = min(max(time_s - self._time_s, 0.0), 0.5) if math.isfinite(self._time_s) else 0.0
        self._time_s = time_s
        if not math.isfinite(height_m):
            return 0.0
        asked = self._divergence * share
        error = asked - approach if math.isfinite(approach) else 0.0
        most = MOST_CORRECTION * asked
        if abs(error) < most:
            # beyond, the sink is still being taken up
            self._sum = min(max(self._sum + DIVERGENCE_INTEGRAL * error * dt, -most), most)
        correction = min(max(DIVERGENCE_GAIN * error + self._sum, -most), most)
        return max(height_m, 0.0) * math.exp(-asked * LEAD_S) * (asked + correction)

    def circle(self, time_s: float, height_m: float, share: float, speed: float) -> tuple[Vector, Vector]:
        """Offset from the place, and its velocity. ``share`` of the usual radius; ``speed`` most of it."""
        dt = min(max(time_s - self._round_s, 0.0), 0.5) if math.isfinite(self._round_s) else 0.0
        self._round_s = time_s
        rate = 2 * math.pi / WEAVE_PERIOD_S
        radius = 0.0
        if math.isfinite(height_m):
            radius = min(WEAVE_SHARE * height_m * share, speed / rate, WEAVE_ACCELERATION / rate**2)
        most = WEAVE_GROWTH * dt
        self._radius += min(max(radius - self._radius, -most), most)
        self._turned += rate * dt
        cos, sin = math.cos(self._turned), math.sin(self._turned)
        lead = self._turned + rate * LEAD_S
        along = self._radius * rate
        offset = self._radius * cos, self._radius * sin, 0.0
        return offset, (-along * math.sin(lead), along * math.cos(lead), 0.0)

    def around(self, i: Inputs, spot: Vector, share: float, speed: float) -> tuple[float, float]:
        """Velocity along the circle about the place on which its ground shows; ``share`` of the usual radius."""
        offset, along = self.circle(i.time_s, i.height_m, share, 0.5 * speed)
        aim = spot[0] + offset[0], spot[1] + offset[1], spot[2]
        north, east = towards(i.place_ned, aim, speed)
        return north + along[0], east + along[1]


class Spiral:
    """An Archimedean spiral about a place, flown at constant speed; its arms lie ``arm_m`` apart."""

    def __init__(self, middle: Vector, arm_m: float, time_s: float) -> None:
        self._middle, self._per_turn, self._time_s = middle, arm_m / (2 * math.pi), time_s
        self._angle, self._waited_s = 1.0, 0.0

    @property
    def radius_m(self) -> float:
        """How far out it has come."""
        return self._per_turn * self._angle

    @property
    def point(self) -> Vector:
        """The place on it now."""
        north, east, down = self._middle
        r, angle = self.radius_m, self._angle
        return north + r * math.cos(angle), east + r * math.sin(angle), down

    def velocity(self, speed: float) -> tuple[float, float]:
        """Along it, there."""
        r, per_turn, cos, sin = self.radius_m, self._per_turn, math.cos(self._angle), math.sin(self._angle)
        along = math.hypot(r, per_turn)
        return speed * (per_turn * cos - r * sin) / along, speed * (per_turn * sin + r * cos) / along

    def go_on(self, time_s: float, speed: float, off_m: float) -> bool:
        """The place moves along, unless the vehicle is ``off_m`` away and may still come; whether it does."""
        dt = min(max(time_s - self._time_s, 0.0), 0.5)
        self._time_s = time_s
        self._waited_s = 0.0 if off_m < SPIRAL_NEAR_M else self._waited_s + dt
        if 0 < self._waited_s <= SPIRAL_WAITS_S:
            return False
        self._angle += speed * dt / math.hypot(self.radius_m, self._per_turn)
        return off_m < SPIRAL_NEAR_M
