"""Fig. 5: slopes of 0 to 60 degrees, seen in motion along X, Y and Z; and what ventral flow they need."""

import math
from pathlib import Path
from typing import Literal

import numpy as np

from companion.experiments.measure import (
    ERROR_COLUMNS,
    FRAME_S,
    METHODS,
    Array,
    Errors,
    Job,
    Outcome,
    camera_of,
    estimate_all,
)
from companion.experiments.report import COLOURS, OTHER_COLOUR, Comparison, Section, Table, new_figure, save
from drivers.simulated.world.sequences import plane_sequence

SLOPES = (0, 15, 30, 45, 60)
TEXTURES = ("noise", "gravel", "roof")
SIDEWAYS = 0.011
FLOWS = (0.0005, 0.001, 0.002, 0.004, 0.008, 0.016)
Motion = Literal["x", "y", "z"]
SETTLED = 5
"""Frames at the start that are not scored: the estimators gather their baseline."""


def slope(
    texture: str, slope_deg: float, motion: Motion, n: int, tau: float, omega: float, seed: int
) -> Outcome:
    """One sequence over a plane that slopes along the image's columns (Y)."""
    s = plane_sequence(
        texture,
        slope_deg,
        axis="y",
        motion=motion,
        n=n,
        tau=tau,
        omega=omega,
        # Along Z the last pictures are thirteen times as near: from here a texel then covers two pixels, not seven.
        distance=7.0 if motion == "z" else 2.0,
        seed=seed,
        samples=2,
    )
    estimates = estimate_all(list(s.images), camera_of(s.lens), [np.eye(3)] * n)
    label = {"texture": texture, "slope": slope_deg, "motion": motion, "omega": omega}
    return Outcome(
        label, {"flow": np.linalg.norm(s.omega[:, :2], axis=1), "tau": s.time_to_contact}, estimates
    )


def jobs(quick: bool, seed: int) -> list[Job]:
    """All slopes, motions and textures at the paper's flow; then a sweep over the ventral flow."""
    slopes, textures, n = ((0, 30), TEXTURES[:1], 14) if quick else (SLOPES, TEXTURES, 30)
    flows = (0.002, 0.008) if quick else FLOWS
    along, tau = (16, 30.0) if quick else (61, 65.0)
    found = []
    for texture in textures:
        for angle in slopes:
            for motion in "xyz":
                frames = along if motion == "z" else n
                found.append((texture, angle, motion, frames, SIDEWAYS))
        found += [(texture, 30, "y", n, flow) for flow in flows]
    names = ("texture", "slope_deg", "motion", "n", "omega")
    return [Job(slope, {**dict(zip(names, f, strict=True)), "tau": tau, "seed": seed}) for f in found]


def slope_error(outcome: Outcome, method: str) -> Array:
    """(n - SETTLED,) degrees, along the sloped axis; NaN where there is no estimate."""
    error = outcome.series(method, "slope_y_deg") - outcome.label["slope"]
    return np.where(outcome.ok(method), error, math.nan)[SETTLED:]


