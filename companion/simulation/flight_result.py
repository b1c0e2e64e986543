"""What became of a simulated flight: path, verdicts, requests, touchdown, and the truth of the ground there."""

import math
from dataclasses import dataclass, field
from pathlib import Path

from companion.messages.messages import Decision, Estimate, Event, Health, Message
from companion.simulation.ground import Fitness, Patch, unsafe
from companion.simulation.procedure_figures import flown
from companion.simulation.scenario import Expectation
from drivers.simulated.vehicle.vehicle import Multirotor, TouchDown
from drivers.simulated.world.truth import FrameTruth
from landing.decision.orders import Step


@dataclass(frozen=True, slots=True)
class PathPoint:
    """The vehicle at a moment, in truth; ``ground_m`` is the height of the ground below."""

    time_s: float
    north_m: float
    east_m: float
    height_m: float
    ground_m: float
    mode: str
    pitch_deg: float


def path_point(vehicle: Multirotor, flown_s: float, mode: str) -> PathPoint:
    """Where a vehicle is now."""
    n, e, d = vehicle.position
    return PathPoint(flown_s, n, e, -d, vehicle.ground(n, e), mode, math.degrees(vehicle.euler[1]))


@dataclass(frozen=True, slots=True)
class Request:
    """A landing was requested: when, where, over what; ``fitness`` is of the ground in view at its frame."""

    time_s: float
    frame: int
    where: PathPoint
    truth: FrameTruth
    fitness: Fitness
    below: Patch


@dataclass(frozen=True, slots=True)
class FlownStep:
    """A step of the landing procedure, with the vehicle's true position and velocity (NED) then."""

    time_s: float
    step: Step
    position: tuple[float, float, float]
    velocity: tuple[float, float, float]


@dataclass(slots=True)
class FlightResult:
    """Everything known at the end of a flight; times in simulated seconds from its start."""

    name: str
    epoch_us: int = 0
    """The companion's clock at the flight's start."""
    duration_s: float = 0.0
    elapsed_s: float = 0.0
    estimates: list[Estimate] = field(default_factory=list)
    decisions: list[Decision] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    health: Health | None = None
    path: list[PathPoint] = field(default_factory=list)
    said_flat: list[tuple[float, bool]] = field(default_factory=list)
    """(time, whether the surface was said to be fit) at every estimate."""
    steps: list[FlownStep] = field(default_factory=list)
    """What the landing procedure ordered."""
    requests: list[Request] = field(default_factory=list)
    touch_down: TouchDown | None = None
    touch_ground: Patch | None = None
    longest_fit_s: float = 0.0
    """Longest time for which clearly fit ground was in view without a break, where that was followed."""
    longest_chance_s: float = 0.0
    """Of that, while the ground straight below was in view from a height at which it can be measured."""
    limit_deg: float = 10.0
    """Steepest ground that the settings land on."""
    unfit_seen: bool = False
    """Whether clearly unfit ground was ever in view."""
    folder: Path | None = None
    """The flight folder that was recorded."""
    problems: list[str] = field(default_factory=list)
    _verdict: str = "unknown"

    def add(self, message: Message) -> None:
        """Keep a message."""
        match message:
            case Estimate():
                self.estimates.append(message)
                self.said_flat.append((self.seconds(message.time_unix_us), self._verdict == "fit"))
            case Decision():
                self.decisions.append(message)
                self._verdict = message.verdict
            case Event():
                self.events.append(message)
            case Health():
                self.health = message

    def seconds(self, time_unix_us: int) -> float:
        """A message's time since the flight's start."""
        return (time_unix_us - self.epoch_us) / 1e6

    def deviations(self, expect: Expectation) -> list[str]:
        """What went otherwise than it should, in words; empty when nothing did."""
        wrong = [
            f"a landing was requested over ground that is not fit for it, at {r.time_s:.1f} s: "
            f"inclination {r.truth.fit_inclination_deg:.1f} degrees, relief {r.truth.relief:.3f} of the distance"
            for r in self.requests
            if r.fitness == "unfit" and not self.steps
        ]
        if self.steps and self.touch_ground is not None and unsafe(self.touch_ground, self.limit_deg):
            wrong.append("it touched down on ground that is not fit for it")
        if expect.landing == "requested" and not self.requests:
            wrong.append("no landing was requested, although there was ground to land on")
        if expect.landing == "none" and self.requests:
            wrong.append(f"a landing was requested at {self.requests[0].time_s:.1f} s, although none was due")
        if len(self.requests) > 1:
            wrong.append(f"a landing was requested {len(self.requests)} times")
        places = [r.where.north_m for r in self.requests]
        if self.touch_down is not None:
            places.append(self.touch_down.position[0])
        for north in places:
            if not expect.min_north_m <= north <= expect.max_north_m:
                wrong.append(
                    f"it was {north:.1f} m north, outside {expect.min_north_m:g} to {expect.max_north_m:g} m"
                )
        return wrong + self.problems


