"""Estimates of a flight against its truth.csv: how wrong, how often, how safe.

``python tests/support/score.py FLIGHT ESTIMATES.jsonl`` prints the figures, ``--table DIRECTORY FLIGHT...`` a row for
each flight whose estimates are DIRECTORY/FLIGHT.jsonl. Truth has one row a camera frame:
``slope_a``, ``slope_b`` (tangents, camera frame), ``inclination_deg``, ``cam_wx`` to ``cam_wz`` (camera velocity
over the distance along the axis, 1/s), ``plane_fraction`` (share of the view that belongs to the plane under the
axis), ``relief`` (RMS distance of all that is in view from its best plane, over the distance along the axis) and
``fit_inclination_deg`` (of that plane). Slopes count where one plane fills the view; the flat flag and the
roughness are held against the whole view, without the doubtful cases between clearly good and clearly bad.
"""

import csv
import json
import sys
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

WARM_UP_S = 2.0
WHOLE_PLANE = 0.97
EVEN, UNEVEN = 0.003, 0.015
SLOPE_MARGIN_DEG = 2.0
LEAST_FLOW = 0.05
LEAST_DIVERGENCE = 2 / 30


@dataclass(frozen=True)
class Errors:
    """Median, 95th percentile and largest of a set of errors; None when there are none."""

    n: int
    median: float | None
    p95: float | None
    max: float | None


@dataclass(frozen=True)
class Score:
    """The figures of one flight; angles in degrees, flow and time to contact relative."""

    frames: int
    coverage: float
    slope: Errors
    inclination: Errors
    inclination_over_std: Errors
    ventral_flow: Errors
    time_to_contact: Errors
    landable_said_flat: int
    landable_missed: int
    unsafe_said_flat: int
    unsafe_refused: int
    roughness_auc: float | None


def truth_of(flight: Path) -> dict[str, np.ndarray]:
    """Columns of truth.csv by name, each (n,)."""
    with (flight / "truth.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def score(flight: Path, estimates: Iterable[Mapping[str, Any]], max_slope_deg: float = 10.0) -> Score:
    """Hold the estimates (one mapping a frame, as in ``--out`` files) against the flight's truth."""
    truth = truth_of(flight)
    by_frame = {int(e["frame"]): e for e in estimates}
    rows = [by_frame.get(int(frame), {}) for frame in truth["frame"]]
    ok = np.array([row.get("status") == "ok" for row in rows])
    said_flat = ok & np.array([bool(row.get("flat")) for row in rows])

    def column(name: str) -> np.ndarray:
        values = [row.get(name) if good else None for row, good in zip(rows, ok, strict=True)]
        return np.array([np.nan if v is None else v for v in values], dtype=np.float64)

    late = truth["time_boot_s"] - truth["time_boot_s"][0] > WARM_UP_S
    plane = truth["plane_fraction"] >= WHOLE_PLANE
    scored = ok & plane

    slope_errors = np.stack(
        [
            column("slope_x_deg") - np.degrees(np.arctan(truth["slope_a"])),
            column("slope_y_deg") - np.degrees(np.arctan(truth["slope_b"])),
        ]
    )[:, scored]
    inclination_error = np.abs(column("inclination_deg") - truth["inclination_deg"])
    std = column("inclination_std_deg")
    flow = np.hypot(truth["cam_wx"], truth["cam_wy"])
    flow_error = np.hypot(
        column("ventral_flow_x") - truth["cam_wx"], column("ventral_flow_y") - truth["cam_wy"]
    )
    divergence = 2 * truth["cam_wz"] + truth["cam_wx"] * truth["slope_a"] + truth["cam_wy"] * truth["slope_b"]
    contact = column("time_to_contact_s")
    approaching = scored & (divergence > LEAST_DIVERGENCE) & np.isfinite(contact) & (contact != 0)
    moving = scored & (flow > LEAST_FLOW)
    with_std = scored & (std > 0)

    even, uneven = truth["relief"] <= EVEN, truth["relief"] >= UNEVEN
    steepness = truth["fit_inclination_deg"]
    landable = late & even & (steepness <= max_slope_deg - SLOPE_MARGIN_DEG)
    unsafe = late & ~landable & (uneven | (steepness >= max_slope_deg + SLOPE_MARGIN_DEG))
    roughness = column("roughness")
    rated = late & np.isfinite(roughness)

    return Score(
        frames=len(rows),
        coverage=float(ok[plane & late].mean()) if (plane & late).any() else float("nan"),
        slope=_errors(np.abs(slope_errors).ravel()),
        inclination=_errors(inclination_error[scored]),
        inclination_over_std=_errors(inclination_error[with_std] / std[with_std]),
        ventral_flow=_errors(flow_error[moving] / flow[moving]),
        time_to_contact=_errors(np.abs(contact[approaching] * divergence[approaching] / 2 - 1)),
        landable_said_flat=int((landable & said_flat).sum()),
        landable_missed=int((landable & ~said_flat).sum()),
        unsafe_said_flat=int((unsafe & said_flat).sum()),
        unsafe_refused=int((unsafe & ~said_flat).sum()),
        roughness_auc=_separation(roughness[rated & even], roughness[rated & uneven]),
    )


def read_estimates(path: Path) -> list[dict[str, Any]]:
    """The lines of an ``--out`` file."""
    return [json.loads(line) for line in path.read_text().splitlines() if line.strip()]


def _errors(values: np.ndarray) -> Errors:
    values = values[np.isfinite(values)]
    if not values.size:
        return Errors(0, None, None, None)
    median, p95 = np.percentile(values, (50, 95))
    return Errors(values.size, float(median), float(p95), float(values.max()))


def _separation(low: np.ndarray, high: np.ndarray) -> float | None:
    """Probability that a value of ``low`` lies below one of ``high``, ties counting half."""
    if not (low.size and high.size):
        return None
    ordered = np.sort(high)
    below = np.searchsorted(ordered, low, "right")
    strictly = np.searchsorted(ordered, low, "left")
    return float(1 - (below + strictly).sum() / 2 / (low.size * high.size))


def row(name: str, s: Score) -> str:
    """The figures as a row of the table in docs/accuracy.md: medians and 95th percentiles."""

    def pair(e: Errors, scale: float = 1.0, digits: int = 2) -> str:
        if e.median is None or e.p95 is None:
            return "-"
        return f"{e.median * scale:.{digits}f} / {e.p95 * scale:.{digits}f}"

    landable = s.landable_said_flat + s.landable_missed
    cells = [
        f"`{name}`",
        pair(s.slope),
        pair(s.inclination),
        pair(s.inclination_over_std),
        f"{s.coverage:.2f}",
        pair(s.ventral_flow, 100, 1),
        pair(s.time_to_contact, 100, 1),
        f"{s.unsafe_said_flat} of {s.unsafe_said_flat + s.unsafe_refused}",
        f"{100 * s.landable_missed / landable:.1f}" if landable else "-",
        "-" if s.roughness_auc is None else f"{s.roughness_auc:.3f}",
    ]
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Print the figures of one flight, or a table of several."""
    if sys.argv[1] == "--table":
        estimates, *flights = map(Path, sys.argv[2:])
        for flight in flights:
            print(row(flight.name, score(flight, read_estimates(estimates / f"{flight.name}.jsonl"))))
        return
    flight, estimates = map(Path, sys.argv[1:])
    print(json.dumps(asdict(score(flight, read_estimates(estimates))), indent=1))


if __name__ == "__main__":
    main()
