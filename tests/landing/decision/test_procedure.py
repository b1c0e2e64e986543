"""The landing procedure state by state: what leads into each, out of it, and how long it may take."""

import math
from dataclasses import replace

import pytest
from procedure_flight import BAD, DARK, DT, GOOD, HERE, OPTIONS, Flight

from landing.decision.guidance import (
    ACCELERATION,
    SPIRAL_NEAR_M,
    SPIRAL_WAITS_S,
    Descent,
    Shaper,
    Spiral,
    towards,
)
from landing.decision.looking import lowest_look
from landing.decision.orders import WORDS, Inputs, OrderKind, State, Why
from landing.decision.procedure_options import (
    LIMIT_S,
    LOOK_LEAST_S,
    LOOK_SINK,
    TRIES,
    UNKNOWN_S,
    ProcedureOptions,
)
from landing.decision.targeting import Targeting
from landing.decision.withheld import Withheld
from landing.ground.spots import Spot


def test_it_goes_to_the_place_and_hands_over_low_slow_and_over_it():
    flight = Flight()
    seen = []
    while flight.machine.state is not State.HAND_OVER:
        state = flight.step().state
        if not seen or seen[-1] is not state:
            seen.append(state)
        assert flight.time_s < 60
    assert seen == [
        State.START, State.LOOK, State.CHOOSE, State.GO, State.DESCEND, State.HAND_OVER,
    ]  # fmt: skip
    assert math.dist(flight.place[:2], flight.spot) < 0.2
    assert -flight.place[2] <= 1.05 * OPTIONS.hand_over_m
    assert math.hypot(*flight.velocity[:2]) <= 0.25
    assert flight.step().order.kind is OrderKind.NONE


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"objections": (Withheld.SWITCH_OFF,)}, Why.NO_PERMISSION),
        ({"mode": "LOITER"}, Why.MODE_NOT_NAMED),
        ({"velocity_ned": None}, Why.NO_VELOCITY),
        ({"velocity_ned": (math.nan, 0.0, 0.0)}, Why.NO_VELOCITY),
        ({"place_ned": (math.nan, 0.0, 0.0)}, Why.NO_VELOCITY),
        ({"local_ned": None}, Why.NO_VELOCITY),
        ({"local_ned": (0.0, 0.0, math.nan)}, Why.NO_VELOCITY),
    ],
)
def test_without_permission_mode_or_velocity_nothing_leaves(changes, why):
    step = Flight().step(**changes)
    assert (step.state, step.why, step.order.kind) == (State.IDLE, why, OrderKind.NONE)


@pytest.mark.parametrize("state", [State.LOOK, State.GO, State.DESCEND])
@pytest.mark.parametrize(
    ("changes", "why", "order"),
    [
        ({"objections": (Withheld.SWITCH_OFF,)}, Why.PERMISSION_ENDED, OrderKind.STOP),
        ({"objections": (Withheld.STALE_INPUTS,)}, Why.PERMISSION_ENDED, OrderKind.STOP),
        ({"objections": (Withheld.FAILSAFE,), "quiet": True}, Why.PERMISSION_ENDED, OrderKind.NONE),
        ({"mode": "LOITER"}, Why.MODE_LEFT, OrderKind.NONE),
        ({"mode": None}, Why.MODE_LEFT, OrderKind.NONE),
        ({"contradictions": ("velocity_contradicts",)}, Why.CONTRADICTED, OrderKind.STOP),
        ({"local_ned": None}, Why.PERMISSION_ENDED, OrderKind.STOP),
        ({"local_ned": (30.0, 0.0, -4.0)}, Why.FENCE_DISTANCE, OrderKind.STOP),
        ({"place_ned": (math.nan, 0.0, -4.0)}, Why.FENCE_DISTANCE, OrderKind.STOP),
        ({"place_ned": (0.0, 0.0, -9.0)}, Why.FENCE_HEIGHT, OrderKind.STOP),
    ],
)
def test_what_ends_it_ends_it_at_once_and_for_good(state, changes, why, order):
    flight = Flight()
    flight.until(state)
    step = flight.step(**changes)
    assert (step.state, step.why, step.order.kind) == (State.GIVE_BACK, why, order)
    for _ in range(40):
        assert flight.step().order.kind is OrderKind.NONE


