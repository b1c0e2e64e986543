"""The plot of ``landslope replay --plot``: verdict, inclination, slopes, time to contact, ventral flow and
roughness over time.

In: the ``History`` of a replay and the limits of the decision. Out: a PNG file.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from companion.errors import LandslopeError
from companion.replay.history import History
from companion.replay.procedure_spans import IDLE, ProcedureSpan, procedure_spans
from landing.options import DecisionOptions

if TYPE_CHECKING:
    from matplotlib.axes import Axes

VERDICT_COLOURS = {"fit": "#2e9e4f", "unfit": "#d1493f", "unknown": "#b8bcc2"}
VERDICT_WORDS = {"fit": "fit for landing", "unfit": "not fit", "unknown": "unknown"}
LETTER_SHARE = 0.0078
"""Width of a letter of the verdict over that of the picture, with a margin."""
TIME_TO_CONTACT_SHOWN_S = 60.0
INCLINATION_SHOWN_DEG = 60.0
BAND_SIGMAS = 2.0


def require_matplotlib() -> None:
    """Raise LandslopeError with the remedy when matplotlib is missing."""
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        raise LandslopeError(
            "--plot needs matplotlib, which is not installed: pip install 'landslope[plot]'"
        ) from None


def plot(name: str, history: History, limits: DecisionOptions, path: Path) -> None:
    """Draw the flight into a PNG file."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 9.5), dpi=110, layout="constrained")
    steps = procedure_spans(history)
    heights = [0.35, *([0.35] if steps else []), 2.4, 1.4, 1.1, 1.1, 1.1]
    axes: list[Any] = list(
        figure.subplots(len(heights), 1, sharex=True, gridspec_kw={"height_ratios": heights})
    )
    times = np.array(history.times)
    if steps:
        _draw_procedure(axes.pop(1), history, steps)
    verdict, inclination, slope, contact, flow, roughness = axes
    _draw_verdict(verdict, history, times)
    _draw_inclination(inclination, history, times, limits)
    _draw_slope(slope, history, times)
    _draw_contact(contact, history, times)
    _draw_flow(flow, history, times)
    _draw_roughness(roughness, history, times, limits)
    for axis in axes[1:]:
        _shade(axis, history, times)
        axis.grid(alpha=0.25)
        axis.spines[["top", "right"]].set_visible(False)
    _mark_requests(axes, history)
    roughness.set_xlabel("time since the first frame (s)")
    if times.size:
        roughness.set_xlim(0, max(history.duration_s, 0.1))
    calibrated = all(e.calibrated for e in history.estimates)
    method = history.estimates[-1].method if history.estimates else ""
    figure.suptitle(
        f"{name}: the surface below (method {method}{'' if calibrated else ', uncalibrated camera'})",
        fontsize=13,
        fontweight="bold",
    )
    figure.savefig(path, format="png", metadata={"Software": None})


def _draw_verdict(axis: "Axes", history: History, times: np.ndarray) -> None:
    for start, end, verdict in _spans(history, times):
        axis.axvspan(start, end, color=VERDICT_COLOURS[verdict], lw=0)
        words = VERDICT_WORDS[verdict]
        if end - start > len(words) * LETTER_SHARE * history.duration_s:
            axis.text(
                (start + end) / 2, 0.5, words, ha="center", va="center", color="white",
                fontsize=10, fontweight="bold",
            )  # fmt: skip
    axis.set_yticks([])
    axis.set_ylim(0, 1)
    axis.set_ylabel("verdict", rotation=0, ha="right", va="center")


def _draw_procedure(axis: "Axes", history: History, steps: list[ProcedureSpan]) -> None:
    """Its states along the time; a place that was chosen is a darker strip."""
    for number, step in enumerate(steps):
        shade = "#d9d9d9" if step.state == IDLE else "#7d9cc0" if number % 2 else "#a9bfd8"
        axis.axvspan(step.start_s, step.end_s, color=shade, lw=0)
        if step.spot_m is not None:
            axis.axvspan(step.start_s, step.end_s, 0.0, 0.18, color="#27476e", lw=0)
        words = step.state.replace("_", " ")
        if step.end_s - step.start_s > len(words) * LETTER_SHARE * history.duration_s:
            middle = (step.start_s + step.end_s) / 2
            axis.text(middle, 0.55, words, ha="center", va="center", fontsize=8)
    axis.set_yticks([])
    axis.set_ylim(0, 1)
    axis.set_ylabel("procedure", rotation=0, ha="right", va="center")


