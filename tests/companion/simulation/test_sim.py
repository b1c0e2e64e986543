"""Simulated flights: scenario files, lockstep, the real daemon closed loop, recordings, Monte Carlo."""

import csv
import json
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from companion.cli import main
from companion.errors import LandslopeError, SettingsError
from companion.simulation import monte_carlo, simulation
from companion.simulation.counting.shares import Share, wilson
from companion.simulation.flight_result import FlightResult, in_words
from companion.simulation.ground import patch, unsafe
from companion.simulation.lockstep import LockstepOptions, fly
from companion.simulation.monte_carlo import Report, Run, fly_many, worst
from companion.simulation.picture import draw
from companion.simulation.random_scenario import random_scenario
from companion.simulation.scenario import (
    Expectation,
    Scenario,
    built_in,
    parse_scenario,
    read_scenario,
    to_toml,
)
from companion.simulation.simulation import LiveOptions, fly_live
from drivers.files.flight_folder import FlightFolder
from drivers.samples import Frame
from drivers.simulated.vehicle import autopilot
from drivers.simulated.world.world import build_world
from drivers.system.pools import Pool

SMALL = """
description = "over a steep ramp onto level ground"
duration_s = 25
[camera]
width_px = 160
height_px = 120
rate_hz = 15
[start]
north_m = -2.5
height_m = 2.0
[wind]
speed_m_s = 2
towards_deg = 180
gust_m_s = 0.3
[[surface]]
kind = "strip"
profile = [[-40, -18.65], [0, 0], [40, 0]]
material = "gravel"
[[leg]]
seconds = 5
forward_m_s = 0.8
height_m = 2.0
[[leg]]
seconds = 60
forward_m_s = 0.05
height_m = 2.0
[expect]
landing = "requested"
min_north_m = -0.5
"""


@pytest.fixture(scope="module")
def small() -> Scenario:
    """A short scenario with a small picture."""
    return parse_scenario("small", SMALL, "small.toml")


@pytest.fixture(scope="module")
def flown(small: Scenario, tmp_path_factory: pytest.TempPathFactory) -> FlightResult:
    """The same flight in lockstep, recorded."""
    return fly(small, options=LockstepOptions(record=tmp_path_factory.mktemp("record")))