def test_between_frames_a_takeover_and_a_silent_camera_end_it():
    flight = Flight()
    flight.until(State.GO)
    assert flight.machine.watch(flight.time_s + 0.1, flight.now["objections"], "GUIDED", False) is None
    step = flight.machine.watch(flight.time_s + 0.1, flight.now["objections"], "LOITER", False)
    assert (step.why, step.order.kind) == (Why.MODE_LEFT, OrderKind.NONE)
    flight = Flight()
    flight.until(State.GO)
    step = flight.machine.watch(flight.time_s + 0.6, flight.now["objections"], "GUIDED", False)
    assert (step.why, step.order.kind) == (Why.NO_FRAMES, OrderKind.STOP)


def test_a_renewed_permission_begins_anew():
    flight = Flight()
    flight.until(State.GO)
    flight.step(mode="LOITER")
    assert flight.step().state is State.GIVE_BACK
    flight.now["objections"] = ()
    assert flight.step().order.kind is OrderKind.START


def test_a_mode_that_does_not_follow_gives_back():
    flight = Flight(options=replace(OPTIONS, takeover_modes=frozenset({"HOLD"})))
    flight.now["mode"] = "HOLD"
    step = flight.until(State.GIVE_BACK, 5.0)
    assert (step.why, step.order.kind) == (Why.NOT_TAKEN, OrderKind.NONE)
    assert flight.time_s == pytest.approx(LIMIT_S[State.START], abs=0.2)


def test_it_looks_sideways_within_its_radius_until_the_ground_is_known():
    flight = Flight(spot=None)
    flight.now["below"] = DARK
    farthest = 0.0
    flight.until(State.LOOK)
    for _ in range(int(10 / DT)):
        flight.step()
        farthest = max(farthest, abs(flight.place[1]))
        assert abs(flight.place[0]) < 0.1
    assert 1.2 < farthest < 1.7
    blind = Flight(spot=None)
    blind.now |= {"below": DARK, "height_m": math.nan}
    blind.until(State.LOOK)
    assert blind.until(State.GIVE_BACK, LIMIT_S[State.LOOK] + 1).why is Why.LOOKED_IN_VAIN
    seen = Flight()
    seen.until(State.CHOOSE)
    assert seen.time_s > LOOK_LEAST_S


def test_unknown_ground_is_looked_at_from_lower_down_and_then_searched():
    flight = Flight(spot=None)
    flight.now["below"] = DARK
    flight.until(State.LOOK)
    while (step := flight.step()).state is State.LOOK:
        lowest = -flight.place[2]
        assert step.why is not Why.TOO_HIGH or step.order.velocity_ned[2] >= 0
    assert lowest_look(OPTIONS) - 0.3 < lowest < lowest_look(OPTIONS) + 0.1
    assert flight.until(State.SEARCH).why is Why.NO_SPOT


def test_after_a_place_far_out_turned_out_unfit_it_looks_within_the_reach_of_the_search():
    flight = Flight(spot=(0.0, 2.6), options=replace(OPTIONS, max_search_m=3.0))
    flight.until(State.DESCEND)
    flight.spot = None
    flight.until(State.HOLD, at_spot=BAD)
    flight.until(State.LOOK, below=DARK)
    begun, farthest = flight.place[1], 0.0
    while flight.step(below=DARK).state is State.LOOK:
        farthest = max(farthest, math.hypot(*flight.place[:2]))
    assert begun > 1.8
    assert farthest < begun + 0.5
    assert flight.machine.why is Why.CHOOSING


def test_over_a_hazard_that_is_near_and_beside_the_place_it_does_not_come_down():
    wall = replace(BAD, step_m=2.0)
    flight = Flight()
    flight.until(State.DESCEND)
    for _ in range(int(1 / DT)):
        flight.step()
    for _ in range(int(1.0 / DT)):
        step = flight.step(below=wall)
    assert step.state is State.DESCEND
    assert step.order.velocity_ned[2] == 0.0
    flight.place[0] = flight.spot[0] + 1.1
    assert flight.step().order.velocity_ned[2] == 0.0


