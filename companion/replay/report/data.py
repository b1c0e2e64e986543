"""The numbers of a report, as the page's script takes them."""

import math
from typing import Any

from companion.messages.ground_cells import drawable
from companion.replay.history import History
from companion.replay.procedure_spans import steered
from companion.replay.report.recorder import ReportRecorder
from landing.options import DecisionOptions

PLOTS = (
    ("inclination", "Inclination to gravity, degrees", ("inclination_deg",), "inclination_std_deg"),
    ("slopes", "Slope in the camera frame, degrees", ("slope_x_deg", "slope_y_deg"), None),
    ("height", "Distance to the surface, m", ("height_m",), "height_std_m"),
    ("contact", "Time to contact up to 60 s", ("time_to_contact_s",), None),
    ("flow", "Ventral flow, 1/s", ("ventral_flow_x", "ventral_flow_y"), None),
    ("roughness", "Roughness, relief over distance", ("roughness",), "roughness_std"),
)
"""(name, title, fields, field of the standard deviation)."""
LABELS = {
    "slope_x_deg": "to the right of the image",
    "slope_y_deg": "down the image",
    "ventral_flow_x": "to the right of the image",
    "ventral_flow_y": "down the image",
}
LONGEST_CONTACT_S = 60.0
MOST_MAPS = 60
"""Ground maps in one page, spread evenly over the flight."""


def report_data(history: History, limits: DecisionOptions, recorder: ReportRecorder) -> dict[str, Any]:
    """Times in seconds since the first frame; unknown numbers are None."""
    wanted = {"inclination": limits.max_inclination_deg, "roughness": limits.max_roughness}
    return {
        "duration": round(history.duration_s, 3),
        "fps": recorder.fps,
        "times": [round(time, 3) for time in history.times],
        "plots": [
            {
                "name": name,
                "title": title,
                "limit": wanted.get(name),
                "lines": [
                    {"label": LABELS.get(field, ""), "values": _values(history, field)} for field in fields
                ],
                "std": None if std is None else _values(history, std),
            }
            for name, title, fields, std in PLOTS
        ],
        "spans": verdict_spans(history),
        "requests": [round(at, 3) for at, event in history.events if event.event == "landing_requested"],
        "path": [[round(value, 3) for value in point] for point in recorder.path],
        "modes": [[round(at, 3), mode, armed] for at, mode, armed in recorder.modes],
        "maps": _maps(recorder),
        "places": _places(history, recorder),
    }


def verdict_spans(history: History) -> list[dict[str, Any]]:
    """Stretches of one verdict. ``steps``: [from when, reasons then], as long as the same kinds of reasons stood;
    ``shares``: [a reason in its first words, how many seconds it stood], the longest first. Several may stand at once.
    """
    spans: list[dict[str, Any]] = []
    moments = [at for at, _ in history.decisions[1:]] + [history.duration_s]
    for (at, decision), until in zip(history.decisions, moments, strict=False):
        start, end = round(at, 3), round(max(at, until), 3)
        if not spans or spans[-1]["verdict"] != decision.verdict:
            spans.append({"start": start, "verdict": decision.verdict, "steps": [], "shares": {}})
        span = spans[-1]
        span["end"] = end
        if not span["steps"] or span["codes"] != decision.reason_codes:
            span["steps"].append([start, list(decision.reasons)])
            span["codes"] = decision.reason_codes
        for code, words in zip(decision.reason_codes, decision.reasons, strict=False):
            share = span["shares"].setdefault(code, [words, 0.0])
            share[1] += end - start
    for span in spans:
        del span["codes"]
        shares = sorted(span["shares"].values(), key=lambda share: -share[1])
        span["shares"] = [[words, round(seconds, 3)] for words, seconds in shares]
    return spans


def _values(history: History, field: str) -> list[float | None]:
    values = history.series(field).tolist()
    if field == "time_to_contact_s":
        values = [v if 0 <= v <= LONGEST_CONTACT_S else math.nan for v in values]
    return [round(v, 5) if math.isfinite(v) else None for v in values]


def _maps(recorder: ReportRecorder) -> list[dict[str, Any]]:
    found = [
        {"time": round(at, 3), **shown}
        for at, message in recorder.grounds
        if (shown := drawable(message)) is not None
    ]
    step = max(1, math.ceil(len(found) / MOST_MAPS))
    return found[::-1][::step][::-1]


def _places(history: History, recorder: ReportRecorder) -> dict[str, Any]:
    """The places that the landing procedure chose, as [time, north, east] in the axes of the path; None: none then."""
    found: list[list[float | None]] = []
    path, k = recorder.path, 0
    for at_s, decision in history.decisions:
        while k + 1 < len(path) and path[k + 1][0] <= at_s:
            k += 1
        doing = steered(decision)
        now: list[float | None] = [None, None]
        if path and doing is not None and doing.spot_north_m is not None and doing.spot_east_m is not None:
            now = [round(path[k][1] + doing.spot_north_m, 2), round(path[k][2] + doing.spot_east_m, 2)]
        if (found[-1][1:] if found else [None, None]) != now:
            found.append([round(at_s, 3), *now])
    radius_m = recorder.radius_m
    return {"radius_m": round(radius_m, 3) if math.isfinite(radius_m) else None, "chosen": found}
