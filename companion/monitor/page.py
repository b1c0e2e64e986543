"""The page: built once for each browser, refreshed a few times a second, whatever the vehicles' rates."""

import base64
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nicegui import ui

from companion.messages.messages import Event, Health
from companion.monitor import words
from companion.monitor.charts import CHARTS, frame_of, series_of
from companion.monitor.feed import Feed
from companion.monitor.scene import scene_svg
from companion.monitor.state import Vehicle, Watch
from companion.monitor.tracks import counts, tracks_svg

CSS = (Path(__file__).parent / "style.css").read_text()
CHART_PERIOD_S = 1.0
MOST_CHIPS = 60
MOST_INPUTS = 40
MOST_WORDS = 12
MOST_EVENTS = 7
FIGURES = (
    ("time_to_contact_s", "time to contact"),
    ("ventral_flow", "ventral flow x, y, 1/s"),
    ("roughness", "roughness"),
    ("downhill_bearing_deg", "falls towards"),
)


@dataclass(frozen=True, slots=True)
class View:
    """What one refresh shows, copied under the lock so that it belongs together."""

    names: list[tuple[str, str, bool]]
    vehicle: Vehicle | None
    silent: list[tuple[str, float]]
    events: list[Event]


def view_of(watch: Watch, chosen: str | None, now_s: float) -> View:
    """The vehicles by name, the chosen one (the first while it is unknown), and who is silent how long."""
    watch.tick(now_s)
    with watch.lock:
        vehicles = sorted(watch.vehicles.values(), key=lambda v: v.name)
        names = [(v.name, words.look(v.decision, v.health), watch.is_silent(v, now_s)) for v in vehicles]
        silent = [(v.name, now_s - v.silent_since_s) for v in vehicles if v.silent_since_s is not None]
        vehicle = watch.vehicles.get(chosen) if chosen else None
        if vehicle is None and chosen is None and vehicles:
            vehicle = next((v for v in vehicles if not watch.is_silent(v, now_s)), vehicles[0])
        return View(names, vehicle, silent, list(vehicle.events) if vehicle else [])