def test_the_real_daemon_lands_closed_loop_where_it_should(
    small: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # on a busy machine simulated time waits for the physics at once
    monkeypatch.setattr(autopilot, "LONGEST_LAG_S", 0.02)
    result = fly_live(small, options=LiveOptions(speed=1.5))
    assert result.deviations(small.expect) == [], in_words(result)
    assert result.touch_down is not None, in_words(result)
    assert result.touch_ground is not None
    assert not unsafe(result.touch_ground, 10.0)
    assert result.decisions[-1].command in ("landed", "landing")
    picture = tmp_path / "flight.png"
    draw(result, small, picture)
    assert picture.stat().st_size > 20_000


def test_lockstep_lands_on_the_level_part(small: Scenario, flown: FlightResult) -> None:
    assert flown.deviations(small.expect) == [], in_words(flown)
    request = flown.requests[0]
    assert request.fitness == "fit"
    assert flown.touch_down is not None
    assert flown.touch_down.position[0] > -0.5
    words = in_words(flown)
    assert "requested  at" in words
    assert "touchdown  at" in words


def test_the_same_seed_gives_the_same_flight() -> None:
    def estimates(seed: int) -> list[object]:
        scenario = random_scenario(seed)
        scenario = replace(scenario, basics=replace(scenario.basics, duration_s=1.2))
        return [fly(scenario).estimates]

    assert estimates(7) == estimates(7)


def test_a_recording_is_a_flight_with_truth(flown: FlightResult) -> None:
    assert flown.folder is not None
    frames = [s for s in FlightFolder(flown.folder).samples() if isinstance(s, Frame)]
    with (flown.folder / "truth.csv").open(newline="") as file:
        truth = list(csv.DictReader(file))
    assert len(frames) == len(truth)
    assert [int(row["frame"]) for row in truth] == [f.number for f in frames]
    stamps = np.array([f.stamp_us for f in frames]) * 1e-6
    boot = np.array([float(row["time_boot_s"]) for row in truth])
    assert np.ptp(stamps - boot) < 1e-4
    steep = np.array([float(row["inclination_deg"]) for row in truth])
    assert steep[:5] == pytest.approx(math.degrees(math.atan2(18.65, 40)), abs=0.01)
    assert steep[-5:] == pytest.approx(0, abs=0.01)


def test_a_replay_of_the_recording_says_the_same(flown: FlightResult, tmp_path: Path) -> None:
    out = tmp_path / "estimates.jsonl"
    assert main(["replay", str(flown.folder), "--out", str(out)]) == 0
    replayed = {e["frame"]: e for e in map(json.loads, out.read_text().splitlines())}
    pairs = [
        (e.inclination_deg, replayed[e.frame]["inclination_deg"])
        for e in flown.estimates
        if e.status == "ok" and replayed.get(e.frame, {}).get("status") == "ok"
    ]
    # The recording is JPEG: the same but for its noise.
    assert len(pairs) > 0.7 * len(flown.estimates)
    assert np.median([abs(a - b) for a, b in pairs if a is not None and b is not None]) < 1.0


def test_every_built_in_scenario_can_be_read_and_written() -> None:
    names = built_in()
    assert {"stairs", "level", "ramp", "rubble", "roof", "descent", "faults"} <= set(names)
    for name, words in names.items():
        scenario = read_scenario(name)
        assert words
        assert parse_scenario(name, to_toml(scenario), name) == scenario


def test_a_landing_onto_what_was_not_in_view_at_the_request_is_broken_off() -> None:
    scenario = read_scenario("late_box")
    scenario = replace(
        scenario,
        camera=replace(scenario.camera, width_px=240, height_px=180, rate_hz=15),
        basics=replace(scenario.basics, duration_s=7),
    )
    held = fly(scenario, None, ["landing.on_unfit=hold"])
    assert len(held.requests) == 1
    assert [e.event for e in held.events].count("surface_unfit") == 1
    assert held.decisions[-1].command.startswith("held")


@examples(20)
@given(st.integers(0, 2**31 - 1))
def test_random_scenarios_are_valid_files(seed: int) -> None:
    scenario = random_scenario(seed)
    assert parse_scenario(scenario.name, to_toml(scenario), "x") == scenario
    assert random_scenario(seed) == scenario


def test_every_fault_of_a_scenario_is_reported() -> None:
    text = """
    sed = 3
    duration_s = 0
    [wind]
    speed_m_s = 200
    [[leg]]
    forwards = 1
    [[surface]]
    kind = "lava"
    [fault]
    """
    with pytest.raises(SettingsError) as reported:
        parse_scenario("bad", text, "bad.toml")
    for words in ("sed", "duration_s = 0", "0 to 20 m/s", "leg 1", "[[fault]]"):
        assert words in str(reported.value)
    with pytest.raises(SettingsError, match="lava"):
        parse_scenario("bad", '[[surface]]\nkind = "lava"', "bad.toml")
    with pytest.raises(SettingsError, match=r"did you mean estimator\.method"):
        parse_scenario("bad", "[settings.estimator]\nmethd = 'map'", "bad.toml")
    with pytest.raises(SettingsError, match="no scenario 'stair'"):
        read_scenario("stair")


def test_an_expectation_that_fails_is_said(flown: FlightResult) -> None:
    assert "although none was due" in flown.deviations(Expectation(landing="none"))[0]
    outside = flown.deviations(Expectation(min_north_m=50))
    assert any("outside 50" in line for line in outside)
    nothing = FlightResult("none")
    assert "no landing was requested" in nothing.deviations(Expectation(landing="requested"))[0]


def test_the_command_line_flies_and_says_so(
    small: Scenario, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "short.toml"
    path.write_text(SMALL.replace("duration_s = 25", "duration_s = 2"))
    assert main(["sim", str(path), "--lockstep"]) == 1
    said = capsys.readouterr().out
    assert "no landing was requested" in said
    assert main(["sim", "--list"]) == 0
    assert "stairs" in capsys.readouterr().out
    assert main(["sim", "nothing_like_it"]) == 2


def test_the_pitch_shows_in_the_slope_when_it_is_not_taken_out(small: Scenario) -> None:
    level = replace(
        small,
        basics=replace(small.basics, duration_s=4.0),
        surfaces=({"kind": "level", "material": "gravel"},),
        wind=replace(small.wind, speed_m_s=6.0, gust_m_s=0.0),
    )

    def slopes(*overrides: str) -> tuple[float, float]:
        good = [e for e in fly(level, overrides=overrides).estimates if e.status == "ok"][10:]
        pitch = np.median([e.pitch_deg for e in good])
        return float(np.median([e.slope_y_deg or 0 for e in good])), float(pitch)

    slope, pitch = slopes("estimator.use_attitude=false")
    assert pitch < -8  # nose down into a wind of 6 m/s
    assert abs(abs(slope) - abs(pitch)) < 2.5  # the offset is the pitch
    corrected = [e.inclination_deg for e in fly(level).estimates if e.status == "ok"][10:]
    assert np.median([c for c in corrected if c is not None]) < 2


def test_wilsons_interval() -> None:
    # Newcombe (1998), table I: 81 of 263 and 0 of 20.
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)
    assert wilson(0, 20) == pytest.approx((0.0, 0.1611), abs=1e-4)
    assert str(Share(0, 0)) == "none of 0"


@given(st.integers(1, 500), st.integers(0, 500))
def test_an_interval_holds_its_share(total: int, count: int) -> None:
    count = min(count, total)
    low, high = wilson(count, total)
    assert 0 <= low <= count / total <= high <= 1


def test_a_patch_knows_slope_and_bumps() -> None:
    ramp = build_world([{"kind": "ramp", "inclination_deg": 20, "uphill_deg": 30}])
    found = patch(ramp, 3.0, 4.0)
    assert found.inclination_deg == pytest.approx(20, abs=1e-6)
    assert found.deviation_m == pytest.approx(0, abs=1e-9)
    assert unsafe(found, 10.0)
    step = build_world([{"kind": "step", "height": 0.4, "north": 1.0}])
    assert patch(step, 1.0, 0.0).deviation_m > 0.1
    assert not unsafe(patch(step, 3.0, 0.0), 10.0)


def test_flights_that_went_wrong_come_first_in_the_report() -> None:
    def run(
        seed: int, outcome: str, requested_s: float | None = None, fit_s: float = 0.0, chance_s: float = 0.0
    ) -> Run:
        known = None if requested_s is None else 3.0
        return Run(
            seed, "step", "", outcome, requested_s, known, known, known, known, True, fit_s, chance_s, 1.0
        )

    runs = [
        run(1, "right", 2.0),
        run(2, "missed", fit_s=4.0, chance_s=4.0),
        run(3, "view", 1.0),
        run(4, "unsafe", 1.0),
        replace(run(5, "crashed"), error="IndexError: none there"),
        run(6, "right"),
        run(7, "right", fit_s=5.0, chance_s=1.0),
    ]
    report = Report(runs)
    assert [r.seed for r in worst(runs)] == [5, 4, 3, 2]
    assert (report.requested_on_unfit.count, report.requested_on_unfit.total) == (1, 7)
    assert (report.missed.count, report.missed.total) == (1, 2)
    assert report.held_back == 1
    assert report.crashes == 1
    words = report.in_words()
    assert "seed 5 (step): crashed: IndexError: none there" in words
    assert "seed 4 (step): unsafe: requested at 1.0 s on 3.0 degrees" in words


def test_many_flights_are_handed_to_processes_and_summed_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Real flights in real processes are tested with those of Dask, the processes of this machine in test_workers."""
    opened: list[int] = []

    def pool(jobs: int, *_: object) -> Pool:
        opened.append(jobs)
        return lambda: ThreadPoolExecutor(jobs)

    def flown(seed: int, **_: object) -> Run:
        return Run(seed, "gentle", "", "right", None, None, None, None, None, False, 0.0, 0.0, 1.0)

    monkeypatch.setattr(monte_carlo, "processes", pool)
    monkeypatch.setattr(monte_carlo, "fly_one", flown)
    report = fly_many(2, 59, 2)
    assert opened == [2]
    assert [r.seed for r in report.runs] == [59, 60]
    assert report.requested_on_unfit.count == 0, report.in_words()
    assert "2 flights" in report.in_words()
    assert json.loads(json.dumps(report.as_table()))["flights"] == 2
    assert worst(report.runs) == worst(list(reversed(report.runs)))


def test_the_ports_of_a_sitl_can_be_named(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[simulation.ArduPilot | None] = []

    def flown(scenario: Scenario, config: object, overrides: object, options: LiveOptions, _: object) -> None:
        asked.append(options.autopilot)
        raise LandslopeError("flown")

    monkeypatch.setattr(simulation, "fly_live", flown)
    words = ["sim", "stairs", "--autopilot", "ardupilot"]
    assert main([*words, "--pilot", "tcp:127.0.0.1:6000", "--physics-port", "9102"]) == 2
    assert main(words) == 2
    assert asked == [
        simulation.ArduPilot(pilot="tcp:127.0.0.1:6000", physics_port=9102),
        simulation.ArduPilot(),
    ]
    assert main([*words, "--physics-port", "99999"]) == 2
    assert len(asked) == 2