def test_too_low_to_see_a_disc_it_climbs():
    flight = Flight(spot=None)
    flight.place[2] = -0.8
    flight.now["below"] = DARK
    flight.until(State.LOOK)
    for _ in range(int(4 / DT)):
        step = flight.step()
    assert -flight.place[2] >= 1.2 * OPTIONS.hand_over_m - 0.05
    assert step.why is Why.GROUND_UNKNOWN


def test_it_searches_along_a_spiral_and_gives_back():
    flight = Flight(spot=None, options=replace(OPTIONS, max_search_m=4.0))
    flight.until(State.SEARCH)
    farthest = 0.0
    while flight.machine.state is State.SEARCH:
        step = flight.step()
        farthest = max(farthest, math.hypot(*flight.place[:2]))
    assert (step.state, step.why) == (State.GIVE_BACK, Why.SEARCHED_IN_VAIN)
    assert 3.5 < farthest < 4.6


def test_a_place_that_turns_out_a_hazard_is_left_upwards_and_not_chosen_again():
    flight = Flight()
    flight.until(State.DESCEND)
    for _ in range(int(2 / DT)):
        flight.step()
    low, began_s = -flight.place[2], flight.time_s
    step = flight.until(State.HOLD, 5.0, at_spot=BAD)
    assert step.why is Why.SPOT_HAZARD
    assert flight.time_s - began_s == pytest.approx(0.0, abs=0.25)
    flight.until(State.LOOK)
    assert -flight.place[2] > low
    flight.until(State.SEARCH)
    flight.spot = (-1.0, -1.0)
    flight.until(State.HAND_OVER)
    assert math.dist(flight.place[:2], flight.spot) < 0.2


def test_a_place_that_is_unknown_is_come_down_to_more_slowly_as_low_as_it_looks_and_left_then():
    flight, lowest = Flight(), lowest_look(OPTIONS)
    flight.place[2] = -5.0
    flight.until(State.DESCEND)
    for _ in range(int(2 / DT)):
        flight.step()
    passed_s, sinks = math.nan, []
    while (step := flight.step(at_spot=DARK)).state is State.DESCEND:
        height = -flight.place[2]
        if height <= lowest and math.isnan(passed_s):
            passed_s = flight.time_s
        if step.why is Why.SPOT_UNSURE and height > lowest:
            sinks.append(step.order.velocity_ned[2] / height)
    assert max(sinks[20:]) == pytest.approx(LOOK_SINK, abs=0.05)
    assert step.why is Why.SPOT_UNKNOWN
    assert flight.time_s - passed_s == pytest.approx(UNKNOWN_S, abs=0.1)
    held_m = -flight.place[2]
    flight.until(State.LOOK)
    assert held_m - 0.3 < -flight.place[2] < held_m + 0.1
    # ground that showed nothing may be chosen again
    flight.until(State.GO)


def test_after_some_tries_it_gives_back():
    flight = Flight()
    for number in range(TRIES + 1):
        flight.spot = (1.5 * number - 3.0, 0.0)
        flight.until(State.GO)
        step = flight.step(at_spot=BAD)
    assert (step.state, step.why) == (State.GIVE_BACK, Why.TOO_MANY_TRIES)


def test_the_fence_of_time():
    flight = Flight(spot=None, options=replace(OPTIONS, max_time_s=10.0))
    assert flight.until(State.GIVE_BACK).why is Why.FENCE_TIME
    assert flight.time_s == pytest.approx(10.0, abs=0.3)


def test_a_little_better_place_is_not_followed_a_clearly_better_one_is():
    flight = Flight(spot=(3.0, 0.0))
    flight.until(State.GO)
    place = flight.machine.spot_ned
    kept = Spot(3.0 - flight.place[0], -flight.place[1], 0.5, 1.0, 0.01, 0.5)
    near = replace(kept, east_m=kept.east_m + 1.0)
    flight.step(spots=(replace(near, clearance_m=0.7), kept))
    assert math.dist(flight.machine.spot_ned[:2], place[:2]) < 0.4
    step = flight.step(spots=(replace(near, clearance_m=1.6), kept))
    assert step.spot_ned[1] == pytest.approx(1.0, abs=0.1)
    assert step.why is Why.BETTER_SPOT


