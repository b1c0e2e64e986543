"""The landing procedure: looks for a place, goes there, comes down by its flow. Pure: no clock, no I/O.

The states, each with its limit of time (``LIMIT_S``)::

    IDLE --permission, mode named, velocity known--> START --the mode follows--> LOOK
    LOOK --the ground is known--> CHOOSE --a place--> GO --over it--> DESCEND --low, over it, slow--> HAND_OVER
    CHOOSE --no place--> SEARCH --a place--> CHOOSE
    GO, DESCEND --hazard, unknown, lost--> HOLD --stopped, higher--> LOOK
    any of these --permission or mode gone, contradiction, fence, limit of time--> GIVE_BACK
    HAND_OVER, GIVE_BACK --the permission is renewed--> IDLE

Drawn with the safety case in docs/procedure.md.
"""

import math
from collections.abc import Callable

from landing.decision import procedure_options as limits
from landing.decision.arrival import beside, over, sink_share
from landing.decision.at_rest import AtRest
from landing.decision.choice import Choice
from landing.decision.fence import Fence, risen
from landing.decision.guidance import Descent, Shaper, Spiral, towards
from landing.decision.headroom import Headroom
from landing.decision.level import Level, autopilots
from landing.decision.looking import Looking, lowest_look, new_spiral
from landing.decision.orders import (
    MOVING,
    ORDER_MAX_AGE_S,
    STILL,
    Inputs,
    Order,
    OrderKind,
    State,
    Step,
    Vector,
    Why,
)
from landing.decision.procedure_options import ProcedureOptions
from landing.decision.withheld import Withheld
from landing.ground.spots import HAZARD, LANDABLE, UNKNOWN


