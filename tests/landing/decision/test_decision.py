"""The verdict: limits with their uncertainty, hysteresis, dwell, patience, reasons in words."""

import math
from dataclasses import dataclass, replace

import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from landing.decision.decision import Decider, against_flat, against_landing
from landing.estimate import SurfaceEstimate
from landing.ground.landing_area import AreaSeen
from landing.options import DecisionOptions
from landing.reasons import Code, in_words

OPTIONS = DecisionOptions(
    max_inclination_deg=10.0,
    max_roughness=0.01,
    sigmas=2.0,
    roughness_sigmas=2.0,
    hysteresis=0.2,
    dwell_s=0.5,
    patience_s=0.3,
    max_standing=1,
    min_coverage=0.3,
)
FLAT = SurfaceEstimate(
    0,
    0.0,
    "ok",
    "map",
    inclination_deg=3.0,
    inclination_std_deg=0.5,
    roughness=0.002,
    roughness_std=0.001,
    coverage=0.8,
)
STEEP = replace(FLAT, inclination_deg=20.0)
UNKNOWN = replace(FLAT, status="motion_too_small")
STEP_S = 0.1


def run(decider: Decider, estimates: list[SurfaceEstimate], start_s: float = 0.0) -> list[str]:
    return [decider.step(replace(e, time_s=start_s + k * STEP_S)).verdict for k, e in enumerate(estimates)]


def test_flat_has_nothing_against_it():
    assert against_flat(FLAT, OPTIONS) == ()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"status": "motion_too_small"}, "no estimate: motion too small"),
        ({"inclination_deg": 12.0}, "too steep: 12.0 degrees, limit 10.0"),
        ({"inclination_deg": math.nan}, "inclination unknown without an attitude"),
        ({"inclination_std_deg": 4.0}, "inclination uncertain: 3.0 degrees, may be 11.0, limit 10.0"),
        ({"inclination_std_deg": math.nan}, "inclination uncertain: 3.0 degrees, may be nan, limit 10.0"),
        ({"roughness": 0.02}, "too rough: 0.0200 of the distance, limit 0.0100"),
        ({"roughness": 0.011}, "probably too rough: 0.0110 of the distance, limit 0.0100"),
        (
            {"roughness": 0.02, "unsettled": True},
            "perhaps too rough: 0.0200 of the distance, limit 0.0100",
        ),
        (
            {"suspicious": True},
            "perhaps too rough: possible relief where ground has just come into view",
        ),
        (
            {"appearance_change": True},
            "perhaps another surface: ground that comes into view looks different, not measured yet",
        ),
        ({"roughness": math.nan}, "roughness unknown"),
        ({"roughness_std": 0.005}, "roughness uncertain: 0.0020, may be 0.0120, limit 0.0100"),
        ({"roughness_std": math.nan}, "roughness uncertain: 0.0020, may be nan, limit 0.0100"),
        ({"obstacle_points": 2}, "too rough: 2 obstacle points, limit 1"),
        ({"coverage": 0.1}, "too little of the surface seen: 0.10, at least 0.30 needed"),
        ({"coverage": math.nan}, "too little of the surface seen: nan, at least 0.30 needed"),
    ],
)
def test_each_condition_stands_against_flat_by_itself_in_words(change: dict, words: str):
    assert in_words(against_flat(replace(FLAT, **change), OPTIONS)) == (words,)


def test_limits_themselves_are_flat():
    edge = replace(FLAT, inclination_deg=10.0, inclination_std_deg=0.0, roughness=0.01, roughness_std=0.0)
    assert against_flat(replace(edge, coverage=0.3, obstacle_points=1), OPTIONS) == ()


def test_a_surface_is_fit_after_the_dwell_time_and_not_before():
    decider = Decider(OPTIONS)
    verdicts = run(decider, [FLAT] * 8)
    assert verdicts == ["unknown"] * 5 + ["fit"] * 3
    again = Decider(OPTIONS)
    assert in_words(again.step(FLAT).reasons) == ("flat for 0.0 s, 0.5 s needed",)


def test_a_steep_frame_restarts_the_dwell_time():
    verdicts = run(Decider(OPTIONS), [*[FLAT] * 4, STEEP, *[FLAT] * 7])
    assert verdicts[4] == "unfit"
    assert verdicts.index("fit") == 10


def test_a_steep_frame_ends_fit_at_once():
    decider = Decider(OPTIONS)
    assert run(decider, [FLAT] * 7)[-1] == "fit"
    verdict = decider.step(replace(STEEP, time_s=0.7))
    assert (verdict.verdict, verdict.changed) == ("unfit", True)
    assert verdict.reasons[0].code is Code.TOO_STEEP


def test_once_fit_the_limits_are_wider():
    between = replace(FLAT, inclination_deg=10.5)
    assert "fit" not in run(Decider(OPTIONS), [between] * 12)
    decider = Decider(OPTIONS)
    assert set(run(decider, [FLAT] * 7 + [between] * 5)[6:]) == {"fit"}
    assert decider.step(replace(FLAT, time_s=1.2, inclination_deg=12.5)).verdict == "unfit"


