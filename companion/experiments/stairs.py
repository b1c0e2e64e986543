"""Figs. 9 and 11: over a platform, down the stairs and over the floor at 160 x 120, with and without attitude."""

import math
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
    camera_of,
    estimate_all,
)
from companion.experiments.report import COLOURS, OTHER_COLOUR, Comparison, Section, Table, new_figure, save
from drivers.simulated.world.camera import Pose, SensorOptions, SimulatedCamera
from drivers.simulated.world.lens import Lens
from drivers.simulated.world.render import Renderer
from drivers.simulated.world.surfaces import stairs
from drivers.simulated.world.world import World
from landing.rotations import matrix_from_euler

RISE_M, RUN_M = 0.17, 0.29
CLEARANCE_M = 1.7
SPEED = 0.6
PITCH_DEG = -5.0
"""Nose down, to fly forward."""
MARGIN_M = 1.1
"""Closer than this to an edge the picture holds two of the three surfaces."""
SETTLED = 10


def flight(
    use_attitude: bool, speed: float, steps: int, before_m: float, after_m: float, seed: int
) -> Outcome:
    """One flight at a fixed height over the steps, forward by pitching."""
    length = steps * RUN_M
    slope = math.atan2(RISE_M, RUN_M)
    world = World(
        stairs(count=steps, rise=RISE_M, run=RUN_M, material="gravel", riser_material="noise", texture_m=3.0)
    )

    def ground(north: float) -> float:
        return RISE_M * steps * (1 - min(max(north / length, 0.0), 1.0))

    def pose(t: float) -> Pose:
        north = -before_m + speed * t
        pitch = math.radians(PITCH_DEG + 2.0 * math.sin(2 * math.pi * 0.5 * t))
        roll = math.radians(1.5 * math.sin(2 * math.pi * 0.37 * t))
        sinking = speed * RISE_M / RUN_M if 0 < north < length else 0.0
        velocity = np.array([speed, 0.0, sinking])
        return Pose(
            np.array([north, 0.0, -ground(north) - CLEARANCE_M]),
            matrix_from_euler(roll, pitch, 0.0),
            velocity,
        )

    lens = Lens.from_fov(160, 120, 64)
    camera = SimulatedCamera(Renderer(world, lens), SensorOptions(), seed=seed)
    n = int((before_m + length + after_m) / speed / FRAME_S)
    times = np.arange(n, dtype=np.float64) * FRAME_S
    poses = [pose(float(t)) for t in times]
    images = [camera.expose(k, float(t), pose) for k, t in enumerate(times)]
    estimates = estimate_all(
        images, camera_of(lens), [p.ned_from_body for p in poses], use_attitude=use_attitude
    )
    # Where the optical axis meets the ground; nose down, it looks back.
    seen = np.array([p.position[0] for p in poses]) + CLEARANCE_M * math.tan(math.radians(PITCH_DEG))
    zone = np.select(
        [seen < -MARGIN_M, (seen > MARGIN_M) & (seen < length - MARGIN_M), seen > length + MARGIN_M],
        [0, 1, 2],
        -1,
    )
    truth = np.where((seen > 0) & (seen < length), -math.degrees(slope), 0.0)
    pitch = np.array([math.degrees(-math.asin(p.ned_from_body[2, 0])) for p in poses])
    return Outcome(
        {"attitude": use_attitude}, {"zone": zone, "truth": truth, "pitch": pitch, "time": times}, estimates
    )


def jobs(quick: bool, seed: int) -> list[Job]:
    """With the attitude subtracted, and without."""
    size = {"steps": 18, "before_m": 3.0, "after_m": 3.5, "speed": SPEED}
    if quick:
        size = {"steps": 9, "before_m": 1.7, "after_m": 1.7, "speed": 2 * SPEED}
    return [Job(flight, {"use_attitude": use, **size, "seed": seed}) for use in (False, True)]


ZONES = ("platform", "stairs", "floor")


def _errors(o: Outcome, method: str, zone: int) -> Array:
    error = np.where(o.ok(method), o.series(method, "surface_pitch_deg"), math.nan) - o.truth["truth"]
    chosen = o.truth["zone"] == zone
    chosen[:SETTLED] = False
    return error[chosen]


def section(outcomes: list[Outcome], out: Path) -> Section:
    """The report's part."""
    figure, axes = new_figure(2, len(outcomes), 12, 5.6, sharex=True, sharey="row")
    for column, o in enumerate(outcomes):
        time = o.truth["time"]
        for row, field in enumerate(("surface_pitch_deg", "surface_roll_deg")):
            axis = axes[row, column]
            for method in METHODS:
                values = np.where(o.ok(method), o.series(method, field), math.nan)
                axis.plot(time, values, color=COLOURS.get(method, OTHER_COLOUR), lw=1, label=method)
            axis.plot(
                time, o.truth["truth"] if row == 0 else np.zeros_like(time), "k--", lw=0.9, label="truth"
            )
        axes[0, column].set_title("attitude subtracted" if o.label["attitude"] else "attitude not subtracted")
        axes[1, column].set_xlabel("time, s")
    axes[0, 0].set(ylabel="slope along the way, deg", ylim=(-50, 25))
    axes[1, 0].set(ylabel="slope across, deg", ylim=(-20, 20))
    axes[0, 0].legend(frameon=False, ncols=3, loc="lower left")
    rows, lines = [], {}
    for o in outcomes:
        used = o.label["attitude"]
        offsets = []
        for method in METHODS:
            for zone, name in enumerate(ZONES):
                errors = _errors(o, method, zone)
                known = errors[np.isfinite(errors)]
                offset = f"{np.median(known):+.1f}" if len(known) else "none"
                rows.append(["yes" if used else "no", method, name, offset, *Errors.of(errors).cells()])
            level = np.concatenate([_errors(o, method, 0), _errors(o, method, 2)])
            steps = _errors(o, method, 1)
            offsets.append(
                f"{method}: offset {np.nanmedian(level):+.1f} deg on the level parts, "
                f"{np.nanmedian(steps):+.1f} on the stairs"
            )
        lines[used] = "; ".join(offsets)
    pitch = float(np.mean(outcomes[0].truth["pitch"]))
    return Section(
        "Figs. 9 and 11: stairs, 160 x 120",
        f"Forward at {SPEED} m/s (quick: {2 * SPEED}), {CLEARANCE_M} m over a platform, steps of {RISE_M} by {RUN_M} m "
        f"({math.degrees(math.atan2(RISE_M, RUN_M)):.1f} degrees down) and a floor; the vehicle's pitch "
        f"is {pitch:.1f} degrees on average and swings by 2, its roll by 1.5. Rotation is taken out of the flow in "
        "both; what differs is whether the attitude is subtracted from the slope. Scored where the picture holds one "
        "of the three alone.",
        [(save(figure, out, "fig9.png"), "Figs. 9 and 11. Slopes over time; dashed: truth.")],
        [
            Table(
                "Slope along the way: median offset and absolute errors, degrees.",
                ["attitude", "method", "where", "offset", *ERROR_COLUMNS],
                rows,
            )
        ],
        [
            Comparison(
                "stairs, attitude not subtracted",
                "an offset by the vehicle's pitch",
                f"pitch {pitch:.1f} deg; {lines[False]}",
            ),
            Comparison("stairs, attitude subtracted", "the stairs differ from the floor", lines[True]),
        ],
    )
