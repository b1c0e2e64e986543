"""The watch over a landing: an abort needs evidence in every frame of a dwell time, and time to be of use."""

from dataclasses import dataclass, field

import msgspec
import pytest

from companion.core.landing_watch import LandingWatch, Watched
from companion.messages.messages import Decision, Estimate, estimate_message
from companion.settings.settings import LandingSettings
from landing.estimate import SurfaceEstimate
from landing.ground.spots import HAZARD, LANDABLE, Disc, GroundCode
from landing.ground.spots import UNKNOWN as NOT_KNOWN
from landing.reasons import Certainty, Code, Reason, codes, in_words

DWELL_S = 0.8
FRAME_S = 0.05
ROUGH = Reason(Code.TOO_ROUGH, Certainty.CERTAIN, 0.05, limit=0.02)
FEW = Reason(Code.COVERAGE_TOO_LOW, Certainty.CERTAIN, 0.1, limit=0.5)
UNKNOWN = Reason(Code.ROUGHNESS_UNKNOWN)
GOOD = Disc(LANDABLE, ())
STEP = Disc(HAZARD, (GroundCode.STEP,))
UNSEEN = Disc(NOT_KNOWN, (GroundCode.NOT_SEEN,))
NO_METRES = Disc(NOT_KNOWN, (GroundCode.NO_METRES,))


def decision(at_s: float, verdict: str, reason: Reason | None, command: str) -> Decision:
    reasons = () if reason is None else (reason,)
    return Decision(
        frame=1,
        time_unix_us=round(at_s * 1e6),
        verdict=verdict,
        reasons=in_words(reasons),
        reason_codes=codes(reasons),
        since_unix_us=0,
        permitted=False,
        withheld=(),
        requested=True,
        command=command,
    )


@dataclass
class Map:
    """The ground map: what it says of the discs below and on the way to the stopping point."""

    below: Disc = GOOD
    touchdown: Disc = GOOD

    def under_way(self) -> tuple[Disc, Disc]:
        return self.below, self.touchdown


@dataclass
class Landing:
    """Frames of a landing in order, each with its estimate and, when the verdict changes, its decision."""

    on_unfit: str = "report"
    command: str = "landing"
    ground: Map | None = None
    status: str = "ok"
    values: dict = field(default_factory=lambda: {"height_m": 3.0})
    at_s: float = 100.0
    said: list[Watched] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.watch = LandingWatch(LandingSettings(on_unfit=self.on_unfit), DWELL_S, self.ground)

    def fly(self, seconds: float, verdict: str, reason: Reason | None) -> "Landing":
        self.feed(decision(self.at_s, verdict, reason, self.command))
        for _ in range(round(seconds / FRAME_S)):
            self.at_s += FRAME_S
            message = estimate_message(
                SurfaceEstimate(1, self.at_s, self.status, "map", **self.values),
                round(self.at_s * 1e6),
                5.0,
                True,
            )
            reasons = () if reason is None else (reason,)
            self.feed(replace_message(message, in_words(reasons), codes(reasons)))
        return self

    def feed(self, message: Decision | Estimate) -> None:
        found = self.watch.feed(message)
        if found is not None:
            self.said.append(found)


def replace_message(message: Estimate, words: tuple[str, ...], found: tuple[str, ...]) -> Estimate:
    return msgspec.structs.replace(message, against_flat=words, against_flat_codes=found)


def test_an_unfit_surface_is_reported_once_after_the_dwell_time_and_held_only_when_asked() -> None:
    (reported,) = Landing().fly(0.5, "fit", None).fly(3.0, "unfit", ROUGH).said
    assert reported.event.time_unix_us == pytest.approx(100.5e6 + DWELL_S * 1e6, abs=2 * FRAME_S * 1e6)
    assert not reported.hold
    assert "too rough" in reported.event.text
    (held,) = Landing(on_unfit="hold").fly(3.0, "unfit", ROUGH).said
    assert held.hold


def test_noise_is_no_evidence_however_often_it_comes() -> None:
    landing = Landing(on_unfit="hold")
    for _ in range(10):
        landing.fly(DWELL_S / 2, "unfit", ROUGH).fly(FRAME_S, "unknown", UNKNOWN)
    assert landing.said == []


