"""Landing target: the autopilot lands by itself at a place that is chosen, tracked and corrected as the map grows."""

import math

from landing.decision.choice import Choice
from landing.decision.orders import Inputs, Order, OrderKind, State, Step, Vector, Why
from landing.decision.procedure_options import LOWEST_SHARE, ProcedureOptions
from landing.decision.withheld import Withheld
from landing.ground.spots import HAZARD

EXPECTED = frozenset(
    {
        Withheld.ALREADY_REQUESTED,
        Withheld.LANDING_ALREADY,
        Withheld.MODE_NOT_ALLOWED,
        Withheld.COMMAND_UNDER_WAY,
    }
)
"""Against another request, since this landing goes on."""


class Targeting:
    """``step`` at every frame. Nothing but the landing is commanded: without a target it lands as before."""

    def __init__(self, options: ProcedureOptions) -> None:
        self.options = options
        self.state, self.why = State.IDLE, Why.NO_PERMISSION
        self._choice = Choice(options.max_search_m)
        self._began = False

    @property
    def spot_ned(self) -> Vector | None:
        """The chosen place in the map's axes."""
        return self._choice.spot_ned

    @property
    def wants_spots(self) -> bool:
        """Whether the discs in view are of use at the next frame."""
        return self.state in (State.CHOOSE, State.DESCEND)

    def step(self, i: Inputs) -> Step:
        """Take a frame; times must rise."""
        before = self.state, self.why
        order = self._aim(i) if i.landing else self._wait()
        changed = (self.state, self.why) != before
        return Step(order, self.state, self.why, changed, self._choice.spot_ned, place_ned=i.place_ned)

    def watch(
        self, time_s: float, objections: tuple[Withheld, ...], mode: str | None, quiet: bool
    ) -> Step | None:
        """Between frames there is nothing to end: a target is void when it is old."""
        return None

    def _wait(self) -> Order:
        self._began = False
        self._choice.forget()
        self.state, self.why = State.IDLE, Why.NO_PERMISSION
        return Order()

    def _aim(self, i: Inputs) -> Order:
        against = any(o not in EXPECTED for o in i.objections)
        if against or i.quiet or i.contradictions or not all(map(math.isfinite, i.place_ned)):
            self._choice.forget()
            self.state, self.why = (
                State.GIVE_BACK,
                Why.CONTRADICTED if i.contradictions else Why.PERMISSION_ENDED,
            )
            return Order()
        if not self._began:
            self._choice.begin(i)
            self._began = True
        if i.height_m >= LOWEST_SHARE * self.options.hand_over_m:  # below, the target stays where it is
            self._choice.step(i)
            if i.at_spot.verdict == HAZARD:
                self._choice.refuse()
        spot = self._choice.spot_ned
        if spot is None or not math.isfinite(i.height_m):
            self.state, self.why = State.CHOOSE, Why.CHOOSING
            return Order()
        self.state, self.why = State.DESCEND, Why.COMING_DOWN
        place = i.place_ned
        return Order(OrderKind.TARGET, target_ned=(spot[0] - place[0], spot[1] - place[1], i.height_m))