def _draw_inclination(axis: "Axes", history: History, times: np.ndarray, limits: DecisionOptions) -> None:
    value, std = history.series("inclination_deg"), history.series("inclination_std_deg")
    label = "inclination to gravity"
    if np.all(np.isnan(value)):
        value = np.hypot(history.series("slope_x_deg"), history.series("slope_y_deg"))
        label = "slope relative to the camera (no attitude)"
    band = BAND_SIGMAS * np.where(np.isnan(std), 0, std)
    axis.fill_between(
        times, value - band, value + band, color="#1f5fa8", alpha=0.25, lw=0, label=f"±{BAND_SIGMAS:g} sigma"
    )
    axis.plot(times, value, color="#1f5fa8", lw=1.4, label=label)
    limit = limits.max_inclination_deg
    axis.axhline(limit, color="#d1493f", ls="--", lw=1.2, label=f"limit, {limit:g} degrees")
    known = value[np.isfinite(value)]
    top = np.percentile(known, 99.5) * 1.2 if known.size else 0.0
    axis.set_ylim(0, float(np.clip(top, 2 * limit, INCLINATION_SHOWN_DEG)))
    axis.set_ylabel("inclination (deg)")
    axis.legend(loc="upper left", fontsize=8, ncols=3)


def _draw_slope(axis: "Axes", history: History, times: np.ndarray) -> None:
    for name, colour, label in (
        ("slope_x_deg", "#8a4fbf", "to the right of the image"),
        ("slope_y_deg", "#d98a1f", "down the image"),
    ):
        axis.plot(times, history.series(name), color=colour, lw=1.0, label=label)
    both = np.concatenate([history.series("slope_x_deg"), history.series("slope_y_deg")])
    known = np.abs(both[np.isfinite(both)])
    reach = float(
        np.clip(np.percentile(known, 99.5) * 1.2 if known.size else 1.0, 5.0, INCLINATION_SHOWN_DEG)
    )
    axis.set_ylim(-reach, reach)
    axis.set_ylabel("slope in the\ncamera frame (deg)")
    axis.legend(loc="best", fontsize=8, ncols=2)


def _draw_contact(axis: "Axes", history: History, times: np.ndarray) -> None:
    value = history.series("time_to_contact_s")
    approaching = np.where((value > 0) & (value <= TIME_TO_CONTACT_SHOWN_S), value, np.nan)
    axis.plot(times, approaching, color="#17807e", lw=0, marker=".", ms=2.5)
    axis.set_ylim(0, TIME_TO_CONTACT_SHOWN_S)
    axis.set_ylabel("time to\ncontact (s)")
    if np.all(np.isnan(approaching)):
        axis.text(
            0.5, 0.5, "not approaching", transform=axis.transAxes, ha="center", va="center", color="#666"
        )


def _draw_flow(axis: "Axes", history: History, times: np.ndarray) -> None:
    for name, colour, label in (
        ("ventral_flow_x", "#8a4fbf", "to the right of the image"),
        ("ventral_flow_y", "#d98a1f", "down the image"),
    ):
        axis.plot(times, history.series(name), color=colour, lw=1.0, label=label)
    axis.set_ylabel("ventral flow\n(1/s)")
    axis.legend(loc="best", fontsize=8, ncols=2)


def _draw_roughness(axis: "Axes", history: History, times: np.ndarray, limits: DecisionOptions) -> None:
    value = history.series("roughness")
    axis.plot(times, value, color="#5b4a3f", lw=1.0)
    axis.axhline(
        limits.max_roughness, color="#d1493f", ls="--", lw=1.2, label=f"limit, {limits.max_roughness:g}"
    )
    # Linear up to the limit, where noise lives, and logarithmic above it.
    axis.set_yscale("symlog", linthresh=limits.max_roughness, linscale=1.0)
    ticks = [0.0, limits.max_roughness, 0.03, 0.1, 0.3]
    axis.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axis.minorticks_off()
    known = value[np.isfinite(value)]
    axis.set_ylim(0, max(2 * limits.max_roughness, 1.3 * float(known.max()) if known.size else 0.0))
    axis.set_ylabel("roughness\n(relief / distance)")
    axis.legend(loc="upper left", fontsize=8)


def _spans(history: History, times: np.ndarray) -> list[tuple[float, float, str]]:
    spans: list[tuple[float, float, str]] = []
    for at, verdict in enumerate(history.verdicts):
        end = float(times[at + 1]) if at + 1 < times.size else history.duration_s
        if spans and spans[-1][2] == verdict:
            spans[-1] = (spans[-1][0], end, verdict)
        else:
            spans.append((float(times[at]), end, verdict))
    return spans


def _shade(axis: "Axes", history: History, times: np.ndarray) -> None:
    for start, end, verdict in _spans(history, times):
        if verdict != "unknown":
            axis.axvspan(start, end, color=VERDICT_COLOURS[verdict], alpha=0.08, lw=0)


def _mark_requests(axes: "list[Axes]", history: History) -> None:
    for at, event in history.events:
        if event.event != "landing_requested":
            continue
        for axis in axes:
            axis.axvline(at, color="black", lw=1.6)
        late = at > sum(axes[1].get_xlim()) / 2  # the words stand on the side where there is room
        axes[1].annotate(
            f"landing requested, {at:.1f} s", (at, 0.97), xycoords=("data", "axes fraction"),
            xytext=(-6 if late else 6, 0), ha="right" if late else "left",
            textcoords="offset points", va="top", fontsize=10, fontweight="bold",
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.5},
        )  # fmt: skip
