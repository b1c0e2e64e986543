"""What the landing procedure is given at a frame and what it answers: inputs, orders, states. Values only.

Positions are north, east, down in metres in the axes of the ground map: level, fixed to the ground, carried on by the
visual motion. Velocities are NED, m/s. NaN and None mean unknown, and what is unknown counts against going on.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

from landing.decision.withheld import Withheld
from landing.ground.spots import UNKNOWN, Disc, Spot

NAN = math.nan
Vector = tuple[float, float, float]
STILL: Vector = (0.0, 0.0, 0.0)


class State(StrEnum):
    """Of the procedure."""

    IDLE = "idle"
    START = "start"
    LOOK = "look"
    CHOOSE = "choose"
    SEARCH = "search"
    GO = "go"
    DESCEND = "descend"
    HOLD = "hold"
    HAND_OVER = "hand_over"
    GIVE_BACK = "give_back"


MOVING = frozenset({State.START, State.LOOK, State.CHOOSE, State.SEARCH, State.GO, State.DESCEND, State.HOLD})
"""States in which setpoints leave."""


class GroundMotion(StrEnum):
    """Of the ground itself: AT_REST is known, MOVES is plain, UNKNOWN is neither."""

    AT_REST = "at_rest"
    MOVES = "moves"
    UNKNOWN = "unknown"


class OrderKind(StrEnum):
    """What is asked of the autopilot.

    NONE: nothing may leave; setpoints that are being sent end without a word. START: take over, with no speed.
    VELOCITY: fly with ``Order.velocity_ned``. STOP: end the setpoints and ask the autopilot to hold. LAND: the
    request to land, where the vehicle is. TARGET: send the place to the autopilot, which lands by itself.
    """

    NONE = "none"
    START = "start"
    VELOCITY = "velocity"
    STOP = "stop"
    LAND = "land"
    TARGET = "target"


ORDER_MAX_AGE_S = 0.5
"""An order of VELOCITY or TARGET that is older is void and is not sent."""


@dataclass(frozen=True, slots=True)
class Order:
    """One order. ``velocity_ned`` m/s with VELOCITY, the yaw is held; ``target_ned`` m from the vehicle with TARGET."""

    kind: OrderKind = OrderKind.NONE
    velocity_ned: Vector = STILL
    target_ned: Vector = STILL


class Why(StrEnum):
    """Why the procedure is in its state, and what it waits for there."""

    NO_PERMISSION = "no_permission"
    MODE_NOT_NAMED = "mode_not_named"
    NO_VELOCITY = "no_velocity"
    TAKING_OVER = "taking_over"
    NO_METRES = "no_metres"
    GROUND_UNKNOWN = "ground_unknown"
    TOO_LOW = "too_low"
    TOO_HIGH = "too_high"
    CHOOSING = "choosing"
    NO_SPOT = "no_spot"
    ON_THE_WAY = "on_the_way"
    BETTER_SPOT = "better_spot"
    COMING_DOWN = "coming_down"
    SPOT_UNSURE = "spot_unsure"
    SPOT_HAZARD = "spot_hazard"
    SPOT_UNKNOWN = "spot_unknown"
    SPOT_LOST = "spot_lost"
    HEIGHT_LOST = "height_lost"
    AT_THE_SPOT = "at_the_spot"
    LANDING = "landing"
    NOT_TAKEN = "not_taken"
    PERMISSION_ENDED = "permission_ended"
    MODE_LEFT = "mode_left"
    CONTRADICTED = "contradicted"
    NO_FRAMES = "no_frames"
    FENCE_DISTANCE = "fence_distance"
    FENCE_HEIGHT = "fence_height"
    FENCE_TIME = "fence_time"
    GROUND_MOVES = "ground_moves"
    GROUND_MAY_MOVE = "ground_may_move"
    LOOKED_IN_VAIN = "looked_in_vain"
    SEARCHED_IN_VAIN = "searched_in_vain"
    WAY_TOO_LONG = "way_too_long"
    DESCENT_TOO_LONG = "descent_too_long"
    TOO_MANY_TRIES = "too_many_tries"


WORDS = {
    Why.NO_PERMISSION: "waits for the permission",
    Why.MODE_NOT_NAMED: "waits for a flight mode in which it may take over",
    Why.NO_VELOCITY: "waits for the vehicle's velocity and position",
    Why.TAKING_OVER: "takes over",
    Why.NO_METRES: "moves sideways: the height is not known yet",
    Why.GROUND_UNKNOWN: "moves sideways: the ground is not known yet",
    Why.TOO_LOW: "climbs: too low to see a place to land on",
    Why.TOO_HIGH: "descends: too high to see obstacles on the ground",
    Why.CHOOSING: "chooses a place",
    Why.NO_SPOT: "searches along a spiral: no place to land on in view",
    Why.ON_THE_WAY: "flies to the place",
    Why.BETTER_SPOT: "flies to a better place",
    Why.COMING_DOWN: "descends to the place",
    Why.SPOT_UNSURE: "descends more slowly: the place is uncertain",
    Why.SPOT_HAZARD: "stops and climbs: the place is a hazard",
    Why.SPOT_UNKNOWN: "stops: the place is not known any more",
    Why.SPOT_LOST: "stops: the place is out of reach",
    Why.AT_THE_SPOT: "hands over to the autopilot's landing",
    Why.LANDING: "the autopilot lands",
    Why.NOT_TAKEN: "gave control back: the autopilot did not follow",
    Why.PERMISSION_ENDED: "gave control back: the permission ended",
    Why.MODE_LEFT: "gave control back: the flight mode was changed",
    Why.CONTRADICTED: "gave control back: the pictures contradict the vehicle",
    Why.NO_FRAMES: "gave control back: no pictures",
    Why.FENCE_DISTANCE: "gave control back: too far from where it began",
    Why.FENCE_HEIGHT: "gave control back: too high or too low",
    Why.FENCE_TIME: "gave control back: it took too long",
    Why.GROUND_MOVES: "gave control back: the ground moves by itself",
    Why.GROUND_MAY_MOVE: "gave control back: the ground is not known to be at rest",
    Why.HEIGHT_LOST: "stops and climbs: the height is not known any more",
    Why.LOOKED_IN_VAIN: "gave control back: the motion did not show the ground",
    Why.SEARCHED_IN_VAIN: "gave control back: no place to land on within reach",
    Why.WAY_TOO_LONG: "gave control back: the place was not reached in time",
    Why.DESCENT_TOO_LONG: "gave control back: the descent took too long",
    Why.TOO_MANY_TRIES: "gave control back: every place turned out unfit",
}
"""Code -> a sentence without its subject, which is the procedure; the only place where words are made."""

NOT_SEEN = Disc(UNKNOWN, ())


@dataclass(frozen=True, slots=True, kw_only=True)
class Inputs:
    """One frame as the procedure sees it.

    ``objections`` stand against a landing now; ``mode`` is the flight mode, None while it is not heard. ``quiet``:
    the autopilot is busy with a failsafe or is not heard, so nothing may be said to it; ``landing``: it lands at our
    request. ``place_ned`` is the vehicle by the visual motion, ``local_ned`` by the autopilot, in the autopilot's
    axes; ``velocity_ned`` by the visual motion where that is in metres, else by the autopilot. ``height_m`` is over
    the ground straight below, ``clear_m`` over the highest ground of the map where the vehicle may come to within a
    second (NaN: none is known there), ``approach`` the sink over it by the view, 1/s (half of an estimate's
    divergence). ``ground_motion``: what is found of the ground's own motion.
    ``spots`` are landable discs, best first, from the vehicle; None: not asked for at this frame. ``below`` and
    ``at_spot`` are the discs straight below and about the chosen place.
    """

    time_s: float
    objections: tuple[Withheld, ...] = (Withheld.NOT_ENABLED,)
    mode: str | None = None
    quiet: bool = True
    landing: bool = False
    contradictions: tuple[str, ...] = ()
    place_ned: Vector = (NAN, NAN, NAN)
    local_ned: Vector | None = None
    velocity_ned: Vector | None = None
    yaw: float = NAN
    height_m: float = NAN
    clear_m: float = NAN
    approach: float = NAN
    ground_motion: GroundMotion = GroundMotion.UNKNOWN
    below: Disc = NOT_SEEN
    at_spot: Disc = NOT_SEEN
    spots: tuple[Spot, ...] | None = None


@dataclass(frozen=True, slots=True)
class Step:
    """What a frame came to: the order, the state after it, why, and the chosen place (NED in the map's axes)."""

    order: Order
    state: State
    why: Why
    changed: bool
    spot_ned: Vector | None = None
    about: str = ""
    place_ned: Vector | None = None

    @property
    def words(self) -> str:
        """The reason as a sentence without its subject."""
        return f"{WORDS[self.why]}{f': {self.about}' if self.about else ''}"
