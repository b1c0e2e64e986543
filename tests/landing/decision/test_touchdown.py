"""The verdict asks the ground map: landable from straight below to the stopping point."""

import math
from dataclasses import dataclass, replace

import pytest

from landing.decision.decision import Decider, against_motion, against_touchdown
from landing.estimate import SurfaceEstimate
from landing.ground.spots import HAZARD, LANDABLE, UNKNOWN, Disc, GroundCode
from landing.options import DecisionOptions
from landing.reasons import Code

GOOD = Disc(LANDABLE, ())
STEP = Disc(HAZARD, (GroundCode.STEP,))
UNSEEN = Disc(UNKNOWN, (GroundCode.NOT_SEEN,))
FLAT = SurfaceEstimate(
    frame=1,
    time_s=0.0,
    status="ok",
    method="map",
    inclination_deg=1.0,
    inclination_std_deg=0.2,
    roughness=0.001,
    roughness_std=0.0002,
    coverage=0.9,
    ground_speed_m_s=0.1,
    ground_speed_std_m_s=0.1,
)
MOVES = replace(FLAT, ground_speed_m_s=0.5)


@pytest.mark.parametrize(
    ("below", "way", "all_known", "code"),
    [
        (GOOD, GOOD, True, None),
        (GOOD, GOOD, False, None),
        (GOOD, UNSEEN, False, None),
        (GOOD, UNSEEN, True, Code.STOPPING_POINT_UNKNOWN),
        (UNSEEN, UNSEEN, True, Code.TOUCHDOWN_UNKNOWN),
        (UNSEEN, UNSEEN, False, Code.TOUCHDOWN_UNKNOWN),
        (UNSEEN, GOOD, True, Code.TOUCHDOWN_UNKNOWN),
        (UNSEEN, GOOD, False, Code.TOUCHDOWN_UNKNOWN),
        (STEP, GOOD, False, Code.TOUCHDOWN_HAZARD),
        (GOOD, STEP, False, Code.TOUCHDOWN_HAZARD),
        (GOOD, STEP, True, Code.TOUCHDOWN_HAZARD),
        (UNSEEN, STEP, False, Code.TOUCHDOWN_HAZARD),
        (replace(GOOD, reasons=(GroundCode.NO_METRES,)), GOOD, False, Code.TOUCHDOWN_UNKNOWN),
        (GOOD, replace(GOOD, reasons=(GroundCode.NO_METRES,)), True, Code.STOPPING_POINT_UNKNOWN),
        (replace(GOOD, verdict="?"), GOOD, False, Code.TOUCHDOWN_UNKNOWN),
    ],
)
def test_what_is_not_landable_below_or_a_hazard_on_the_way_speaks_against(
    below: Disc, way: Disc, all_known: bool, code: Code | None
):
    found = against_touchdown(below, way, all_known)
    assert [reason.code for reason in found] == ([] if code is None else [code])
    assert all(reason.ends_verdict for reason in found) is (code in (None, Code.TOUCHDOWN_HAZARD))


@pytest.mark.parametrize(
    ("speed_m_s", "std_m_s", "widen", "code", "ends"),
    [
        (0.1, 0.1, 0.0, None, False),
        (0.2, 0.0999, 0.0, None, False),
        (0.2, 0.12, 0.0, Code.GROUND_MAY_MOVE, False),
        (0.2, 0.12, 0.15, None, False),
        (0.0, 0.4, 0.0, Code.GROUND_MAY_MOVE, False),
        (0.5, 0.1, 0.0, Code.GROUND_MAY_MOVE, True),
        (0.5, 0.1, 1.0, None, True),
        (math.nan, 0.1, 0.0, Code.GROUND_MOTION_UNKNOWN, False),
        (0.1, math.nan, 0.0, Code.GROUND_MOTION_UNKNOWN, False),
        (0.1, math.inf, 0.0, Code.GROUND_MOTION_UNKNOWN, False),
    ],
)
def test_ground_is_at_rest_only_where_its_upper_bound_is(
    speed_m_s: float, std_m_s: float, widen: float, code: Code | None, ends: bool
):
    estimate = replace(FLAT, ground_speed_m_s=speed_m_s, ground_speed_std_m_s=std_m_s)
    found = against_motion(estimate, DecisionOptions(max_ground_speed_m_s=0.3), widen)
    assert [reason.code for reason in found] == ([] if code is None else [code])
    assert all(reason.ends_verdict is ends for reason in found)