def section(outcomes: list[Outcome], out: Path) -> Section:
    """The report's part."""
    paper = [o for o in outcomes if o.label["omega"] == SIDEWAYS]
    sweep = [o for o in outcomes if o.label["omega"] != SIDEWAYS]
    rows, by_motion = [], {}
    for motion in "xyz":
        for method in METHODS:
            chosen = [o for o in paper if o.label["motion"] == motion]
            for angle in sorted({o.label["slope"] for o in chosen}):
                errors = [slope_error(o, method) for o in chosen if o.label["slope"] == angle]
                cells = Errors.of(np.concatenate(errors)).cells()
                rows.append([motion.upper(), method, f"{angle:.0f}", *cells])
            errors = [slope_error(o, method) for o in chosen]
            by_motion[motion, method] = Errors.of(np.concatenate(errors))
            rows.append(
                [f"**{motion.upper()}**", f"**{method}**", "**all**", *by_motion[motion, method].cells()]
            )
    flow_rows = []
    for flow in sorted({o.label["omega"] for o in sweep}):
        for method in METHODS:
            errors = [slope_error(o, method) for o in sweep if o.label["omega"] == flow]
            flow_rows.append(
                [f"{flow:g}", f"{flow / FRAME_S:.3f}", method, *Errors.of(np.concatenate(errors)).cells()]
            )
    figures = [
        (
            _over_time(paper, out),
            "Fig. 5. Slope (top) and ventral flow (bottom) over time, first texture; dashed: truth.",
        ),
        (_against_flow(sweep, out), "Slope error against ventral flow; slope 30 degrees, motion in Y."),
    ]

    def line(motion: str) -> str:
        return "; ".join(
            f"{m}: median {by_motion[motion, m].median:.2f}, p95 {by_motion[motion, m].p95:.1f} deg"
            for m in METHODS
        )

    asked = "; ".join(
        f"{row[2]} at {row[0]} per frame: {row[3] + ' deg' if row[3] != 'none' else 'no estimate'}"
        for row in (*flow_rows[: len(METHODS)], *flow_rows[-len(METHODS) :])
    )
    return Section(
        "Fig. 5: slopes of 0 to 60 degrees, motion in X, Y and along Z",
        "Pictures of 256 x 256, 50 degrees across, grey noise of 2 levels. Sideways the ventral flow is 0.011 a frame; "
        "along Z the time to contact falls from 65 frames (quick: 30). The error is that of the angle along the sloped "
        f"axis, the first {SETTLED} frames left out. A frame without an estimate is a failure.",
        figures,
        [
            Table("Slope error, degrees.", ["motion", "method", "slope", *ERROR_COLUMNS], rows),
            Table(
                "Slope error against ventral flow (slope 30 degrees, motion in Y), degrees.",
                ["flow, 1/frame", "flow, 1/s", "method", *ERROR_COLUMNS],
                flow_rows,
            ),
        ],
        [
            Comparison("slope error, motion in Y", "a few degrees", line("y")),
            Comparison("slope error, motion in X", "no figure known here", line("x")),
            Comparison("slope error, motion along Z", "no figure known here", line("z")),
            Comparison(
                "ventral flow against slope error",
                "asks for the relation",
                "median error, " + asked,
            ),
        ],
    )


def _over_time(outcomes: list[Outcome], out: Path) -> str:
    texture = outcomes[0].label["texture"]
    figure, axes = new_figure(2, 3, 12, 5.6, sharex="col")
    for column, motion in enumerate("xyz"):
        slopes, flows = axes[0, column], axes[1, column]
        for o in outcomes:
            if o.label["texture"] != texture or o.label["motion"] != motion:
                continue
            frames = np.arange(len(o.truth["flow"]))
            slopes.axhline(o.label["slope"], color="k", ls="--", lw=0.8)
            for method in METHODS:
                colour = COLOURS.get(method, OTHER_COLOUR)
                label = method if o.label["slope"] == 0 else None
                slopes.plot(frames, o.series(method, "slope_y_deg"), color=colour, lw=1, label=label)
                flow = (
                    np.hypot(o.series(method, "ventral_flow_x"), o.series(method, "ventral_flow_y")) * FRAME_S
                )
                flows.plot(frames, flow, color=colour, lw=0.8, label=label)
            flows.plot(frames, o.truth["flow"], "k--", lw=0.8)
        slopes.set(title=f"motion {'along' if motion == 'z' else 'in'} {motion.upper()}", ylim=(-15, 75))
        flows.set(xlabel="frame", ylim=(-0.001, 0.02))
    axes[0, 0].set_ylabel("slope, deg")
    axes[1, 0].set_ylabel("ventral flow, 1/frame")
    axes[0, 0].legend(frameon=False, loc="upper left", ncols=2)
    return save(figure, out, "fig5.png")


def _against_flow(outcomes: list[Outcome], out: Path) -> str:
    figure, axes = new_figure(1, 1, 6, 3.8)
    axis = axes[0, 0]
    flows = sorted({o.label["omega"] for o in outcomes})
    for method in METHODS:
        pooled = [
            Errors.of(np.concatenate([slope_error(o, method) for o in outcomes if o.label["omega"] == f]))
            for f in flows
        ]
        colour = COLOURS.get(method, OTHER_COLOUR)
        axis.loglog(flows, [e.median for e in pooled], "o-", color=colour, label=f"{method}, median")
        axis.loglog(flows, [e.p95 for e in pooled], "o:", color=colour, label=f"{method}, p95", mfc="white")
    axis.set(xlabel="ventral flow, 1/frame", ylabel="slope error, deg")
    figure.legend(loc="outside upper center", frameon=False, ncols=2)
    return save(figure, out, "fig5_flow.png")
