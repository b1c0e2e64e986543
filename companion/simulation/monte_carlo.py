"""Many random flights: how often a landing was requested on unfit ground, how often missed on fit ground."""

import logging
import os
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from companion.simulation.classes import CONTROL, scenario_of, seeds_of
from companion.simulation.counting.shares import Share, wilson
from companion.simulation.flight_result import FlightResult
from companion.simulation.ground import unsafe
from companion.simulation.lockstep import LockstepOptions, fly
from companion.simulation.procedure_count import outcome, words
from companion.simulation.scenario import Scenario, to_toml
from drivers.system.pools import Pool, each, processes

TRUTH_EVERY = 5
OPPORTUNITY_S = 2.5
"""Clearly fit ground below, seen from low enough for this long without a break, everything in order, and no request:
missed."""
WRONG = ("unsafe", "view", "missed")
AHEAD = 4
"""Flights handed to each process in advance."""
KEPT_WORST = 10

Progress = Callable[[float, float], None]


@dataclass(frozen=True, slots=True)
class Run:
    """The outcome of one flight."""

    seed: int
    ground: str
    fault: str
    outcome: str
    """"right", "unsafe" (it landed on ground that is clearly not to land on), "view" (requested with clearly unfit
    ground somewhere in view, but none where it landed), "missed", "between" (requested, neither clearly),
    "crashed" (``error`` says why)."""
    requested_s: float | None
    inclination_deg: float | None
    """True, of the ground in view at the request."""
    relief: float | None
    patch_inclination_deg: float | None
    patch_deviation_m: float | None
    """Of the circle of half a metre about the place where it touched down."""
    unfit_in_view: bool
    fit_s: float
    """Longest time of clearly fit ground in view without a break."""
    chance_s: float
    """Of that, while the ground straight below was in view, from a height at which it can be measured."""
    elapsed_s: float
    contradicted: str = ""
    """Contradictions that were reported, by the names of their events, with spaces between."""
    error: str = ""
    ended: str = ""
    """How a landing procedure ended; empty without one. Its figures follow (``procedure_count.Outcome``)."""
    reachable: bool = False
    place_error_m: float | None = None
    hand_over_m_s: float | None = None
    divergence_std: float | None = None
    procedure_s: float | None = None

    @property
    def wrong(self) -> bool:
        """Whether somebody should look at it."""
        return self.outcome in WRONG or self.crashed

    @property
    def crashed(self) -> bool:
        """Whether the software broke."""
        return self.outcome == "crashed"

    def __str__(self) -> str:
        what = f"missed fit ground of {self.chance_s:.1f} s" if self.outcome == "missed" else self.outcome
        what = f"{self.outcome}, {self.ended}" if self.ended else what
        what += f": {self.error}" if self.error else ""
        if self.requested_s is not None:
            what += f": requested at {self.requested_s:.1f} s"
            what += f" on {self.inclination_deg:.1f} degrees, relief {self.relief:.4f}; touched down on"
            what += f" {self.patch_inclination_deg:.1f} degrees, uneven by {self.patch_deviation_m:.2f} m"
        return f"seed {self.seed} ({self.ground}{', ' + self.fault if self.fault else ''}): {what}"


