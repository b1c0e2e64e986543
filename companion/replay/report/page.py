"""The report as one HTML file: nothing is fetched from elsewhere, and the words can be read without a script."""

import base64
import importlib.metadata
import json
import platform
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from pathlib import Path
from typing import Any

from companion.errors import LandslopeError
from companion.messages.messages import Health
from companion.replay.history import History
from companion.replay.procedure_spans import procedure_spans, steered
from companion.replay.report.data import PLOTS, report_data, verdict_spans
from companion.replay.report.recorder import ReportRecorder
from companion.replay.summary import fit_line, landing_lines, share_line, stretches
from companion.settings.settings import Settings
from companion.settings.settings_file import entries, value_of
from companion.settings.toml_text import written

HERE = Path(__file__).parent
PACKAGES = ("landslope", "numpy", "opencv-python-headless", "pymavlink", "mavsdk")
VERDICTS = {"fit": "FIT TO LAND", "unfit": "NOT FIT", "unknown": "UNKNOWN"}
SIGNS = {"fit": "✓", "unfit": "✕", "unknown": "?"}
MOST_EVENTS = 2000
ALL_OF_IT = 0.98
"""Share of a stretch from which a reason counts as standing throughout."""

Row = Sequence[str]


def write_report(
    name: str, history: History, settings: Settings, recorder: ReportRecorder, path: Path
) -> None:
    """Write the page. Raises LandslopeError when the file cannot be written."""
    video = recorder.video()
    parts = [
        _head(name, history),
        _below(history, settings),
        _video(video),
        _plots(),
        _map(history, recorder),
        _events(history, recorder),
        _health(history.health),
        _settings(settings),
        _versions(),
        _script(report_data(history, settings.decision, recorder)),
    ]
    css = (HERE / "report.css").read_text(encoding="utf-8")
    page = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<link rel="icon" href="data:,">'
        f"<title>{escape(name)}: landslope flight report</title><style>{css}</style></head>\n"
        f"<body><main>\n{chr(10).join(parts)}\n</main></body></html>\n"
    )
    try:
        path.write_text(page, encoding="utf-8")
    except OSError as error:
        raise LandslopeError(f"{path}: cannot be written: {error.strerror}") from None


def _head(name: str, history: History) -> str:
    asked = any(event.event == "landing_requested" for _, event in history.events)
    word = "fit" if asked else "unknown"
    headline = "A landing was requested" if asked else "No landing was requested"
    lines = [*landing_lines(history), fit_line(history), share_line(history)] if history.estimates else []
    items = "".join(f"<li>{escape(_sentence(line))}</li>" for line in lines)
    if not history.estimates:
        items = "<li>No frame could be used.</li>"
    elif not all(e.calibrated for e in history.estimates):
        items += "<li>The camera is not calibrated: slopes are only roughly right.</li>"
    frames = f"{len(history.estimates)} frames in {history.duration_s:.1f} s"
    return (
        f"<header><h1>{escape(name)}</h1><p>{frames}</p></header>\n"
        f'<section class="card answer is-{word}"><h2>{headline}</h2><ul>{items}</ul></section>'
    )


def _below(history: History, settings: Settings) -> str:
    rows = [
        (f"{s.start_s:.1f} to {s.end_s:.1f} s", s.surface, _degrees(s.low_deg, s.high_deg))
        for s in (stretches(history, settings.decision) if history.estimates else [])
    ]
    verdicts = [
        (
            f"{span['start']:.1f} to {span['end']:.1f} s",
            f"{SIGNS[span['verdict']]} {VERDICTS[span['verdict']]}",
            "; ".join(_shares(span)) or "nothing against it",
        )
        for span in verdict_spans(history)
    ]
    steps = [
        (f"{s.start_s:.1f} to {s.end_s:.1f} s", s.state.replace("_", " "), s.text, _place(s.spot_m))
        for s in procedure_spans(history)
    ]
    head = ("time", "state", "why", "place, from the vehicle")
    return (
        '<section class="card"><h2>What was below</h2>'
        + _table("Surface along the way", ("time", "surface", "inclination"), rows)
        + _table(
            "Verdict along the way",
            ("time", "verdict", "what stood against a landing, and how long of it"),
            verdicts,
        )
        + (_table("What the landing procedure would have done", head, steps) if steps else "")
        + "</section>"
    )


