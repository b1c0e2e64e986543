"""The recorded flights, replayed by the real command and held against their truth."""

import re
from pathlib import Path

import numpy as np
import pytest
from replay_support import FLIGHTS, Replayed, replayed, run
from score import Score, score, truth_of

QUADRATIC = ("--set", "estimator.method=quadratic")
MEDIAN_DEG = {"stairs_a": 0.5, "ramp_a": 0.65, "agile_a": 0.5, "descent_a": 2.5}
"""Flights for the method that is kept for comparison; the default one is measured on all of them (test_golden_map)."""
SECONDS = {"stairs_a": 12.0, "ramp_a": 12.0, "agile_a": 10.0, "descent_a": 9.0}
"""How much of each: a platform and stairs, level ground and 10 degrees, fast turns, a descent onto a slope."""
TWICE_S = 5.0
P95_DEG = 3.0
FINE = ("stairs_a", "ramp_a", "agile_a")
COVERAGE = 0.85
STEEP_RAMP_DEG = 20.0


@pytest.fixture(scope="module", params=MEDIAN_DEG)
def quadratic(request: pytest.FixtureRequest, replay_cache: Path) -> tuple[str, Replayed, Score]:
    replay = replayed(replay_cache, request.param, *QUADRATIC, seconds=SECONDS[request.param])
    return request.param, replay, score(replay.flight, replay.estimates)


def test_every_frame_gets_one_estimate_in_order(quadratic: tuple[str, Replayed, Score]):
    replay = quadratic[1]
    frames = [estimate["frame"] for estimate in replay.estimates]
    assert frames == truth_of(replay.flight)["frame"].astype(int).tolist()
    for estimate in replay.estimates:
        assert estimate["method"] == "quadratic"
        assert (estimate["status"] == "ok") == (estimate["slope_x_deg"] is not None)


def test_slopes_are_right_and_seldom_missing(quadratic: tuple[str, Replayed, Score]):
    flight, _, figures = quadratic
    assert figures.slope.median is not None
    assert figures.slope.p95 is not None
    assert figures.slope.median <= MEDIAN_DEG[flight]
    if flight in FINE:
        assert figures.slope.p95 <= P95_DEG
    assert figures.coverage >= COVERAGE


def test_the_summary_counts_the_frames_and_says_how_fast_it_was(quadratic: tuple[str, Replayed, Score]):
    flight, replay, figures = quadratic
    good = sum(estimate["status"] == "ok" for estimate in replay.estimates)
    assert replay.summary.startswith(f"{flight}: {figures.frames} frames in ")
    assert re.search(r"took \d+\.\d s of one core: \d+\.\d times real time", replay.summary)
    assert f"{good} of {figures.frames} frames" in replay.summary
    assert "not requested" in replay.summary


def test_the_same_flight_gives_the_same_bytes_twice(replay_cache: Path, tmp_path: Path):
    """In two processes with other hashes each."""
    first = replayed(replay_cache, "stairs_c", seconds=TWICE_S)
    again = run(first.flight, tmp_path, "--set", "estimator.method=map")
    assert again.out == first.out
    assert len(first.estimates) == 30 * TWICE_S
    assert (again.folder / "events.jsonl").read_bytes() == (first.folder / "events.jsonl").read_bytes()


def requests(replay: Replayed) -> list[int]:
    return [event["frame"] for event in replay.events if event["event"] == "landing_requested"]


def test_on_the_stairs_landing_is_requested_once_and_only_over_the_floor(replay_cache: Path):
    replay = replayed(replay_cache, "stairs_a")
    frames = requests(replay)
    assert len(frames) == 1
    truth = truth_of(FLIGHTS / "stairs_a")
    assert truth["pn"][truth["frame"] == frames[0]][0] >= 0
    assert re.search(rf"landing +requested at \d+\.\d s \(frame {frames[0]}\)", replay.summary)


def test_nothing_is_requested_when_landing_is_not_enabled(quadratic: tuple[str, Replayed, Score]):
    assert requests(quadratic[1]) == []


def test_a_steep_ramp_is_never_fit_and_nothing_is_requested_over_it(replay_cache: Path):
    replay = replayed(replay_cache, "ramp_a")
    truth = truth_of(FLIGHTS / "ramp_a")
    steep = set(truth["frame"][np.abs(truth["inclination_deg"]) >= STEEP_RAMP_DEG - 0.5].astype(int).tolist())
    assert len(steep) > 100
    verdict, fit = "unknown", set()
    changes = {e["frame"]: e["verdict"] for e in replay.events if e["event"] == "decision"}
    for estimate in replay.estimates:
        verdict = changes.get(estimate["frame"], verdict)
        if verdict == "fit":
            fit.add(estimate["frame"])
    assert fit, "the level parts are fit"
    assert not steep & fit
    assert len(requests(replay)) == 1
    assert not steep.intersection(requests(replay))