class Page:
    """One browser's page."""

    def __init__(self, watch: Watch, feed: Feed, chosen: str | None) -> None:
        self._watch = watch
        self._feed = feed
        self._chosen = chosen
        self._shown_picture: bytes = b""
        self._charts_due_s = 0.0
        self._chips: list[tuple[str, str, bool, bool]] = []
        self._inputs: list[Any] = []
        ui.add_css(CSS)
        self._dismissed: dict[str, float] = {}
        self._silent: list[tuple[str, float]] = []
        with ui.element("div").classes("alarm") as self._alarm_bar:
            self._alarm = ui.label().props("id=alarm role=alert")
            self._dismiss = ui.element("button").classes("dismiss").props("id=dismiss")
            self._dismiss.on("click", self._dismiss_silent)
            with self._dismiss:
                ui.label("hide until heard again")
        with ui.element("main").classes("page") as self._main:
            self._build()
        self.refresh()
        ui.timer(1 / watch.options.refresh_hz, self.refresh)

    def refresh(self) -> None:
        """Bring the page up to date."""
        now_s = time.monotonic()
        view = view_of(self._watch, self._chosen, now_s)
        self._show_alarm(view)
        self._show_chips(view)
        vehicle = view.vehicle
        if vehicle is None:
            return
        silent = any(name == vehicle.name for name, _ in view.silent)
        self._main.classes(add="is-silent" if silent else "", remove="" if silent else "is-silent")
        self._show_now(vehicle, silent)
        self._show_permission(vehicle)
        self._show_health(vehicle, now_s)
        self._show_events(view.events)
        self._show_preview(vehicle)
        if now_s >= self._charts_due_s:
            self._charts_due_s = now_s + CHART_PERIOD_S
            self._show_charts(vehicle, now_s)

    def _build(self) -> None:
        self._chip_row = ui.element("nav").classes("chips wide").props("aria-label=vehicles")
        with ui.element("section").classes("card"):
            self._verdict = _label("verdict", "verdict")
            self._against = _label("words", "against")
            ui.label("inclination").classes("label")
            self._inclination = _label("big", "inclination_deg")
            self._slopes = _label("small", "slopes")
            with ui.element("div").classes("figures"):
                self._figures = {}
                for name, title in FIGURES:
                    with ui.element("div"):
                        ui.label(title).classes("label")
                        self._figures[name] = _label("figure", name)
            self._frame = _label("small", "frame")
        with _card("surface under the vehicle"):
            self._scene = ui.html("", sanitize=False).classes("w-full").props("id=scene")
            ui.label("The blue nose points away from you; dashed is level.").classes("small")
        with _card("camera"):
            self._preview = (
                ui.interactive_image("", sanitize=False, size=(320, 240))
                .classes("preview")
                .props("id=preview")
            )
            self._preview_words = _label("small", "preview")
        with _card("permission and command"):
            ui.label("permission to land").classes("label")
            self._permission = _label("words", "permission")
            ui.label("command to land").classes("label")
            self._command = _label("words", "command")
        with _card("health"):
            self._health = _label("figure", "health")
            self._problems = _label("words", "problems")
            self._input_grid = ui.element("div").classes("inputs").props("id=inputs")
            self._clock = _label("small", "clock")
            self._traffic = _label("small", "traffic")
            self._counters = _label("small", "counters")
        with _card("events"):
            self._events = _label("words small", "events")
        self._charts = {}
        with ui.element("div").classes("charts wide"):
            for chart in CHARTS:
                with ui.element("section").classes("card"):
                    options = frame_of(chart, self._watch.options.history_s)
                    element = ui.echart(options).classes("chart").props(f"id=chart-{chart.name}")
                    self._charts[chart.name] = element

    def _show_alarm(self, view: View) -> None:
        lines = []
        if self._feed.links() == 0:
            lines.append("NO CONNECTION: no router and no vehicle is reachable")
        since = dict(view.silent)
        self._dismissed = {name: s for name, s in self._dismissed.items() if since.get(name, -1.0) >= s}
        self._silent = [(name, s) for name, s in view.silent if name not in self._dismissed]
        lines += [f"{name} IS SILENT for {words.duration(s)}" for name, s in self._silent[:MOST_WORDS]]
        if view.vehicle is None and not lines:
            lines.append(f"{self._chosen or 'no vehicle'} is not heard yet")
        self._alarm.set_text(" · ".join(lines))
        self._alarm_bar.set_visibility(bool(lines))
        self._dismiss.set_visibility(bool(self._silent))

    def _dismiss_silent(self) -> None:
        """On this page only, and only for this silence: one that begins anew is shown again."""
        self._dismissed |= dict(self._silent)
        self.refresh()

    def _show_chips(self, view: View) -> None:
        shown = view.vehicle.name if view.vehicle else None
        chips = [(name, verdict, silent, name == shown) for name, verdict, silent in view.names[:MOST_CHIPS]]
        if chips == self._chips:
            return
        self._chips = chips
        self._chip_row.clear()
        with self._chip_row:
            for name, verdict, silent, chosen in chips:
                look = f"chip is-{verdict if verdict in words.VERDICTS else 'unknown'}"
                look += (" is-silent" if silent else "") + (" is-chosen" if chosen else "")
                button = ui.element("button").classes(look).props("data-field=chip")
                button.on("click", lambda name=name: self._choose(name))
                with button:
                    ui.label(name)

    def _choose(self, name: str) -> None:
        self._chosen = name
        self._charts_due_s = 0.0
        self.refresh()

    def _show_now(self, vehicle: Vehicle, silent: bool) -> None:
        estimate, decision, health = vehicle.estimate, vehicle.decision, vehicle.health
        verdict = "unknown" if silent else words.look(decision, health)
        self._verdict.set_text(words.SILENT if silent else words.verdict(decision, health))
        self._verdict.classes(replace=f"verdict is-{verdict}")
        self._against.set_text(
            words.SAID_LAST if silent else _lines(words.against(decision, estimate, health))
        )
        figures = words.figures(estimate)
        self._inclination.set_text(figures["inclination_deg"])
        self._slopes.set_text(figures["slopes"])
        for name, label in self._figures.items():
            label.set_text(figures[name])
        if estimate is not None:
            self._frame.set_text(
                f"frame {estimate.frame}: {words.clipped(estimate.status)}, {estimate.features} tracks,"
                f" {vehicle.rate_hz:.1f} estimates/s"
            )
        self._scene.set_content(scene_svg(estimate, verdict))

    def _show_permission(self, vehicle: Vehicle) -> None:
        self._permission.set_text(words.clipped(words.permission(vehicle.decision)))
        self._command.set_text(words.clipped(words.command(vehicle.decision)))

    def _show_health(self, vehicle: Vehicle, now_s: float) -> None:
        health = vehicle.health
        self._health.set_text(words.DASH if health is None else words.clipped(health.state))
        self._health.classes(replace="figure" if health is None or health.state == "ok" else "figure bad")
        self._problems.set_text("" if health is None else _lines(health.problems))
        self._clock.set_text(words.clock(health))
        heard = words.DASH if vehicle.heard_s is None else f"{max(0.0, now_s - vehicle.heard_s):.1f} s ago"
        self._traffic.set_text(
            f"last heard {heard}; received {vehicle.received.total()}, frames missed {vehicle.missed},"
            f" not understood {vehicle.refused}, dropped here {self._feed.dropped}"
        )
        if health is not None:
            self._counters.set_text(
                ", ".join(f"{k} {v}" for k, v in list(health.counters.items())[:MOST_INPUTS])
            )
            self._show_inputs(health)

    def _show_inputs(self, health: Health) -> None:
        cells: list[tuple[str, bool]] = []
        for name, found in list(health.inputs.items())[:MOST_INPUTS]:
            state, rate, age, count = words.input_line(found)
            cells += [(f"{name}: {state}", found.state != "ok"), (rate, False), (age, False), (count, False)]
        if len(cells) != len(self._inputs):
            self._input_grid.clear()
            with self._input_grid:
                self._inputs = [ui.label() for _ in cells]
        for label, (text, bad) in zip(self._inputs, cells, strict=True):
            label.set_text(words.clipped(text))
            label.classes(add="bad" if bad else "", remove="" if bad else "bad")

    def _show_events(self, events: list[Event]) -> None:
        lines = [
            f"{time.strftime('%H:%M:%S', time.localtime(e.time_unix_us / 1e6))} {e.text}" for e in events
        ]
        self._events.set_text("\n".join(reversed(lines[-MOST_EVENTS:])) or "none yet")

    def _show_preview(self, vehicle: Vehicle) -> None:
        preview = vehicle.preview
        if preview is None or vehicle.picture is self._shown_picture:
            return
        self._shown_picture = vehicle.picture
        self._preview.set_source("data:image/jpeg;base64," + base64.b64encode(vehicle.picture).decode())
        self._preview.set_content(
            f'<svg width="100%" height="100%" viewBox="0 0 {preview.width} {preview.height}"'
            f' preserveAspectRatio="none">{tracks_svg(preview)}</svg>'
        )
        self._preview_words.set_text(counts(preview))

    def _show_charts(self, vehicle: Vehicle, now_s: float) -> None:
        with self._watch.lock:
            points = list(vehicle.points)
        for chart in CHARTS:
            element = self._charts[chart.name]
            data = series_of(chart, points, now_s, self._watch.options.history_s)
            for series, values in zip(element.options["series"], data, strict=True):
                series["data"] = values
            element.update()


def _lines(texts: Sequence[str]) -> str:
    return "\n".join(words.clipped(text) for text in texts[:MOST_WORDS])


def _label(look: str, field: str) -> ui.label:
    return ui.label().classes(look).props(f"data-field={field}")


def _card(title: str) -> ui.element:
    section = ui.element("section").classes("card")
    with section:
        ui.label(title).classes("card-title")
    return section