def _place(spot_m: tuple[float, float] | None) -> str:
    return "" if spot_m is None else f"{spot_m[0]:.1f} m north, {spot_m[1]:.1f} m east"


def _shares(span: dict[str, Any]) -> list[str]:
    """The reasons of a stretch with the time for which each stood; its whole time goes without saying."""
    whole_s = span["end"] - span["start"]
    lines = []
    for words, seconds in span["shares"]:
        share = seconds / whole_s if whole_s > 0 else 1.0
        lines.append(words if share > ALL_OF_IT else f"{words} ({seconds:.1f} s, {share:.0%})")
    return lines


def _video(video: bytes) -> str:
    if not video:
        return '<section class="card"><h2>Video</h2><p>There is no picture.</p></section>'
    source = base64.b64encode(video).decode()
    return (
        '<section class="card"><h2>Video</h2>'
        '<video id="video" controls muted playsinline preload="auto" aria-label="camera with tracks and verdict"'
        f' src="data:video/webm;base64,{source}"></video>'
        '<p class="note">Points on the plane are green, lower ones blue, higher ones red; orange ones fit no '
        "plane. The grid is the measured surface, the circle the disc straight below in the colour of the ground "
        "map's verdict.</p>"
        '<p id="cursor" class="cursor" aria-live="off"></p></section>'
    )


def _plots() -> str:
    buttons = (
        ("in", "zoom in"),
        ("out", "zoom out"),
        ("back", "earlier"),
        ("on", "later"),
        ("all", "whole flight"),
    )
    controls = "".join(f'<button type="button" data-zoom="{name}">{text}</button>' for name, text in buttons)
    canvases = "".join(
        f'<figure><figcaption>{escape(title)}<span class="legend" id="legend-{name}"></span></figcaption>'
        f'<canvas id="plot-{name}" tabindex="0" role="img" aria-label="{escape(title)} over time"></canvas></figure>'
        for name, title, _, _ in PLOTS
    )
    return (
        '<section class="card"><h2>Plots</h2>'
        '<p class="note">The background is the verdict: green fit, red not fit, grey unknown. The wheel zooms, '
        "dragging moves, a click goes to that moment in the video, a double click shows the whole flight; "
        "keys: + - 0 and arrows.</p>"
        f'<div class="controls" role="group" aria-label="zoom">{controls}</div>{canvases}</section>'
    )


def _map(history: History, recorder: ReportRecorder) -> str:
    if not recorder.path and not recorder.grounds:
        words = "The recording has no position of the vehicle."
        return f'<section class="card"><h2>From above</h2><p>{words}</p></section>'
    words = "The path in the colours of the verdict, north up; the ring is where a landing was requested."
    if recorder.grounds:
        words += " Cells: green landable, red hazard, grey unknown."
    if any(steered(decision) is not None for _, decision in history.decisions):
        words += " Violet: the place that the landing procedure has chosen, and the way there."
    return (
        f'<section class="card"><h2>From above</h2><p class="note">{words}</p>'
        '<canvas id="map" role="img" aria-label="the flight from above"></canvas></section>'
    )


