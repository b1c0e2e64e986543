"""Whatever comes: no setpoint without permission, outside the fence, after a takeover, or above its speed."""

import math

from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from landing.decision.fence import CLIMB_MARGIN_M
from landing.decision.orders import MOVING, GroundMotion, Inputs, OrderKind, State
from landing.decision.procedure import Procedure
from landing.decision.procedure_options import CLIMB_M, FENCE_MARGIN_M, ProcedureOptions
from landing.decision.withheld import Withheld
from landing.ground.spots import HAZARD, LANDABLE, UNKNOWN, Disc, Spot

OPTIONS = ProcedureOptions(takeover_modes=frozenset({"GUIDED", "HOLD"}), max_search_m=4.0, max_time_s=40.0)
COMMANDED = (OrderKind.START, OrderKind.VELOCITY, OrderKind.LAND, OrderKind.STOP)
FLOWN = (OrderKind.START, OrderKind.VELOCITY, OrderKind.LAND)

number = st.one_of(st.floats(-3, 3), st.just(math.nan), st.just(math.inf))
discs = st.sampled_from([LANDABLE, HAZARD, UNKNOWN]).map(
    lambda verdict: Disc(verdict, (), 1.0, 0.5, 0.01, 1.0)
)
spots = st.lists(
    st.builds(
        Spot,
        st.floats(-3, 3),
        st.floats(-3, 3),
        st.just(0.5),
        st.floats(0, 9),
        st.just(0.01),
        st.floats(0, 2),
    ),
    max_size=3,
).map(tuple)
"""What usually holds, so that a flight gets far, and now and then does not."""
events = st.sampled_from(
    [
        "quiet",
        "withheld",
        "mode",
        "silent",
        "failsafe",
        "contradicted",
        "blind",
        "away",
        "high",
        "renewed",
        "ground_moves",
        "late",
    ]
)


@examples(150)
@given(
    st.lists(st.tuples(st.floats(0.02, 0.4), spots, discs, number, st.one_of(st.none(), events)), max_size=60)
)
def test_no_setpoint_leaves_that_should_not(steps):
    machine = Procedure(OPTIONS)
    time_s, place, height, used, mode = 0.0, [0.0, 0.0, 0.0], 4.0, False, "GUIDED"
    begun = None
    ended = False
    rest = GroundMotion.AT_REST
    for dt, found, disc, approach, what in steps:
        time_s += dt + (1.0 if what == "late" else 0.0)
        if what == "renewed":
            used, mode, ended, rest = False, "GUIDED", False, GroundMotion.AT_REST
        if what == "ground_moves":
            rest = GroundMotion.MOVES
        if what == "mode":
            mode = "LOITER"
        if what == "away":
            place[0] += 7.0
        if what == "high":
            place[2] -= 5.0
        objections = [Withheld.ALREADY_REQUESTED] if used else []
        if what == "withheld":
            objections.append(Withheld.SWITCH_OFF)
        quiet = what in ("silent", "failsafe")
        if what == "failsafe":
            objections.append(Withheld.FAILSAFE_NOW)
        heard = None if what == "silent" else mode
        between = machine.watch(time_s, tuple(objections), heard, quiet)
        if between is not None:
            assert between.order.kind in (OrderKind.NONE, OrderKind.STOP)
            assert between.state is State.GIVE_BACK
            if heard not in ("GUIDED", "OFFBOARD") or quiet:
                assert between.order.kind is OrderKind.NONE
        active = machine.state in MOVING
        step = machine.step(
            Inputs(
                time_s=time_s,
                objections=tuple(objections),
                mode=heard,
                quiet=quiet,
                contradictions=("velocity_contradicts",) if what == "contradicted" else (),
                place_ned=(place[0], place[1], place[2]),
                local_ned=None if what == "blind" else (place[0], place[1], place[2]),
                velocity_ned=None if what == "blind" else (0.1, 0.0, 0.0),
                yaw=0.3,
                height_m=height,
                approach=approach,
                ground_motion=rest,
                clear_m=height,
                below=disc,
                at_spot=disc,
                spots=found,
            )
        )
        order = step.order
        if order.kind is OrderKind.START:
            assert not objections, objections
            used, begun, ended = True, list(place), False
        if order.kind in FLOWN:
            assert set(objections) <= {Withheld.ALREADY_REQUESTED}
            assert heard in OPTIONS.takeover_modes
            assert not quiet
            assert what not in ("contradicted", "blind")
            assert not ended, "after it ended under the same permission"
        if order.kind in (OrderKind.VELOCITY, OrderKind.LAND):
            assert begun is not None
            assert active
            assert math.dist(place[:2], begun[:2]) <= OPTIONS.max_search_m + FENCE_MARGIN_M
            assert begun[2] - place[2] <= CLIMB_M + CLIMB_MARGIN_M
        if order.kind is OrderKind.VELOCITY:
            north, east, down = order.velocity_ned
            assert math.hypot(north, east) <= OPTIONS.max_speed + 1e-9
            assert abs(down) <= OPTIONS.max_speed + 1e-9
            for axis in range(3):
                place[axis] += order.velocity_ned[axis] * dt
            height = max(0.3, height - down * dt)
        if order.kind is OrderKind.STOP:
            assert heard in ("GUIDED", "OFFBOARD")
            assert not quiet
        ended |= step.state in (State.GIVE_BACK, State.HAND_OVER)
