"""Figs. 6 and 7: a camera moved by hand over slopes, uncalibrated and turning; and the same with derotation."""

import math
from itertools import pairwise
from pathlib import Path

import numpy as np

from companion.experiments.measure import (
    ERROR_COLUMNS,
    FRAME_S,
    METHODS,
    Array,
    Errors,
    Job,
    Outcome,
    auc,
    camera_of,
    estimate_all,
)
from companion.experiments.report import COLOURS, OTHER_COLOUR, Comparison, Section, Table, new_figure, save
from drivers.simulated.world.camera import Pose, SensorOptions, SimulatedCamera
from drivers.simulated.world.lens import Lens
from drivers.simulated.world.render import Renderer
from drivers.simulated.world.surfaces import ramp
from drivers.simulated.world.world import World
from landing.rotations import matrix_from_euler

SLOPES = (0, 15, 30, 45)
DISTANCE_M = 1.2
SETTLED = 8
"""Frames at the start that are not scored: the estimators gather their baseline."""
ASSUMED_FOV_DEG = 50.0
TRUE_LENS = Lens(
    256,
    256,
    np.array([[238.0, 0, 131.0], [0, 238.0, 124.0], [0, 0, 1]]),
    np.array([-0.18, 0.05, 1e-3, 0.0, 0.0]),
)


class Hand:
    """The motion of a hand-held camera: it swings along the image's columns and turns a little about all axes.

    Positions (m) and angles (rad) are sums of sines with seeded rates and phases. Calling it with a time in seconds
    gives the camera's pose then. ``turn_deg``: amplitude of the turns about each axis.
    """

    def __init__(self, slope_deg: float, turn_deg: float, seed: int) -> None:
        self._climb = math.tan(math.radians(slope_deg))
        rng = np.random.default_rng([seed, 6])
        self._rate = 2 * math.pi * rng.uniform(0.4, 1.3, (3, 2))
        self._phase = rng.uniform(0, 2 * math.pi, (3, 2))
        self._turn = math.radians(turn_deg) / math.sqrt(2)

    def _position(self, t: float) -> Array:
        north = 0.28 * math.sin(2 * math.pi * 0.45 * t - 0.6)
        east = 0.05 * math.sin(2 * math.pi * 0.3 * t)
        return np.array(
            [north, east, -DISTANCE_M - self._climb * north + 0.03 * math.sin(2 * math.pi * 0.7 * t)]
        )

    def __call__(self, t: float) -> Pose:
        roll, pitch, yaw = self._turn * np.sin(self._rate * t + self._phase).sum(axis=1)
        speed = (self._position(t + 1e-4) - self._position(t - 1e-4)) / 2e-4
        return Pose(self._position(t), matrix_from_euler(roll, pitch, yaw), speed)


def hand_held(slope_deg: float, n: int, known: bool, turn_deg: float, seed: int) -> Outcome:
    """One sequence of ``n`` frames over a plane that slopes by ``slope_deg``, with the estimates of every method.

    ``known``: the estimators get the true lens and the true rotation, as on a vehicle; otherwise an ideal lens of
    ASSUMED_FOV_DEG and no rotation. The truth, ``slope_y``, is the slope relative to the camera, degrees.
    """
    world = World(ramp(inclination_deg=slope_deg, material="gravel", texture_m=3.0))
    camera = SimulatedCamera(Renderer(world, TRUE_LENS), SensorOptions(), seed=seed)
    hand = Hand(slope_deg, turn_deg, seed)
    images, attitudes, truth = [], [], []
    for frame, row in camera.frames(hand, 0.0, n, rate_hz=1 / FRAME_S):
        images.append(frame.image)
        attitudes.append(hand(row.time_boot_s).ned_from_body)
        truth.append(math.degrees(math.atan(row.slope_b)))
    if known:
        estimates = estimate_all(images, camera_of(TRUE_LENS), attitudes)
    else:
        estimates = estimate_all(images, camera_of(Lens.from_fov(256, 256, ASSUMED_FOV_DEG)), None)
    return Outcome({"slope": slope_deg, "known": known}, {"slope_y": np.array(truth)}, estimates)