class Procedure:
    """``step`` at every frame, ``watch`` at whatever else is heard; ``wants_spots``: whether discs are to be found."""

    def __init__(self, options: ProcedureOptions) -> None:
        self.options = options
        self.state, self.why = State.IDLE, Why.NO_PERMISSION
        self._about = ""
        self._choice = Choice(options.max_search_m)
        self._shaper, self._descent = Shaper(), Descent(options.divergence)
        self._spiral: Spiral | None = None
        self._since_s = self._seen_s = math.nan
        self._sure_s = math.nan
        self._arrived_s = self._low_s = math.inf
        self._tries = 0
        self._followed = False
        self._place: Vector = STILL
        self._fence = Fence(options, Inputs(time_s=math.nan))
        self._begin_at = self._held_at = Inputs(time_s=math.nan)
        self._looking, self._headroom, self._rest = Looking(options), Headroom(), AtRest()
        self._level = Level()

    @property
    def spot_ned(self) -> Vector | None:
        """The chosen place in the map's axes."""
        return self._choice.spot_ned

    @property
    def wants_spots(self) -> bool:
        """Whether the discs in view are of use at the next frame."""
        return self.state in (State.LOOK, State.CHOOSE, State.SEARCH, State.GO, State.DESCEND, State.HOLD)

    def step(self, i: Inputs) -> Step:
        """Take a frame; times must rise."""
        before = self.state, self.why
        self._seen_s, self._place = i.time_s, i.place_ned
        order = self._fly(i) if self.state in MOVING else self._wait(i)
        return self._step(order, before)

    def watch(
        self, time_s: float, objections: tuple[Withheld, ...], mode: str | None, quiet: bool
    ) -> Step | None:
        """Between frames: what ends it ends it at once. None: nothing did."""
        if self.state not in MOVING:
            return None
        before = self.state, self.why
        ended = self._ended(objections, mode)
        if ended is None and time_s - self._seen_s > ORDER_MAX_AGE_S:
            ended = Why.NO_FRAMES, ""
        if ended is None:
            return None
        return self._step(self._give_back(*ended, mode, quiet), before)

    def _step(self, order: Order, before: tuple[State, Why]) -> Step:
        changed = (self.state, self.why) != before
        return Step(order, self.state, self.why, changed, self._choice.spot_ned, self._about, self._place)

    # -- what ends it ------------------------------------------------------------------------------------

    def _ended(self, objections: tuple[Withheld, ...], mode: str | None) -> tuple[Why, str] | None:
        # until the autopilot follows, it may fly on in the mode that it was taken over from, and in no other
        if mode not in limits.OUR_MODES and (self._followed or mode not in self.options.takeover_modes):
            return Why.MODE_LEFT, mode or ""
        against = [o for o in objections if o not in limits.OWN]
        return (Why.PERMISSION_ENDED, against[0].value) if against else None

    def _give_back(self, why: Why, about: str, mode: str | None, quiet: bool) -> Order:
        """Hold is asked for only where the autopilot still flies by our setpoints and has nothing graver to do."""
        ours = mode in limits.OUR_MODES and not quiet and why is not Why.MODE_LEFT
        self._go(State.GIVE_BACK, why, self._seen_s, about)
        return Order(OrderKind.STOP if ours else OrderKind.NONE)

    # -- the states --------------------------------------------------------------------------------------

    def _wait(self, i: Inputs) -> Order:
        """IDLE, HAND_OVER, GIVE_BACK."""
        against = list(i.objections)
        if self.state is not State.IDLE:
            # a permission that was used and one that ended are alike: only another one begins anew
            if self.state is State.HAND_OVER and self.why is Why.AT_THE_SPOT:
                self.why = Why.LANDING
            if Withheld.ALREADY_REQUESTED in against:
                return Order()
            self._go(State.IDLE, Why.NO_PERMISSION, i.time_s)
        if against:
            self.why, self._about = Why.NO_PERMISSION, against[0].value
        elif i.mode not in self.options.takeover_modes:
            self.why, self._about = Why.MODE_NOT_NAMED, i.mode or ""
        elif not all(
            v is not None and all(map(math.isfinite, v)) for v in (i.velocity_ned, i.local_ned, i.place_ned)
        ):
            self.why, self._about = Why.NO_VELOCITY, ""
        elif not i.contradictions and not i.quiet:
            return self._start(i)
        return Order()

    def _start(self, i: Inputs) -> Order:
        self._choice.begin(i)
        self._level.keep(i)
        self._spiral, self._tries, self._followed = None, 0, False
        self._fence, self._begin_at = Fence(self.options, i), i
        self._shaper.begin(i.time_s, i.velocity_ned or STILL)
        self._headroom.begin(i.time_s)
        self._rest.begin()
        self._go(State.START, Why.TAKING_OVER, i.time_s)
        return Order(OrderKind.START)

    def _fly(self, i: Inputs) -> Order:
        self._followed |= i.mode in limits.OUR_MODES
        self._headroom.step(i)
        self._rest.step(i)
        ended = self._ended(i.objections, i.mode) or self._fence.against(i, self.state)
        if ended is None and self._rest.moves:
            ended = Why.GROUND_MOVES, ""
        if ended is None and i.time_s - self._since_s > limits.LIMIT_S.get(self.state, math.inf):
            waits = self.state in (State.LOOK, State.GO) and not self._rest.known
            ended = Why.GROUND_MAY_MOVE if waits else limits.IN_VAIN[self.state], ""
        if ended is not None:
            return self._give_back(*ended, i.mode, i.quiet)
        act: dict[State, Callable[[Inputs], Vector | Order]] = {
            State.START: self._begin,
            State.LOOK: self._look,
            State.CHOOSE: self._choose,
            State.SEARCH: self._search,
            State.GO: self._approach,
            State.DESCEND: self._come_down,
            State.HOLD: self._hold,
        }
        wanted = act[self.state](i)
        if isinstance(wanted, Order):
            return wanted
        wanted = self._fence.held_in(i, wanted)
        return Order(OrderKind.VELOCITY, self._shaper.step(i.time_s, wanted, self.options.max_speed))

    def _begin(self, i: Inputs) -> Vector:
        if self._followed:
            self._looking.begin(i.place_ned)
            self._go(State.LOOK, Why.NO_METRES, i.time_s)
        return STILL

    def _look(self, i: Inputs) -> Vector:
        """Back and forth across the heading, within the reach of the search."""
        known = math.isfinite(i.height_m)
        self._choice.step(i)
        known_below = self._choice.spot_ned is not None or i.below.verdict != UNKNOWN
        known_below &= self._rest.known
        looked_s = i.time_s - self._since_s
        if known and looked_s >= (limits.LOOK_LEAST_S if known_below else limits.LOOK_ENOUGH_S):
            self._go(State.CHOOSE, Why.CHOOSING, i.time_s)
            return STILL
        climb = self._climb(i)
        blind = not known and looked_s > limits.CLIMB_UNKNOWN_S and self._has_room(i)
        climb = (
            limits.CLIMB_SPEED
            if blind
            else climb or -self._looking.lower(self._headroom.all_around(i), looked_s)
        )
        self.why = Why.GROUND_UNKNOWN if known else Why.NO_METRES
        if climb:
            self.why = Why.TOO_LOW if climb > 0 else Why.TOO_HIGH
        north, east = self._looking.sideways(i, self._begin_at.place_ned, self._speed(i))
        return north, east, -climb

    def _choose(self, i: Inputs) -> Vector | Order:
        if i.spots is None:
            return STILL
        self._choice.step(i)
        self._level.keep(i)
        if self._choice.spot_ned is not None:
            self._sure_s = i.time_s
            self._go(State.GO, Why.ON_THE_WAY, i.time_s)
            return self._approach(i)
        if self._spiral is None:
            self._spiral = new_spiral(self._begin_at, i.height_m, i.time_s)
        self._go(State.SEARCH, Why.NO_SPOT, i.time_s)
        return STILL

    def _search(self, i: Inputs) -> Vector | Order:
        assert self._spiral is not None
        if self._choice.step(i):
            self._go(State.CHOOSE, Why.CHOOSING, i.time_s)
            return STILL
        room, least = self._headroom.all_around(i), lowest_look(self.options)
        if self._headroom.lost(i):
            return self._stop(i, Why.HEIGHT_LOST)
        if self._spiral.radius_m > self.options.max_search_m and math.isfinite(room):
            lower = max(limits.SEARCH_LOWER * room, least)
            if not lower < 0.85 * room:
                return self._give_back(Why.SEARCHED_IN_VAIN, "", i.mode, i.quiet)
            # what a place is like shows from lower down: once more, with arms as near as the picture is wide there
            self._level.keep(i, room - lower)
            self._spiral = new_spiral(self._begin_at, lower, i.time_s)
        here = autopilots(i)
        point, along = self._spiral.point, self._spiral.velocity(self._speed(i))
        back = towards(here, point, self.options.max_speed)
        if self._spiral.go_on(i.time_s, self._speed(i), math.dist(here[:2], point[:2])):
            back = along[0] + back[0], along[1] + back[1]
        return self._across(i, back, room, 0.8 * least)

    def _approach(self, i: Inputs) -> Vector | Order:
        """GO: over the place, at the height there is."""
        if self._choice.step(i):
            self.why, self._arrived_s = Why.BETTER_SPOT, math.inf
        spot = self._choice.spot_ned
        if spot is None or i.at_spot.verdict == HAZARD:
            return self._stop(i, Why.SPOT_LOST if spot is None else Why.SPOT_HAZARD)
        if self._headroom.lost(i):
            return self._stop(i, Why.HEIGHT_LOST)
        near = not beside(i, spot, 2 * limits.ARRIVED_SHARE)
        if near:
            self._arrived_s = min(self._arrived_s, i.time_s)
        waited_s = i.time_s - self._arrived_s
        sure = i.at_spot.verdict == LANDABLE or waited_s > limits.SURE_S
        if near and sure and self._rest.known:
            self._sure_s = i.time_s
            self._descent.begin(i.time_s)
            self._go(State.DESCEND, Why.COMING_DOWN, i.time_s)
        level = self._descent.around(i, spot, 1.0 if waited_s >= 0 else 0.0, self.options.max_speed)
        return self._across(i, level, self._headroom.near(i), 0.8 * self.options.hand_over_m)

    def _come_down(self, i: Inputs) -> Vector | Order:
        o, height = self.options, i.height_m
        self._choice.follow(i)
        spot = self._choice.spot_ned
        known = math.isfinite(height)
        if i.at_spot.verdict == LANDABLE and known:
            self._sure_s = i.time_s
        unsure_s = i.time_s - self._sure_s
        if spot is None:
            return self._stop(i, Why.SPOT_LOST)
        if i.at_spot.verdict == HAZARD:
            return self._stop(i, Why.SPOT_HAZARD)
        # what is not known from high up may show lower down, as low as a look goes
        high = self._headroom.near(i) > lowest_look(o)
        self._low_s = math.inf if high else min(self._low_s, i.time_s)
        if min(unsure_s, i.time_s - self._low_s) > limits.UNKNOWN_S:
            return self._stop(i, Why.SPOT_UNKNOWN)
        if not known:
            return STILL
        if beside(i, spot, 4 * limits.ARRIVED_SHARE):
            # another place was found, or a gust: not down beside it
            self._level.keep(i)
            self._go(State.GO, Why.BETTER_SPOT, i.time_s)
            return self._approach(i)
        low = height / o.hand_over_m
        if low <= 1.05 and unsure_s <= 0.5 and over(i, spot):
            self._go(State.HAND_OVER, Why.AT_THE_SPOT, i.time_s)
            return Order(OrderKind.LAND)
        self.why = Why.SPOT_UNSURE if unsure_s > limits.UNSURE_S else Why.COMING_DOWN
        share = sink_share(i, spot, 0.0 if high else unsure_s, low)
        if high and unsure_s > limits.UNSURE_S:
            share = min(share, limits.LOOK_SINK / o.divergence)
        sink = self._descent.sink(i.time_s, height, i.approach, share) if share else 0.0
        north, east = self._descent.around(i, spot, min(max((low - 1.2) / 0.5, 0.0), 1.0), o.max_speed)
        return north, east, sink

    def _hold(self, i: Inputs) -> Vector:
        """Stopped, and a little higher."""
        wanted = limits.HOLD_CLIMB_M
        if self.why is Why.SPOT_UNKNOWN and math.isfinite(i.height_m):
            # less would be known from higher up
            wanted = 0.0
        elif math.isfinite(self._held_at.height_m):
            wanted = min(limits.HOLD_CLIMB_SHARE * self._held_at.height_m, limits.HOLD_CLIMB_M)
        rises = risen(self._held_at, i) < wanted and self._has_room(i)
        climb = limits.CLIMB_SPEED if rises else self._climb(i)
        if i.time_s - self._since_s > 1.0 and not climb:
            self._looking.begin(i.place_ned)
            self._go(State.LOOK, Why.GROUND_UNKNOWN, i.time_s)
        return 0.0, 0.0, -climb

    def _stop(self, i: Inputs, why: Why) -> Vector | Order:
        self._tries += 1
        if self._tries > limits.TRIES:
            return self._give_back(Why.TOO_MANY_TRIES, "", i.mode, i.quiet)
        if why is Why.SPOT_HAZARD:
            self._choice.refuse()
        else:
            self._choice.drop()
        self._held_at = i
        self._go(State.HOLD, why, i.time_s)
        return STILL

    # -- small parts -------------------------------------------------------------------------------------

    def _speed(self, i: Inputs) -> float:
        most = self.options.max_speed
        return (
            min(most, max(limits.SEARCH_FLOW * i.height_m, 0.4)) if math.isfinite(i.height_m) else 0.6 * most
        )

    def _climb(self, i: Inputs) -> float:
        """Speed up to a height from which the disc is seen; 0 where it is there or may go no higher."""
        low = self._headroom.near(i) < 1.2 * self.options.hand_over_m
        return limits.CLIMB_SPEED if low and self._has_room(i) else 0.0

    def _has_room(self, i: Inputs) -> bool:
        return risen(self._begin_at, i) < limits.CLIMB_M

    def _across(self, i: Inputs, level: tuple[float, float], room_m: float, least_m: float) -> Vector:
        return self._level.across(i, level, room_m, least_m, may_climb=self._has_room(i))

    def _go(self, state: State, why: Why, time_s: float, about: str = "") -> None:
        self.state, self.why, self._since_s, self._about = state, why, time_s, about
        self._arrived_s = self._low_s = math.inf
