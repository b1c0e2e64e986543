"""A simulated flight at a glance: the path over the terrain in section, what was said where, where it landed."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from companion.replay.plot import require_matplotlib
from companion.simulation.flight_result import FlightResult
from companion.simulation.ground import patch, unsafe
from companion.simulation.scenario import Scenario

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GROUND = "#8d7f6d"
PATH = "#1f5fa8"
FLAT = "#2e9e4f"
WRONG = "#d1493f"
SECTION_STEP_M = 0.02
MARGIN_M = 1.5
SHORT_WAY_M = 1.0
TRUTH_EVERY = 5
LABELLED = 0.02
"""Share of the flight from which a state of the procedure has its name."""
VIEW_M = 1.0
"""Half the side of the ground whose true inclination is drawn."""


def draw(result: FlightResult, scenario: Scenario, path: Path) -> None:
    """Write the picture (PNG, SVG or PDF by its ending). Raises LandslopeError without matplotlib."""
    require_matplotlib()
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 8), dpi=110, layout="constrained")
    section, inclination, height = figure.subplots(3, 1, gridspec_kw={"height_ratios": [2.6, 1.1, 1.0]})
    _draw_section(section, result, scenario)
    _draw_inclination(inclination, result, scenario)
    _draw_height(height, result)
    limits = (0.0, max(result.duration_s, 1.0))
    for axis in (inclination, height):
        axis.set_xlim(*limits)
        axis.grid(alpha=0.25)
        for request in result.requests:
            axis.axvline(request.time_s, color="black", lw=1.2)
    for axis in (section, inclination, height):
        axis.spines[["top", "right"]].set_visible(False)
    wrong = result.deviations(scenario.expect)
    figure.suptitle(
        f"{result.name}: {'; '.join(wrong) if wrong else scenario.basics.description}", fontsize=12
    )
    figure.savefig(path)


def _draw_section(axis: "Axes", result: FlightResult, scenario: Scenario) -> None:
    north = np.array([p.north_m for p in result.path])
    east = np.array([p.east_m for p in result.path])
    times = np.array([p.time_s for p in result.path])
    up = np.array([p.height_m for p in result.path])
    along, label, section = _way(north, east)
    s_ground, ground = _ground(scenario, section, along)
    axis.fill_between(s_ground, ground, ground.min() - 0.6, color=GROUND, alpha=0.55, lw=0, label="ground")
    axis.plot(along, up, color=PATH, lw=1.5, label="path of the vehicle")
    flat = _flat_at(result, times)
    landing = np.array([p.mode == "LAND" for p in result.path])
    axis.plot(
        np.where(flat & ~landing, along, np.nan),
        np.where(flat & ~landing, up, np.nan),
        color=FLAT,
        lw=5,
        alpha=0.6,
        solid_capstyle="round",
        label="said: fit for landing",
    )
    axis.plot(along, np.where(landing, up, np.nan), color=PATH, lw=3, ls=":", label="landing")
    for request in result.requests:
        s = float(np.interp(request.time_s, times, along))
        # a procedure asks for the disc below, whatever lies beside it
        unfit = unsafe(request.below, result.limit_deg) if result.steps else request.fitness == "unfit"
        colour = WRONG if unfit else "black"
        axis.plot(s, request.where.height_m, "v", color=colour, ms=11, label="landing requested")
        axis.annotate(
            f"landing requested\n{request.time_s:.1f} s", (s, request.where.height_m), xytext=(8, 10),
            textcoords="offset points", fontsize=9, color=colour,
        )  # fmt: skip
    if result.touch_down is not None:
        s = float(np.interp(result.touch_down.time_s, times, along))
        at = -result.touch_down.position[2]
        axis.plot(s, at, "X", color="black", ms=10, label="touchdown")
    axis.set_xlabel(label)
    axis.set_ylabel("height (m)")
    axis.set_ylim(float(ground.min()) - 0.6, float(max(up.max(), ground.max())) + 0.8)
    axis.legend(loc="upper right", fontsize=9)
    if np.ptp(s_ground) < 6 * (np.ptp(up) + 1):
        axis.set_aspect("equal", adjustable="datalim")


def _way(north: np.ndarray, east: np.ndarray) -> tuple[np.ndarray, str, list[np.ndarray]]:
    """Where each point of the path lies in the section: along the main direction of the flight."""
    centre = np.array([north.mean(), east.mean()])
    points = np.stack([north, east], axis=1) - centre
    _, _, axes = np.linalg.svd(points, full_matrices=False)
    direction = axes[0] if np.ptp(points @ axes[0]) > SHORT_WAY_M else np.array([1.0, 0.0])
    if (points[-1] - points[0]) @ direction < 0:
        direction = -direction
    offset = float(centre @ direction)
    bearing = np.degrees(np.arctan2(direction[1], direction[0])) % 360
    return points @ direction + offset, f"along bearing {bearing:.0f} degrees (m)", [direction, centre]


def _ground(
    scenario: Scenario, section: list[np.ndarray], along: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    direction, centre = section
    world = scenario.world()
    s = np.arange(along.min() - MARGIN_M, along.max() + MARGIN_M, SECTION_STEP_M)
    foot = centre - (centre @ direction) * direction
    heights = np.array([world.height_at(*(foot + at * direction)) for at in s])
    known = np.isfinite(heights)
    return s[known], heights[known]


def _flat_at(result: FlightResult, times: np.ndarray) -> np.ndarray:
    """Whether the surface was said to be fit, at each of the times."""
    if not result.said_flat:
        return np.zeros(len(times), bool)
    when = np.array([t for t, _ in result.said_flat])
    said = np.array([f for _, f in result.said_flat])
    at = np.searchsorted(when, times, side="right") - 1
    return np.where(at >= 0, said[np.maximum(at, 0)], False)


def _draw_inclination(axis: "Axes", result: FlightResult, scenario: Scenario) -> None:
    estimates = [e for e in result.estimates if e.status == "ok"]
    times = [result.seconds(e.time_unix_us) for e in estimates]
    path = result.path[::TRUTH_EVERY]
    world = scenario.world()
    below = [patch(world, p.north_m, p.east_m, VIEW_M).inclination_deg for p in path]
    axis.plot(
        [p.time_s for p in path], below, color=GROUND, lw=3, alpha=0.6, label="true, of 2 m by 2 m below"
    )
    pitch = [p.pitch_deg for p in result.path]
    axis.plot([p.time_s for p in result.path], pitch, color="#b07cc6", lw=0.9, label="pitch of the vehicle")
    values = [np.nan if e.inclination_deg is None else e.inclination_deg for e in estimates]
    axis.plot(times, values, ".", ms=2.5, color=PATH, label="inclination, estimated")
    if all(np.isnan(values)):
        slopes = [np.hypot(e.slope_x_deg or np.nan, e.slope_y_deg or np.nan) for e in estimates]
        axis.plot(times, slopes, ".", ms=2.5, color=PATH, label="slope against the camera, estimated")
    limit = scenario.flight_settings(None).decision.max_inclination_deg
    axis.axhline(limit, color=WRONG, ls="--", lw=1, label=f"limit, {limit:g} degrees")
    axis.set_ylim(-15, 50)
    axis.set_ylabel("degrees")
    axis.legend(loc="upper right", fontsize=8, ncols=2)


def _draw_height(axis: "Axes", result: FlightResult) -> None:
    times = [p.time_s for p in result.path]
    axis.plot(times, [p.height_m - p.ground_m for p in result.path], color=PATH, lw=1.2)
    steps = result.steps
    changes = [k for k in range(len(steps)) if k == 0 or steps[k].step.state is not steps[k - 1].step.state]
    for number, k in enumerate(changes):
        end = changes[number + 1] if number + 1 < len(changes) else len(steps) - 1
        axis.axvspan(steps[k].time_s, steps[end].time_s, color=PATH, alpha=0.05 + 0.1 * (number % 2), lw=0)
        if steps[end].time_s - steps[k].time_s < LABELLED * result.duration_s:
            continue
        axis.annotate(
            steps[k].step.state.value.replace("_", " "), (steps[k].time_s, 1.0), xytext=(2, -3),
            xycoords=("data", "axes fraction"), textcoords="offset points", fontsize=7, rotation=90, va="top",
        )  # fmt: skip
    axis.set_ylabel("height over\nground (m)")
    axis.set_xlabel("time (s)")
    axis.set_ylim(bottom=0)