def _events(history: History, recorder: ReportRecorder) -> str:
    lines = [(at, e.severity, e.event.replace("_", " "), e.text) for at, e in history.events]
    lines += [
        (at, "info", "autopilot", f"mode {mode}, {'armed' if armed else 'disarmed'}")
        for at, mode, armed in recorder.modes
    ]
    before: tuple[object, ...] = ()
    for at, d in history.decisions:
        now = (d.verdict, d.permitted, d.withheld, d.requested, d.command)
        if now != before:
            words = [f"{VERDICTS.get(d.verdict, d.verdict)}: {'; '.join(d.reasons) or 'nothing against it'}"]
            words.append("a request may go out" if d.permitted else f"withheld: {'; '.join(d.withheld)}")
            if d.command != "none":
                words.append(f"command {d.command}")
            lines.append((at, "info", "decision", ". ".join(words)))
        before = now
    lines.sort(key=lambda line: line[0])
    rows = [(f"{at:.2f} s", severity, name, text) for at, severity, name, text in lines[:MOST_EVENTS]]
    left = "" if len(lines) <= MOST_EVENTS else f"<p>{len(lines) - MOST_EVENTS} more are left out.</p>"
    table = _table("Events and decisions", ("time", "severity", "what", "in words"), rows)
    return f'<section class="card"><h2>Events and reasons</h2>{table}{left}</section>'


def _health(health: Health | None) -> str:
    if health is None:
        return '<section class="card"><h2>Health</h2><p>None was published.</p></section>'
    rows = [
        (
            name.replace("_", " "),
            found.state,
            str(found.count),
            str(found.refused),
            _number(found.rate_hz, "Hz"),
        )
        for name, found in health.inputs.items()
    ]
    counted = [(name, str(count)) for name, count in health.counters.items()]
    problems = "".join(f"<li>{escape(problem)}</li>" for problem in health.problems)
    return (
        f'<section class="card"><h2>Health at the end: {escape(health.state)}</h2><ul>{problems}</ul>'
        + _table("Inputs", ("input", "state", "taken", "refused", "rate at the end"), rows)
        + f"<details><summary>Counters</summary>{_table('Counters', ('what', 'count'), counted)}</details></section>"
    )


def _settings(settings: Settings) -> str:
    rows, changed = [], []
    for entry in entries():
        value = value_of(settings, entry.path)
        row = (entry.path, written(value), written(entry.default), entry.unit)
        rows.append(row)
        if value != entry.default:
            changed.append(row)
    head = ("setting", "in force", "default", "unit")
    return (
        '<section class="card"><h2>Settings in force</h2>'
        + _table("Other than the default", head, changed)
        + f"<details><summary>All {len(rows)} settings</summary>{_table('All settings', head, rows)}</details>"
        + "</section>"
    )


def _versions() -> str:
    rows = [("Python", platform.python_version()), ("machine", f"{platform.system()} {platform.machine()}")]
    rows += list(_installed())
    return f'<section class="card"><h2>Versions</h2>{_table("Versions", ("what", "version"), rows)}</section>'


def _installed() -> Iterator[tuple[str, str]]:
    for package in PACKAGES:
        try:
            yield package, importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            yield package, "not installed"


def _script(data: dict[str, object]) -> str:
    # "<" cannot end the element from within a JSON string when it is written as an escape.
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    code = (HERE / "report.js").read_text(encoding="utf-8")
    return f'<script type="application/json" id="data">{text}</script>\n<script>{code}</script>'


def _table(caption: str, head: Row, rows: Iterable[Row]) -> str:
    cells = "".join(f'<th scope="col">{escape(word)}</th>' for word in head)
    lines = ["<tr>" + "".join(f"<td>{escape(word)}</td>" for word in row) + "</tr>" for row in rows]
    if not lines:
        return f"<h3>{escape(caption)}</h3><p>none</p>"
    return (
        f'<h3>{escape(caption)}</h3><div class="scroll" tabindex="0" role="region" aria-label="{escape(caption)}">'
        f"<table><thead><tr>{cells}</tr></thead><tbody>{''.join(lines)}</tbody></table></div>"
    )


def _sentence(line: str) -> str:
    return line[:1].upper() + line[1:]


def _degrees(low: float, high: float) -> str:
    return f"{low:.0f} to {high:.0f}°" if low == low else "not known"


def _number(value: float | None, unit: str) -> str:
    return "–" if value is None else f"{value:.1f} {unit}"
