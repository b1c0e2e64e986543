"""Fig. 8: the fit's error over flat and structured ground, and the roughness, on approaches of different speed."""

import math
from pathlib import Path

import numpy as np

from companion.experiments.measure import (
    FRAME_S,
    METHODS,
    Array,
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
from drivers.simulated.world.surfaces import level, rubble
from drivers.simulated.world.world import World
from landing.options import EstimatorOptions

TAUS = (40, 80, 160)
FRAME_TO_FRAME = "quadratic, frame to frame"
"""The paper's method on neighbouring pictures, whatever the length of the flow."""
SHOWN = (*METHODS, FRAME_TO_FRAME)
START_M, END_M = 4.0, 1.5
SIDEWAYS = 0.3
"""Sideways speed over the speed of descent."""
SETTLED = 5
WINDOW_M = 0.5
"""Heights within this of a place are taken together."""


def approach(structured: bool, tau: float, seed: int, part: int) -> Outcome:
    """A descent from 4 to 1.5 m with ``tau`` frames to contact at its start; only the first 1/``part`` of it."""
    facets = level(material="gravel")
    if structured:
        facets += rubble(
            seed=seed, count=160, length=8, width=8, smallest=0.15, largest=0.4, material="noise"
        )
    speed = START_M / (tau * FRAME_S)
    n = int((START_M - END_M) / speed / FRAME_S) // part

    def path(t: float) -> Pose:
        down = -START_M + speed * t
        velocity = np.array([SIDEWAYS * speed, 0.0, speed])
        return Pose(np.array([SIDEWAYS * speed * t - 0.5, 0.1, down]), np.eye(3), velocity)

    lens = Lens.from_fov(256, 256, 50)
    camera = SimulatedCamera(Renderer(World(facets), lens), SensorOptions(), seed=seed)
    images, relief, height = [], [], []
    for frame, truth in camera.frames(path, 0.0, n, rate_hz=1 / FRAME_S):
        images.append(frame.image)
        # Over the height above the ground, so that a box under the axis does not change it.
        relief.append(truth.relief * truth.axis_distance_m / -truth.pd)
        height.append(-truth.pd)
    neighbours = {FRAME_TO_FRAME: EstimatorOptions(method="quadratic", quadratic_max_gap=1)}
    estimates = estimate_all(images, camera_of(lens), [np.eye(3)] * n, variants=neighbours)
    label = {"structured": structured, "tau": tau}
    return Outcome(label, {"relief": np.array(relief), "height": np.array(height)}, estimates)


def jobs(quick: bool, seed: int) -> list[Job]:
    """Flat and structured, at every speed."""
    taus, part = ((30, 60), 2) if quick else (TAUS, 1)
    return [
        Job(approach, {"structured": s, "tau": float(t), "seed": seed, "part": part})
        for t in taus
        for s in (False, True)
    ]


def _series(o: Outcome, method: str, field: str) -> Array:
    return np.where(o.ok(method), o.series(method, field), math.nan)[SETTLED:]


def _median(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else math.nan


MEASURES = (("fit_error_px", "fit error, px"), ("inlier_fraction", "inliers"), ("roughness", "roughness"))


def section(outcomes: list[Outcome], out: Path) -> Section:
    """The report's part."""
    name = _figure(outcomes, out)
    flat = [o for o in outcomes if not o.label["structured"]]
    rough = [o for o in outcomes if o.label["structured"]]
    # The heights that every approach passes after its start.
    shared = float(min(o.truth["height"][SETTLED] for o in rough))
    rows, apart_rows, lines = [], [], []
    for method in SHOWN:
        spread: dict[str, list[float]] = {"fit_error_px": [], "roughness": []}
        for o in rough:
            near = np.abs(o.truth["height"][SETTLED:] - shared + WINDOW_M) < WINDOW_M
            values = [_median(_series(o, method, field)[near]) for field, _ in MEASURES]
            spread["fit_error_px"].append(values[0])
            spread["roughness"].append(values[2])
            relief = _median(o.truth["relief"][SETTLED:][near])
            rows.append([method, f"{o.label['tau']:.0f}", *[f"{v:.4f}" for v in (*values, relief)]])
        found = []
        for field, _ in MEASURES:
            low = np.concatenate([_series(o, method, field) for o in flat])
            high = np.concatenate([_series(o, method, field) for o in rough])
            found.append(auc(high, low) if field == "inlier_fraction" else auc(low, high))
        apart_rows.append([method, *[f"{v:.3f}" for v in found]])
        ratio = {k: max(v) / min(v) for k, v in spread.items()}
        lines.append(
            f"{method}: between approaches of different speed, at the same height, the fit error changes by a "
            f"factor of {ratio['fit_error_px']:.2f}, the roughness of {ratio['roughness']:.2f}; AUC of structured "
            f"against flat {found[0]:.3f} and {found[2]:.3f} (inliers: {found[1]:.3f})"
        )
    return Section(
        "Fig. 8: flat against structured scenes",
        "Descents from 4 to 1.5 m over level gravel, and over the same with 160 boxes of 0.15 to 0.4 m, at "
        "different speeds (frames to contact at the start). Both methods choose their baseline by the length of the "
        "flow; the paper's, from picture to picture, is shown beside them.",
        [
            (
                name,
                "Fig. 8. The fit's error over time to contact, and the roughness over height; dashed black: "
                "true relief over height.",
            )
        ],
        [
            Table(
                f"Structured ground at heights of {shared - 2 * WINDOW_M:.1f} to {shared:.1f} m: medians.",
                ["method", "frames to contact at the start", *[t for _, t in MEASURES], "true relief"],
                rows,
            ),
            Table(
                "Probability that a structured frame shows more than a flat one (AUC; all speeds and heights).",
                ["method", *[t for _, t in MEASURES]],
                apart_rows,
            ),
        ],
        [
            Comparison(
                "flat against structured",
                "larger errors and fewer inliers over structure; the error depends on time to contact",
                "; ".join(lines),
            )
        ],
    )


def _figure(outcomes: list[Outcome], out: Path) -> str:
    methods = SHOWN
    figure, axes = new_figure(2, len(methods), 4.5 * len(methods), 6.4, sharex="row", sharey="row")
    taus = sorted({o.label["tau"] for o in outcomes})
    styles = dict(zip(taus, ("-", "--", ":", "-."), strict=False))
    for column, method in enumerate(methods):
        for o in outcomes:
            colour = COLOURS.get(method, OTHER_COLOUR) if o.label["structured"] else "0.6"
            kind = "structured" if o.label["structured"] else "flat"
            label = f"{kind}, {o.label['tau']:.0f} frames"
            height = o.truth["height"][SETTLED:]
            style = styles[o.label["tau"]]
            contact = o.label["tau"] * height / START_M
            errors, roughness = axes[:, column]
            errors.loglog(
                contact, _series(o, method, "fit_error_px"), style, color=colour, lw=1.1, label=label
            )
            roughness.semilogy(
                height, _series(o, method, "roughness"), style, color=colour, lw=1.1, label=label
            )
        truth = next(o for o in outcomes if o.label["structured"] and o.label["tau"] == taus[-1])
        axes[1, column].semilogy(
            truth.truth["height"], truth.truth["relief"], "k--", lw=1, label="true relief"
        )
        axes[0, column].set_title(method)
        axes[0, column].set_xlabel("time to contact, frames")
        axes[1, column].set_xlabel("height, m")
    axes[0, 0].invert_xaxis()
    axes[1, 0].invert_xaxis()
    axes[1, 0].set_ylim(1e-3, 0.3)
    axes[0, 0].set_ylabel("fit error, px")
    axes[1, 0].set_ylabel("roughness")
    axes[1, 0].legend(frameon=False, fontsize=7, ncols=2)
    return save(figure, out, "fig8.png")