def test_a_fit_surface_may_go_without_an_estimate_for_the_patience():
    decider = Decider(OPTIONS)
    run(decider, [FLAT] * 7)
    assert run(decider, [UNKNOWN] * 5, 0.7) == ["fit"] * 3 + ["unknown"] * 2
    # and must be flat for the dwell time again
    assert run(decider, [FLAT] * 6, 1.2) == ["unknown"] * 5 + ["fit"]


def test_an_unknown_surface_is_never_fit():
    assert set(run(Decider(OPTIONS), [UNKNOWN] * 20)) == {"unknown"}


def test_since_tells_when_the_verdict_began():
    decider = Decider(OPTIONS)
    verdicts = [decider.step(replace(FLAT, time_s=k * STEP_S)) for k in range(9)]
    assert [v.changed for v in verdicts] == [False] * 5 + [True] + [False] * 3
    assert verdicts[-1].since_s == pytest.approx(0.5)


@examples(100)
@given(
    st.lists(
        st.tuples(
            st.sampled_from((FLAT, STEEP, UNKNOWN, replace(FLAT, roughness=0.05))), st.floats(0.01, 0.4)
        ),
        max_size=30,
    )
)
def test_fit_always_rests_on_a_flat_dwell_and_recent_sight(steps: list[tuple[SurfaceEstimate, float]]):
    decider, now = Decider(OPTIONS), 0.0
    since, last_flat, fit_before = None, -math.inf, False
    for estimate, wait in steps:
        now += wait
        verdict = decider.step(replace(estimate, time_s=now))
        if estimate is FLAT:
            since = now if since is None else since
            last_flat = now
        elif estimate is not UNKNOWN or now - last_flat > OPTIONS.patience_s:
            since = None
        fit = verdict.verdict == "fit"
        if fit:
            assert since is not None
            assert fit_before or now - since >= OPTIONS.dwell_s
            assert now - last_flat <= OPTIONS.patience_s
            assert verdict.reasons == ()
        else:
            assert verdict.reasons
        fit_before = fit


def test_from_far_up_what_is_flat_is_not_fit_until_its_relief_can_be_reported():
    options = replace(OPTIONS, max_relief_m=0.05)
    far, near = replace(FLAT, height_m=20.0, height_std_m=1.0), replace(FLAT, height_m=5.0, height_std_m=0.2)
    assert against_flat(far, options) == ()
    assert against_landing(near, options) == ()
    assert against_landing(FLAT, options) == (), "without a height there is only relief over distance"
    (reason,) = against_landing(far, options)
    assert reason.code is Code.RELIEF_UNRESOLVED
    assert (reason.height_m, reason.limit) == (20.0, 0.05)
    assert "fit" not in run(Decider(options), [far] * 20)
    assert run(Decider(options), [far] * 5 + [near] * 10)[-1] == "fit"


@dataclass
class Area:
    """A landing area of which always the same is seen."""

    seen: AreaSeen

    def look(self, estimate: SurfaceEstimate) -> AreaSeen:
        return self.seen


@pytest.mark.parametrize(
    ("seen", "code"),
    [
        (AreaSeen(0.9, 0.2), None),
        (AreaSeen(0.9, math.nan), None),
        (AreaSeen(0.9, 0.5), Code.GROUND_UNRESOLVED),
        (AreaSeen(0.5, 0.2), Code.GROUND_NOT_SEEN),
        (AreaSeen(math.nan, 0.2), Code.GROUND_NOT_SEEN),
    ],
)
def test_the_ground_to_land_on_must_be_seen_finely_enough(seen: AreaSeen, code: Code | None):
    options = replace(OPTIONS, max_patch_m=0.4, min_area_measured=0.8)
    found = against_landing(FLAT, options, 0.0, Area(seen))
    assert [reason.code for reason in found] == ([] if code is None else [code])


def test_a_frame_without_an_estimate_neither_makes_fit_nor_restarts_the_dwell_time():
    assert run(Decider(OPTIONS), [FLAT] * 4 + [UNKNOWN] + [FLAT] * 2) == ["unknown"] * 5 + ["fit"] * 2


def test_the_first_verdict_has_a_beginning():
    assert Decider(OPTIONS).step(replace(FLAT, time_s=3.0)).since_s == 3.0


def test_after_a_silence_the_dwell_time_begins_anew():
    decider = Decider(OPTIONS)
    assert run(decider, [FLAT] * 10)[-1] == "fit"
    assert decider.step(replace(FLAT, time_s=30.0)).verdict == "unknown"
    assert run(decider, [FLAT] * 6, start_s=30.1)[-1] == "fit"


def test_what_is_probably_too_rough_ends_the_verdict_at_once_without_being_called_unfit():
    decider = Decider(OPTIONS)
    assert run(decider, [FLAT] * 10)[-1] == "fit"
    doubtful = replace(FLAT, roughness=0.0125, time_s=1.0)
    assert decider.step(doubtful).verdict == "unknown"
    assert "fit" not in run(decider, [FLAT] * 4, start_s=1.1)


def test_what_was_there_in_one_frame_alone_ends_the_verdict_only_when_it_stays():
    decider = Decider(OPTIONS)
    passing = replace(FLAT, roughness=0.02, unsettled=True)
    assert run(decider, [FLAT] * 6 + [passing, FLAT, passing, FLAT])[-5:] == ["fit"] * 5
    assert run(decider, [passing, replace(passing, unsettled=False)], 1.0) == ["fit", "unfit"]