def test_the_descent_keeps_its_divergence_at_every_height_and_corrects_a_wrong_one():
    for believed in (0.7, 1.0, 1.4):
        descent, height, velocity, reported = Descent(0.25), 8.0, 0.0, []
        descent.begin(0.0)
        for k in range(int(9 / DT)):
            asked = descent.sink(k * DT, believed * height, velocity / height, 1.0)
            velocity += (asked - velocity) * DT / 0.3
            height -= velocity * DT
            if k * DT > 4.0:
                reported.append(velocity / height)
        assert max(abs(d - 0.25) for d in reported) < 0.05, believed
    assert Descent(0.25).sink(0.0, math.nan, 0.1, 1.0) == 0.0


def test_speeds_change_within_the_acceleration_and_nan_is_no_speed():
    shaper = Shaper()
    shaper.begin(0.0, (0.0, 0.0, 0.0))
    before = (0.0, 0.0, 0.0)
    for k in range(1, 60):
        now = shaper.step(k * DT, (9.0, -9.0, 9.0) if k < 30 else (math.nan, 0.0, 0.0), 1.0)
        assert math.dist(now[:2], before[:2]) <= ACCELERATION * DT + 1e-9
        assert math.hypot(*now[:2]) <= 1.0 + 1e-9
        before = now
    assert math.hypot(*before) == pytest.approx(0.0, abs=1e-6)
    assert towards((0.0, 0.0, 0.0), (0.0, 0.0, 5.0), 1.0) == (0.0, 0.0)


def test_the_spiral_covers_its_circle_at_constant_speed():
    spiral, before, way = Spiral((0.0, 0.0, 0.0), 2.0, 0.0), None, []
    for k in range(1, 2000):
        assert spiral.go_on(k * 0.02, 1.0, 0.0)
        point = spiral.point
        if before is not None:
            way.append(math.dist(before[:2], point[:2]))
        before = point
    assert min(way) > 0.018
    assert max(way) < 0.022


def test_the_spiral_waits_for_the_vehicle_but_not_for_ever():
    spiral = Spiral((0.0, 0.0, 0.0), 2.0, 0.0)
    spiral.go_on(0.0, 1.0, 0.0)
    began, moved_s = spiral.point, math.nan
    for k in range(1, 600):
        assert not spiral.go_on(k * 0.02, 1.0, SPIRAL_NEAR_M + 0.5)
        if math.isnan(moved_s) and spiral.point != began:
            moved_s = k * 0.02
    assert moved_s == pytest.approx(SPIRAL_WAITS_S, abs=0.05)
    assert spiral.go_on(12.0, 1.0, 0.0)


def test_a_landing_autopilot_is_reported_where_to_while_it_lands_and_nothing_else():
    machine = Targeting(ProcedureOptions())
    known = {
        "objections": (Withheld.ALREADY_REQUESTED, Withheld.LANDING_ALREADY), "mode": "LAND", "quiet": False,
        "place_ned": (1.0, 2.0, -5.0), "height_m": 5.0, "at_spot": GOOD,
    }  # fmt: skip
    spots = (replace(HERE, north_m=1.0, east_m=-0.5),)
    assert machine.step(Inputs(time_s=0.0, spots=spots, **known)).order.kind is OrderKind.NONE
    step = machine.step(Inputs(time_s=0.1, spots=spots, landing=True, **known))
    assert step.order.kind is OrderKind.TARGET
    assert step.order.target_ned == pytest.approx((1.0, -0.5, 5.0))
    moved = {**known, "place_ned": (1.5, 2.0, -4.0), "height_m": 4.0}
    step = machine.step(Inputs(time_s=0.2, landing=True, **moved))
    assert step.order.target_ned == pytest.approx((0.5, -0.5, 4.0))
    for spoilt in ({"quiet": True}, {"contradictions": ("rotation_contradicts",)}, {"height_m": math.nan},
                   {"objections": (Withheld.STALE_INPUTS,)}):  # fmt: skip
        assert (
            machine.step(Inputs(time_s=0.3, landing=True, **{**known, **spoilt})).order.kind is OrderKind.NONE
        )


def test_every_code_has_words():
    assert set(WORDS) == set(Why)