def in_words(result: FlightResult) -> str:
    """What happened, several lines."""
    lines = [f"{result.name}: {result.duration_s:.1f} s of flight in {result.elapsed_s:.1f} s"]
    estimates = result.estimates
    good = sum(e.status == "ok" for e in estimates)
    if estimates:
        lines.append(f"  estimates  {good} of {len(estimates)} frames ({100 * good / len(estimates):.0f} %)")
    fit = [t for t, flat in result.said_flat if flat]
    if fit:
        lines.append(
            f"  fit        said first at {fit[0]:.1f} s, {100 * len(fit) / len(result.said_flat):.0f} % of the time"
        )
    else:
        lines.append("  fit        never said")
    for r in result.requests:
        height = r.where.height_m - r.where.ground_m
        # a procedure asks for the disc below, whatever lies beside it
        over = _disc(r.below) if result.steps else f"ground that is {_described(r.truth, r.fitness)}"
        lines.append(
            f"  requested  at {r.time_s:.1f} s, {r.where.north_m:.1f} m north, {height:.1f} m over {over}"
        )
    if not result.requests:
        lines.append("  requested  no landing")
    if result.steps:
        final = result.steps[-1].step
        lines.append(f"  procedure  {final.state.value}: {final.words}")
        d = flown(result)
        lines.append(
            f"  descent    divergence {d.divergence:.2f} +- {d.divergence_std:.3f} 1/s, {d.hand_over_m_s:.2f} m/s "
            f"at the hand-over; {d.seconds:.1f} s in all; touched down {d.error_m:.2f} m from the place"
        )
    command = next((d.command for d in reversed(result.decisions) if d.command != "none"), None)
    if command is not None:
        lines.append(f"  command    {command}")
    touch, ground = result.touch_down, result.touch_ground
    if touch is not None and ground is not None:
        lines.append(
            f"  touchdown  at {touch.time_s:.1f} s, {touch.position[0]:.1f} m north, {touch.position[1]:.1f} m east, "
            f"{touch.velocity[2]:.2f} m/s down, on {ground.inclination_deg:.1f} degrees "
            f"(uneven by {100 * ground.deviation_m:.0f} cm)"
        )
    elif result.path:
        last = result.path[-1]
        lines.append(
            f"  ended      in the air, {last.height_m - last.ground_m:.1f} m over the ground, in {last.mode}"
        )
    if result.folder is not None:
        lines.append(f"  recorded   {result.folder}")
    return "\n".join(lines)


def _disc(below: Patch) -> str:
    return f"a disc of {below.inclination_deg:.1f} degrees (uneven by {100 * below.deviation_m:.0f} cm)"


def _described(truth: FrameTruth, fitness: Fitness) -> str:
    word = {"fit": "fit for it", "unfit": "NOT fit for it", "between": "neither clearly fit nor unfit"}[
        fitness
    ]
    if not math.isfinite(truth.relief):
        return word
    return f"{word} (true inclination {truth.fit_inclination_deg:.1f} degrees, relief {truth.relief:.4f})"
