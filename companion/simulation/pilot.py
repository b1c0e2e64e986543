"""The pilot of a scenario: flies its legs until somebody else takes over, and turns the switch on."""

import math

from companion.simulation.hardware import Controls
from companion.simulation.scenario import ENABLE_CHANNEL, Leg, Scenario

SETPOINT_S = 0.05
SWITCH_OFF_US, SWITCH_ON_US = 1000, 2000
SWITCH_EVERY_S = 0.5
"""How often the switch's position is sent: an override over a link expires."""
REACHED = 0.95
"""Share of the takeoff's height at which the legs begin."""
HEIGHT_GAIN = 1.2
"""Climb per metre of height that is missing, 1/s."""
MAX_FOLLOW_M_S = 1.2
"""Fastest climb or sink with which a height over the ground is followed."""
SMOOTHED_S = (-0.5, -0.25, 0.0, 0.25, 0.5)
"""Places on the way, in seconds of flight, over which the ground's height is averaged."""


class Pilot:
    """Flies the legs in GUIDED; knows the ground below as a range finder does.

    ``airborne``: the vehicle hangs in the air already, the legs begin at once.
    """

    def __init__(self, scenario: Scenario, controls: Controls, airborne: bool) -> None:
        self._legs = scenario.legs
        self._takeoff_m = scenario.start.take_off_m
        self._airborne = airborne
        self._controls = controls
        self._mode_changes = [f for f in scenario.faults if f.kind == "mode_change"]
        self._heading = math.radians(scenario.start.heading_deg)
        self._enable_s = scenario.pilot.switch_on_s
        self._next_s = self._switch_s = self._wait_s = 0.0
        self._legs_from_s: float | None = None
        self._may_arm = False
        self._begins_in_air = scenario.start.height_m > 0
        self.ready = False
        """Whether the flight may begin: it may be armed, and hangs in the air where the scenario begins there."""
        self.gave_away = False
        """Whether the landing procedure has the setpoints: the pilot's program sends none any more."""

    @property
    def flying(self) -> bool:
        """Whether the legs have begun."""
        return self._legs_from_s is not None

    def wait(self, time_s: float) -> None:
        """To be called before every step of the physics until the flight begins: the switch is off."""
        if time_s < self._wait_s:
            return
        self._wait_s = time_s + SETPOINT_S
        self._controls.listen()
        self._controls.set_channel(ENABLE_CHANNEL, SWITCH_OFF_US)
        if not self._may_arm:
            self._may_arm = self._controls.get_ready()
        elif not self.ready:
            self.ready = not self._begins_in_air or self._get_airborne(0.0)

    def step(self, time_s: float) -> None:
        """To be called before every step of the physics, with the time of the flight."""
        if time_s < self._next_s:
            return
        self._next_s = time_s + SETPOINT_S
        self._controls.listen()
        if time_s >= self._switch_s:
            self._switch_s = time_s + SWITCH_EVERY_S
            self._controls.set_channel(
                ENABLE_CHANNEL, SWITCH_ON_US if time_s >= self._enable_s else SWITCH_OFF_US
            )
        for change in [c for c in self._mode_changes if time_s >= c.at_s]:
            self._mode_changes.remove(change)
            self._controls.set_mode(change.mode)
            return
        if self._legs_from_s is None and not self._get_airborne(time_s):
            return
        leg = self._leg(time_s - (self._legs_from_s or 0.0))
        if leg is not None and not self.gave_away:
            self._fly(leg)

    def _get_airborne(self, time_s: float) -> bool:
        if self._airborne or self._controls.vehicle.height_above_ground > REACHED * self._takeoff_m:
            self._legs_from_s = time_s
            return True
        self._controls.get_airborne(self._takeoff_m)
        return False

    def _leg(self, flown_s: float) -> Leg | None:
        for leg in self._legs:
            if flown_s < leg.seconds:
                return leg
            flown_s -= leg.seconds
        return None

    def _fly(self, leg: Leg) -> None:
        self._heading += math.radians(leg.turn_deg_s) * SETPOINT_S
        cos, sin = math.cos(self._heading), math.sin(self._heading)
        north = leg.forward_m_s * cos - leg.right_m_s * sin
        east = leg.forward_m_s * sin + leg.right_m_s * cos
        climb = leg.climb_m_s
        if leg.height_m > 0:
            missing = leg.height_m - self._height(north, east)
            climb = min(max(HEIGHT_GAIN * missing, -MAX_FOLLOW_M_S), MAX_FOLLOW_M_S)
        self._controls.fly((north, east, -climb), math.remainder(self._heading, 2 * math.pi))

    def _height(self, north_m_s: float, east_m_s: float) -> float:
        """Over the ground, smoothed along the way, as filters do it."""
        v = self._controls.vehicle
        n, e, down = v.position
        grounds = [v.ground(n + s * north_m_s, e + s * east_m_s) for s in SMOOTHED_S]
        return -down - sum(grounds) / len(grounds)