@dataclass(slots=True)
class Report:
    """All runs, in the order of their seeds."""

    runs: list[Run] = field(default_factory=list)
    kept: list[Path] = field(default_factory=list)
    elapsed_s: float = 0.0

    @property
    def requested_on_unfit(self) -> Share:
        """Of the flights that saw clearly unfit ground."""
        seen = [r for r in self.runs if r.unfit_in_view or r.outcome in ("unsafe", "view")]
        return Share(sum(r.outcome == "unsafe" for r in seen), len(seen))

    @property
    def crashes(self) -> int:
        """Flights in which the software broke."""
        return sum(r.crashed for r in self.runs)

    @property
    def unfit_in_view(self) -> Share:
        """Of the same flights: requested while unfit ground was in view, but not where it landed."""
        seen = [r for r in self.runs if r.unfit_in_view or r.outcome in ("unsafe", "view")]
        return Share(sum(r.outcome == "view" for r in seen), len(seen))

    @property
    def missed(self) -> Share:
        """Of the flights that had an opportunity, faults aside."""
        chances = [
            r
            for r in self.runs
            if r.outcome == "missed" or (r.requested_s is not None and r.outcome == "right")
        ]
        return Share(sum(r.outcome == "missed" for r in chances), len(chances))

    @property
    def held_back(self) -> int:
        """Flights with clearly fit ground in view, but too far below or not where they would land."""
        return sum(
            r.outcome == "right"
            and r.requested_s is None
            and not r.fault
            and r.fit_s >= OPPORTUNITY_S > r.chance_s
            for r in self.runs
        )

    def in_words(self) -> str:
        """The figures, several lines."""
        kinds = Counter(r.ground for r in self.runs)
        lines = [
            f"{len(self.runs)} flights in {self.elapsed_s:.0f} s",
            f"  landing requested on clearly unfit ground   {self.requested_on_unfit}",
            f"  requested with such ground beside           {self.unfit_in_view}",
            f"  landing missed on clearly fit ground        {self.missed}",
            f"  held back: fit ground too far down or aside {self.held_back}",
            f"  requested on ground that is neither         {sum(r.outcome == 'between' for r in self.runs)}",
            f"  the software broke                          {self.crashes}",
            f"  a contradiction was reported in             {sum(bool(r.contradicted) for r in self.runs)}",
            f"  landing requested at all in                 {sum(r.requested_s is not None for r in self.runs)}",
            "  by ground or class: requested, on unfit (95 % confidence), unfit beside, missed",
        ]
        for kind, count in sorted(kinds.items()):
            runs = [r for r in self.runs if r.ground == kind]
            asked = sum(r.requested_s is not None for r in runs)
            bad, near, missed = (
                sum(r.outcome == word for r in runs) for word in ("unsafe", "view", "missed")
            )
            low, high = (100 * bound for bound in wilson(bad, count))
            unfit = f"{bad:4d} ({low:.1f} to {high:.1f} %)"
            lines.append(f"    {kind:<20} {count:4d} flights {asked:4d} {unfit} {near:4d} {missed:4d}")
        lines += words([r for r in self.runs if r.ended])
        lines += [f"  {run}" for run in worst(self.runs)[:KEPT_WORST]]
        lines += [f"  kept {path}" for path in self.kept]
        return "\n".join(lines)

    def as_table(self) -> dict[str, Any]:
        """For a JSON file."""
        return {
            "flights": len(self.runs),
            "requested_on_unfit": _figures(self.requested_on_unfit),
            "unfit_in_view": _figures(self.unfit_in_view),
            "missed": _figures(self.missed),
            "held_back": self.held_back,
            "elapsed_s": self.elapsed_s,
            "runs": [asdict(r) for r in self.runs],
        }


def _figures(share: Share) -> dict[str, Any]:
    return {"count": share.count, "total": share.total, "interval_95": share.interval}


def worst(runs: Sequence[Run]) -> list[Run]:
    """The runs that went wrong: crashes, landings on unfit ground, the steepest first, then the longest missed."""
    bad = [r for r in runs if r.outcome in ("unsafe", "view")]
    bad.sort(
        key=lambda r: (r.outcome != "unsafe", -(r.inclination_deg or 0.0) - 1000 * (r.relief or 0.0), r.seed)
    )
    return (
        [r for r in runs if r.crashed]
        + bad
        + sorted((r for r in runs if r.outcome == "missed"), key=lambda r: (-r.chance_s, r.seed))
    )


def fly_many(
    count: int,
    first_seed: int,
    jobs: int,
    config: Path | None = None,
    overrides: Sequence[str] = (),
    keep: Path | None = None,
    progress: Progress = lambda done, total: None,
    on_wrong: Callable[[Run], None] = lambda run: None,
    on_run: Callable[[Run], None] = lambda run: None,
    flown: Sequence[Run] = (),
    pool: Pool | None = None,
    classes: Sequence[str] = (CONTROL,),
) -> Report:
    """Fly ``count`` random scenarios of each class from ``first_seed`` on in ``jobs`` processes.

    The worst are recorded under ``keep``.

    ``on_run`` is given every flight as soon as it has ended, ``on_wrong`` those that went wrong. ``flown`` are counted
    and not flown again. ``pool`` opens another place to fly than processes of this machine.
    """
    started = time.perf_counter()
    report = Report()
    report.runs += flown
    known = {run.seed for run in flown}
    seeds = [seed for seed in seeds_of(list(classes), count, first_seed) if seed not in known]
    if pool is None and jobs > 1 and len(seeds) > 1:
        for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
            os.environ.setdefault(variable, "1")
        pool = processes(jobs, _quiet)
    flight = partial(fly_one, config=config, overrides=tuple(overrides))
    for done, run in enumerate(_all(seeds, AHEAD * jobs, pool, flight), 1 + len(flown)):
        report.runs.append(run)
        on_run(run)
        if run.wrong:
            on_wrong(run)
        progress(done, count * len(classes))
    report.runs.sort(key=lambda r: r.seed)
    report.elapsed_s = time.perf_counter() - started
    if keep is not None:
        shown = [r for r in worst(report.runs) if not r.crashed][:KEPT_WORST]
        report.kept = [_keep(r, keep, config, overrides) for r in shown]
    return report