def test_a_frame_that_is_not_too_rough_begins_the_dwell_anew_though_the_verdict_stays() -> None:
    landing = Landing().fly(DWELL_S - 0.1, "unfit", ROUGH)
    landing.at_s += FRAME_S
    landing.feed(estimate_message(SurfaceEstimate(1, landing.at_s, "ok", "map", height_m=3.0), 1, 5.0, True))
    assert landing.fly(DWELL_S - 0.1, "unfit", ROUGH).said == []


def test_that_little_is_seen_is_no_reason_to_break_off() -> None:
    assert Landing().fly(3.0, "unfit", FEW).said == []


@pytest.mark.parametrize(
    ("values", "speaks"),
    [
        ({"height_m": 1.6}, True),
        ({"height_m": 1.4}, False),
        ({"time_to_contact_s": 3.1}, True),
        ({"time_to_contact_s": 2.9}, False),
        ({"time_to_contact_s": -5.0}, True),
        ({}, True),
    ],
)
def test_it_is_too_late_near_the_ground(values: dict, speaks: bool) -> None:
    assert bool(Landing("hold", values=values).fly(2.0, "unfit", ROUGH).said) is speaks


@pytest.mark.parametrize("command", ["none", "landed", "refused: denied", "failed: no answer"])
def test_nothing_to_watch_without_a_landing(command: str) -> None:
    assert Landing(command=command).fly(2.0, "unfit", ROUGH).said == []


def test_the_next_landing_is_watched_anew() -> None:
    landing = Landing().fly(2.0, "unfit", ROUGH)
    landing.command = "none"
    landing.fly(0.2, "fit", None)
    landing.command = "landing"
    assert len(landing.fly(2.0, "unfit", ROUGH).said) == 2


@pytest.mark.parametrize("below", [GOOD, UNSEEN])
def test_where_the_map_has_metres_what_is_certain_of_the_whole_view_is_no_evidence(below: Disc) -> None:
    assert Landing("hold", ground=Map(below, UNSEEN)).fly(5.0, "unfit", ROUGH).said == []


@pytest.mark.parametrize("ground", [Map(below=STEP), Map(touchdown=STEP), Map(UNSEEN, STEP)])
def test_a_hazard_where_it_comes_down_is_evidence_through_the_dwell_though_the_view_is_fit(
    ground: Map,
) -> None:
    landing = Landing("hold", ground=Map()).fly(0.5, "fit", None)
    began_s = landing.at_s
    landing.ground.below, landing.ground.touchdown = ground.below, ground.touchdown
    (watched,) = landing.fly(3.0, "fit", None).said
    assert watched.hold
    assert watched.event.details["reasons"] == ["hazard where the vehicle would land: step"]
    waited_s = watched.event.time_unix_us * 1e-6 - began_s
    assert DWELL_S <= waited_s <= DWELL_S + 2 * FRAME_S


@pytest.mark.parametrize(("doubt", "status"), [(GOOD, "ok"), (UNSEEN, "ok"), (STEP, "too_few_tracks")])
def test_a_frame_without_the_hazard_or_without_an_estimate_begins_the_dwell_anew(
    doubt: Disc, status: str
) -> None:
    landing = Landing("hold", ground=Map())
    for _ in range(5):
        landing.ground.below, landing.status = STEP, "ok"
        landing.fly(DWELL_S - FRAME_S, "unfit", ROUGH)
        landing.ground.below, landing.status = doubt, status
        landing.fly(FRAME_S, "unfit", ROUGH)
    assert landing.said == []


def test_a_hazard_before_the_landing_counts_from_the_landing_on() -> None:
    landing = Landing("hold", command="none", ground=Map(below=STEP)).fly(3.0, "unknown", None)
    landing.command = "landing"
    assert landing.fly(DWELL_S - FRAME_S, "unknown", None).said == []
    assert len(landing.fly(0.5, "unknown", None).said) == 1


def test_without_metres_the_whole_view_is_the_evidence() -> None:
    assert len(Landing("hold", ground=Map(NO_METRES, NO_METRES)).fly(3.0, "unfit", ROUGH).said) == 1
    assert Landing("hold", ground=Map(NO_METRES, NO_METRES)).fly(3.0, "unfit", FEW).said == []


def test_too_late_near_the_ground_for_a_hazard_of_the_map_as_well() -> None:
    assert Landing("hold", ground=Map(below=STEP), values={"height_m": 1.4}).fly(3.0, "fit", None).said == []