@dataclass
class Map:
    below: Disc = GOOD
    way: Disc = GOOD

    def under_way(self) -> tuple[Disc, Disc]:
        return self.below, self.way


def verdict_over(ground: Map, seconds: float = 2.0, options: DecisionOptions | None = None) -> str:
    decider = Decider(options or DecisionOptions(), None, ground)
    steps = math.ceil(seconds * 10)
    return [decider.step(replace(FLAT, frame=k, time_s=k / 10)) for k in range(steps)][-1].verdict


def test_a_flat_view_is_fit_only_where_the_map_agrees():
    assert verdict_over(Map()) == "fit"
    assert verdict_over(Map(below=UNSEEN)) == "unknown"
    assert verdict_over(Map(way=UNSEEN)) == "unknown"
    assert verdict_over(Map(way=UNSEEN), options=DecisionOptions(touchdown_known=False)) == "fit"
    assert verdict_over(Map(below=STEP)) == "unfit"
    assert verdict_over(Map(way=STEP)) == "unfit"
    assert Decider(DecisionOptions(dwell_s=0.0), None, Map()).step(FLAT).verdict == "fit"
    (reason,) = Decider(DecisionOptions(dwell_s=0.0), None, Map()).step(MOVES).reasons
    assert reason.code is Code.GROUND_MAY_MOVE
    unasked = DecisionOptions(dwell_s=0.0, at_rest_known=False)
    assert Decider(unasked, None, Map()).step(MOVES).verdict == "fit"
    assert Decider(unasked, None, Map(below=UNSEEN)).step(MOVES).verdict == "unknown"
    # nobody asks a flat view without a map
    assert Decider(DecisionOptions(dwell_s=0.0)).step(MOVES).verdict == "fit"
    steep = replace(FLAT, inclination_deg=20.0)
    assert Decider(DecisionOptions(), None, Map()).step(steep).verdict == "unfit"


def test_a_hazard_ends_a_verdict_at_once_and_the_unknown_after_the_patience():
    ground = Map()
    decider = Decider(DecisionOptions(), None, ground)
    for k in range(20):
        decider.step(replace(FLAT, frame=k, time_s=k / 10))
    ground.below = UNSEEN
    assert decider.step(replace(FLAT, time_s=2.0)).verdict == "fit"
    assert decider.step(replace(FLAT, time_s=2.5)).verdict == "unknown"
    ground.below = STEP
    assert decider.step(replace(FLAT, time_s=2.6)).verdict == "unfit"


def test_the_dwell_runs_while_the_stopping_point_comes_nearer_which_must_stay_known_for_the_patience():
    ground = Map()
    decider = Decider(DecisionOptions(dwell_s=0.75, patience_s=0.25), None, ground)
    times = (k / 8 for k in range(100))

    def next_ones(count: int, way: Disc, status: str = "ok") -> str:
        ground.way = way
        frames = [replace(FLAT, time_s=next(times), status=status) for _ in range(count)]
        return "".join("f" if decider.step(frame).verdict == "fit" else "-" for frame in frames)

    assert next_ones(8, UNSEEN) == "--------"
    assert next_ones(2, GOOD) == "--"
    # a moment in which it is not known begins anew
    assert next_ones(1, UNSEEN) == "-"
    assert next_ones(4, GOOD) == "--ff"
    assert next_ones(3, UNSEEN) == "ff-"
    assert next_ones(3, GOOD) == "--f"
    # a silence of more than the patience ends both
    assert next_ones(3, GOOD, "motion_too_small") == "ff-"
    assert next_ones(7, GOOD) == "------f"
    # and a hazard at once
    assert next_ones(1, STEP) == "-"
    assert next_ones(7, GOOD) == "------f"


def test_the_limit_of_the_ground_widens_while_it_is_fit():
    options = DecisionOptions(dwell_s=0.0, hysteresis=0.2, max_ground_speed_m_s=0.2)
    decider = Decider(options, None, Map())
    faster = replace(FLAT, ground_speed_m_s=0.13)
    assert decider.step(faster).verdict == "unknown"
    assert decider.step(replace(FLAT, time_s=0.1)).verdict == "fit"
    assert not decider.step(replace(faster, time_s=0.2)).reasons
    assert decider.step(replace(MOVES, time_s=0.3)).verdict == "unknown"