def fly_one(seed: int, config: Path | None = None, overrides: Sequence[str] = ()) -> Run:
    """Fly the scenario of a seed and classify the result."""
    scenario = scenario_of(seed)
    settings = scenario.flight_settings(config, overrides)
    limit_deg, lands = settings.decision.max_inclination_deg, settings.landing.procedure == "land"
    options = LockstepOptions(truth_every=TRUTH_EVERY if lands else 0, stop_at_request=True)
    result = fly(scenario, config, overrides, options)
    run = classify(scenario, result, limit_deg)
    procedure = outcome(scenario, result)
    return run if procedure is None else replace(run, **asdict(procedure))


def classify(scenario: Scenario, result: FlightResult, max_inclination_deg: float) -> Run:
    """What a flight of a random scenario amounts to."""
    request = result.requests[0] if result.requests else None
    below = result.touch_ground or (request.below if request else None)
    fault = scenario.faults[0].kind if scenario.faults else ""
    none_due = scenario.expect.landing == "none"
    if request is not None and below is not None:
        outcome = {"fit": "right", "unfit": "view", "between": "between"}[request.fitness]
        if none_due or unsafe(below, max_inclination_deg):
            outcome = "unsafe"
    else:
        chance = result.longest_chance_s >= OPPORTUNITY_S and not fault and not none_due
        outcome = "missed" if chance else "right"
    return Run(
        seed=scenario.basics.seed,
        ground=scenario.basics.description,
        fault=fault,
        outcome=outcome,
        requested_s=None if request is None else round(request.time_s, 3),
        inclination_deg=None if request is None else round(request.truth.fit_inclination_deg, 2),
        relief=None if request is None else round(request.truth.relief, 5),
        patch_inclination_deg=None if below is None else round(below.inclination_deg, 2),
        patch_deviation_m=None if below is None else round(below.deviation_m, 3),
        unfit_in_view=result.unfit_seen,
        fit_s=round(result.longest_fit_s, 2),
        chance_s=round(result.longest_chance_s, 2),
        elapsed_s=round(result.elapsed_s, 2),
        contradicted=" ".join(sorted({e.event for e in result.events if e.event.endswith("_contradicts")})),
    )


def _all(seeds: Sequence[int], ahead: int, pool: Pool | None, flight: Callable[[int], Run]) -> Iterator[Run]:
    for seed, run in each(pool, flight, seeds, ahead):
        # A flight that broke the software is a finding, not the end of the others.
        yield _crashed(scenario_of(seed), run) if isinstance(run, BaseException) else run


def _crashed(scenario: Scenario, error: BaseException) -> Run:
    seed = scenario.basics.seed
    fault = scenario.faults[0].kind if scenario.faults else ""
    what = f"{type(error).__name__}: {error}"
    nothing: tuple[None, None, None, None, None] = (None,) * 5
    return Run(
        seed, scenario.basics.description, fault, "crashed", *nothing, False, 0.0, 0.0, 0.0, error=what
    )


def _quiet() -> None:
    """A worker says nothing of what the daemon would log."""
    logging.basicConfig(level=logging.CRITICAL)


def _keep(run: Run, directory: Path, config: Path | None, overrides: Sequence[str]) -> Path:
    """Fly a run again, the same bit for bit, and leave its scenario and its flight folder."""
    scenario = scenario_of(run.seed)
    folder = directory / f"{run.outcome}_{run.seed}"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scenario.toml").write_text(to_toml(scenario), encoding="utf-8")
    fly(scenario, config, overrides, LockstepOptions(record=folder))
    return folder
