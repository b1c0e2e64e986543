"""A vehicle that follows the landing procedure at once, over ground that the test chooses."""

from dataclasses import replace

from landing.decision.orders import GroundMotion, Inputs, OrderKind
from landing.decision.procedure import Procedure
from landing.decision.procedure_options import ProcedureOptions
from landing.decision.withheld import Withheld
from landing.ground.spots import HAZARD, LANDABLE, UNKNOWN, Disc, Spot

DT = 0.05
GOOD, BAD, DARK = (Disc(verdict, (), 1.0, 0.3, 0.01, 1.0) for verdict in (LANDABLE, HAZARD, UNKNOWN))
HERE = Spot(0.0, 0.0, 0.5, 1.0, 0.01, 0.8)
OPTIONS = ProcedureOptions(takeover_modes=frozenset({"GUIDED"}))


class Flight:
    """A vehicle that follows at once, over ground whose one landable disc is at ``spot`` (north, east)."""

    def __init__(self, spot=(2.0, 1.0), options=OPTIONS):
        self.machine = Procedure(options)
        self.time_s, self.place, self.velocity = 0.0, [0.0, 0.0, -4.0], (0.0, 0.0, 0.0)
        self.spot = spot
        self.now = {"objections": (), "mode": "GUIDED", "quiet": False, "below": GOOD, "at_spot": GOOD}

    def step(self, **changes):
        self.time_s += DT
        height = -self.place[2]
        found = None
        if self.spot is not None:
            found = (
                replace(HERE, north_m=self.spot[0] - self.place[0], east_m=self.spot[1] - self.place[1]),
            )
        known = {
            "time_s": self.time_s, "place_ned": tuple(self.place), "local_ned": tuple(self.place),
            "velocity_ned": self.velocity, "yaw": 0.0, "height_m": height,
            "approach": self.velocity[2] / height, "spots": found or (), "ground_motion": GroundMotion.AT_REST,
        }  # fmt: skip
        step = self.machine.step(Inputs(**{**known, **self.now, **changes}))
        if step.order.kind is OrderKind.START:
            self.now["objections"] = (Withheld.ALREADY_REQUESTED,)
        if step.order.kind is OrderKind.VELOCITY:
            self.velocity = step.order.velocity_ned
            for axis in range(3):
                self.place[axis] += self.velocity[axis] * DT
        return step

    def until(self, state, limit_s=60.0, **changes):
        end_s = self.time_s + limit_s
        while self.time_s < end_s:
            step = self.step(**changes)
            if step.state is state:
                return step
        raise AssertionError(f"no {state}: {self.machine.state} {self.machine.why}")