def jobs(quick: bool, seed: int) -> list[Job]:
    """Every slope, with and without knowledge of camera and rotation; ``quick``: two slopes, few frames."""
    slopes, n = ((0, 30), 18) if quick else (SLOPES, 120)
    return [
        Job(hand_held, {"slope_deg": s, "n": n, "known": known, "turn_deg": 1.5, "seed": seed})
        for known in (False, True)
        for s in slopes
    ]


def _slopes(o: Outcome, method: str) -> Array:
    return np.where(o.ok(method), o.series(method, "slope_y_deg"), math.nan)[SETTLED:]


def section(outcomes: list[Outcome], out: Path) -> Section:
    """The report's part."""
    figure, axes = new_figure(1, 2, 12, 4, sharey=True)
    for axis, known in zip(axes[0], (False, True), strict=True):
        for o in outcomes:
            if o.label["known"] != known:
                continue
            time = np.arange(len(o.truth["slope_y"])) * FRAME_S
            axis.plot(time, o.truth["slope_y"], "k--", lw=0.8)
            for method in METHODS:
                values = np.where(o.ok(method), o.series(method, "slope_y_deg"), math.nan)
                label = method if o.label["slope"] == 0 else None
                axis.plot(time, values, color=COLOURS.get(method, OTHER_COLOUR), lw=1, label=label)
        axis.set(
            title="calibrated, derotated" if known else "uncalibrated, rotation unknown", xlabel="time, s"
        )
    axes[0, 0].set(ylabel="slope relative to the camera, deg", ylim=(-40, 85))
    axes[0, 0].legend(frameon=False, loc="upper left", ncols=2)
    rows = []
    lines: dict[bool, list[str]] = {False: [], True: []}
    for known in (False, True):
        chosen = sorted((o for o in outcomes if o.label["known"] == known), key=lambda o: o.label["slope"])
        for method in METHODS:
            errors = {o.label["slope"]: _slopes(o, method) - o.truth["slope_y"][SETTLED:] for o in chosen}
            medians = [_median(_slopes(o, method)) for o in chosen]
            apart = [auc(_slopes(a, method), _slopes(b, method)) for a, b in pairwise(chosen)]
            for o, median in zip(chosen, medians, strict=True):
                cells = Errors.of(errors[o.label["slope"]]).cells()
                what = "calibrated, derotated" if known else "uncalibrated"
                rows.append([what, method, f"{o.label['slope']}", f"{median:.1f}", *cells])
            ordered = all(a < b for a, b in pairwise(medians))
            pooled = Errors.of(np.concatenate(list(errors.values())))
            lines[known].append(
                f"{method}: medians {' < '.join(f'{m:.1f}' for m in medians) if ordered else medians} deg, "
                f"order {'kept' if ordered else 'lost'}, neighbours distinguished frame by frame in "
                f"{100 * min(apart):.0f} % or more; error median {pooled.median:.1f}, p95 {pooled.p95:.1f} deg, "
                f"failures {100 * pooled.failures / pooled.frames:.0f} %"
            )
    return Section(
        "Figs. 6 and 7: a camera in the hand",
        "The camera swings over planes of different slope and turns by about 1 degree RMS about every axis. Once its "
        "lens (distorted, 56.5 degrees) is taken for an ideal one of 50 degrees and its rotation is not measured; "
        "once both are known. Frames near the turning points have next to no motion. Errors are against the slope "
        "relative to the camera at that frame.",
        [(save(figure, out, "fig6.png"), "Figs. 6 and 7. Slope over time; dashed: truth.")],
        [
            Table(
                "Slope relative to the camera, degrees: median of the estimates, and errors.",
                ["camera", "method", "slope", "estimate", *ERROR_COLUMNS],
                rows,
            )
        ],
        [
            Comparison(
                "order of the slopes, uncalibrated", "the slopes come in their order", "; ".join(lines[False])
            ),
            Comparison("the same with derotation", "not in the paper", "; ".join(lines[True])),
        ],
    )


def _median(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else math.nan
