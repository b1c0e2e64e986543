"""The page: built once for each browser, refreshed a few times a second, whatever the vehicles' rates."""

import base64
import time
from html import escape
from pathlib import Path
from typing import Any

from nicegui import ui

from companion.messages.messages import Estimate, Event
from companion.monitor import words
from companion.monitor.charts import CHARTS, chart_svg
from companion.monitor.elements import MOST_WORDS, card, heading, label, lines_of
from companion.monitor.feed import Feed
from companion.monitor.fleet import View, card_html, view_of
from companion.monitor.ground_mesh import mesh_of, pose_of
from companion.monitor.ground_view import ground_svg
from companion.monitor.health_card import HealthCard
from companion.monitor.help import EMPTY
from companion.monitor.scene import scene_svg
from companion.monitor.state import Vehicle, Watch
from companion.monitor.timeline import at, in_words, timeline_svg
from companion.monitor.tracks import counts, tracks_svg

HERE = Path(__file__).parent
CSS = (HERE / "style.css").read_text()
SCRIPTS = "".join(f"<script>{(HERE / name).read_text()}</script>" for name in ("theme.js", "ground3d.js"))
LOOK_S = 0.02
"""How often a page looks for a new estimate."""
CHART_PERIOD_S = 1.0
FLEET_PERIOD_S = 0.5
MOST_CARDS = 60
MOST_EVENTS = 7
GROUND_LEGEND = (
    "Green landable, orange measured, red disputed, grey unknown; dashed: where it would come down."
)
MESH_WORDS = "the ground map in 3D, the vehicle above it; arrow keys turn it"
MESH_LEGEND = (
    "Orange is higher, blue lower than the ground around, full colour at 0.3 m. Drag or arrow keys turn it."
)
FIGURES = (
    ("height_m", "height over the surface"),
    ("time_to_contact_s", "time to contact"),
    ("armed", "motors"),
    ("mode", "flight mode"),
    ("attitude", "attitude"),
    ("downhill_bearing_deg", "falls towards"),
    ("ventral_flow", "ventral flow x, y, 1/s"),
    ("roughness", "roughness"),
)


class Page:
    """One browser's page."""

    def __init__(self, watch: Watch, feed: Feed, chosen: str | None) -> None:
        self._watch = watch
        self._feed = feed
        self._chosen = chosen
        self._shown_name, self._refreshed_s = "", 0.0
        self._shown_estimate: Estimate | None = None
        self._shown_picture: bytes = b""
        self._shown_ground: dict[str, Any] | None = None
        self._shown_map: dict[str, Any] | None = None
        self._charts_due_s = self._fleet_due_s = 0.0
        self._back_s = 0.0
        self._buttons: list[tuple[Any, Any]] = []
        self._order: list[str] = []
        self._dismissed: dict[str, float] = {}
        self._silent: list[tuple[str, float]] = []
        ui.add_css(CSS)
        ui.add_body_html(SCRIPTS)
        self._build()
        self.refresh()
        ui.timer(LOOK_S, self._look)

    def _look(self) -> None:
        """Show a new estimate at once, but not more often than the page is refreshed; ages go on without one."""
        period_s, since_s = 1 / self._watch.options.refresh_hz, time.monotonic() - self._refreshed_s
        vehicle = self._watch.vehicles.get(self._shown_name)
        new = vehicle is not None and vehicle.estimate is not self._shown_estimate
        if since_s >= 2 * period_s or (new and since_s >= period_s - LOOK_S):
            self.refresh()

    def refresh(self) -> None:
        """Bring the page up to date."""
        now_s = self._refreshed_s = time.monotonic()
        view = view_of(self._watch, self._chosen, now_s)
        self._show_alarm(view)
        if now_s >= self._fleet_due_s:
            self._fleet_due_s = now_s + FLEET_PERIOD_S
            self._show_fleet(view)
        vehicle = view.vehicle
        self._shown_name, self._shown_estimate = (
            ("", None) if vehicle is None else (vehicle.name, vehicle.estimate)
        )
        self._help.set_visibility(vehicle is None)
        for part in self._parts:
            part.set_visibility(vehicle is not None)
        if vehicle is None:
            return
        silent = any(name == vehicle.name for name, _ in view.silent)
        self._main.classes(add="is-silent" if silent else "", remove="" if silent else "is-silent")
        self._show_now(vehicle, silent)
        self._health.show(vehicle, now_s, self._feed.dropped)
        self._show_events(view.events)
        self._show_preview(vehicle)
        if now_s >= self._charts_due_s:
            self._charts_due_s = now_s + CHART_PERIOD_S
            self._show_charts(vehicle, now_s)

    def _build(self) -> None:
        with ui.element("header").classes("bar"):
            ui.html("landslope monitor", tag="h1", sanitize=False)
            theme = (
                ui.element("button")
                .classes("plain")
                .props("id=theme type=button aria-label='change the theme'")
            )
            theme.on("click", js_handler="() => window.landslopeTheme()")
        with ui.element("div").classes("top").props("role=region aria-label=verdict"):
            with ui.element("div").classes("alarm").props("tabindex=0") as self._alarm_bar:
                self._alarm = ui.label().props("id=alarm role=alert")
                self._dismiss = ui.element("button").classes("dismiss").props("id=dismiss type=button")
                self._dismiss.on("click", self._dismiss_silent)
                with self._dismiss:
                    ui.label("hide until heard again")
            with ui.element("div").classes("verdict-bar is-unknown") as self._verdict_bar:
                self._sign = ui.label().classes("sign").props("aria-hidden=true")
                self._verdict = label("verdict", "verdict").props(
                    "role=status aria-live=assertive aria-atomic=true"
                )
                self._name = label("verdict-name", "name")
            self._status = ui.html("", sanitize=False).classes("status").props("data-field=status")
        with ui.element("div").classes("page") as self._main:
            self._fleet = ui.element("section").classes("fleet wide").props("aria-label=fleet")
            self._help = (
                ui.html(EMPTY, tag="section", sanitize=False).classes("card help wide").props("id=help")
            )
            self._build_vehicle()
        self._parts = [self._verdict_bar, self._status, *self._cards]

    def _build_vehicle(self) -> None:
        with card("Surface below") as now:
            self._against = label("words", "against")
            ui.label("inclination").classes("label")
            self._inclination = label("big", "inclination_deg")
            self._slopes = label("small", "slopes")
            with ui.element("div").classes("figures"):
                self._figures = {}
                for name, title in FIGURES:
                    with ui.element("div"):
                        ui.label(title).classes("label")
                        self._figures[name] = label("figure", name)
            self._frame = label("small", "frame")
        with card("Surface under the vehicle") as scene:
            self._scene = ui.html("", sanitize=False).classes("w-full").props("id=scene")
            ui.label("The blue nose points away from you; dashed is level.").classes("small")
        with card("Camera") as camera:
            with ui.element("div").classes("preview").props("id=preview"):
                self._picture = ui.element("img").props('alt="no picture yet" src="data:,"')
                self._overlay = ui.html("", sanitize=False).classes("overlay")
            self._preview_words = label("small", "preview")
        with card("Ground from above") as self._ground_card:
            self._ground = ui.html("", sanitize=False).props("id=ground")
            ui.label(GROUND_LEGEND).classes("small")
        with card("Ground in 3D") as self._mesh_card:
            self._mesh = ui.element("canvas").props(
                f'id=ground3d tabindex=0 role=img aria-label="{MESH_WORDS}"'
            )
            ui.label(MESH_LEGEND).classes("small")
        with card("Permission and command") as permission:
            ui.label("permission to land").classes("label")
            self._permission = label("words", "permission")
            ui.label("command to land").classes("label")
            self._command = label("words", "command")
            ui.label("landing procedure").classes("label")
            self._procedure = label("words", "procedure")
        with card("Health") as health:
            self._health = HealthCard()
        with card("Events") as events:
            self._events = label("words small", "events")
        with card("The last ten minutes") as timeline:
            timeline.classes("wide")
            self._timeline = ui.html("", sanitize=False).props("id=timeline")
            span_s = self._watch.options.history_s
            self._slider = ui.element("input").classes("look-back")
            self._slider.props(
                f'type=range min={-span_s:.0f} max=0 step=5 value=0 aria-label="look back, seconds"'
            )
            self._slider.on("input", self._look_back, js_handler="(e) => emit(Number(e.target.value))")
            with ui.element("div").classes("row"):
                self._back = label("small", "back")
                live = ui.element("button").classes("plain").props("id=live type=button")
                live.on("click", self._look_at_now)
                with live:
                    ui.label("back to now")
        self._charts = {}
        with ui.element("section").classes("charts wide").props('aria-label="charts"') as charts:
            for chart in CHARTS:
                with ui.element("div").classes("card"):
                    heading(chart.title)
                    self._charts[chart.name] = ui.html("", sanitize=False).props(f"id=chart-{chart.name}")
        self._cards = [now, scene, camera, permission, health, events, timeline, charts]
        self._ground_card.set_visibility(False)
        self._mesh_card.set_visibility(False)

    def _show_alarm(self, view: View) -> None:
        lines = []
        if self._feed.links() == 0:
            lines.append("NO CONNECTION: no router and no vehicle is reachable")
        since = dict(view.silent)
        self._dismissed = {name: s for name, s in self._dismissed.items() if since.get(name, -1.0) >= s}
        self._silent = [(name, s) for name, s in view.silent if name not in self._dismissed]
        lines += [f"{name} IS SILENT for {words.duration(s)}" for name, s in self._silent[:MOST_WORDS]]
        if view.vehicle is None and not lines:
            lines.append(f"{self._chosen} is not heard yet" if self._chosen else "no vehicle is heard yet")
        self._alarm.set_text(" · ".join(lines))
        self._alarm_bar.set_visibility(bool(lines))
        self._dismiss.set_visibility(bool(self._silent))

    def _dismiss_silent(self) -> None:
        """On this page only, and only for this silence: one that begins anew is shown again."""
        self._dismissed |= dict(self._silent)
        self.refresh()

    def _show_fleet(self, view: View) -> None:
        """Cards in the order of attention; one vehicle alone needs no fleet view."""
        cards = view.cards[:MOST_CARDS] if len(view.cards) > 1 else []
        self._fleet.set_visibility(bool(cards))
        if len(cards) != len(self._buttons):
            self._fleet.clear()
            with self._fleet:
                if cards:
                    heading("Fleet, first who needs attention")
                self._buttons = [self._button(place) for place in range(len(cards))]
        self._order = [one.name for one in cards]
        shown = view.vehicle.name if view.vehicle else None
        for (button, inside), shown_card in zip(self._buttons, cards, strict=True):
            inside.set_content(card_html(shown_card))
            chosen = shown_card.name == shown
            button.classes(add="is-chosen" if chosen else "", remove="" if chosen else "is-chosen")
            button.props(f"aria-pressed={'true' if chosen else 'false'}")

    def _button(self, place: int) -> tuple[Any, Any]:
        button = ui.element("button").props("data-field=chip type=button").classes("fleet-button")
        button.on("click", lambda: self._choose(self._order[place]))
        with button:
            return button, ui.html("", tag="span", sanitize=False).classes("fleet-card")

    def _choose(self, name: str) -> None:
        self._chosen = name
        self._charts_due_s = self._fleet_due_s = 0.0
        self.refresh()

    def _show_now(self, vehicle: Vehicle, silent: bool) -> None:
        estimate, decision, health = vehicle.estimate, vehicle.decision, vehicle.health
        look = "unknown" if silent else words.look(decision, health, estimate)
        self._sign.set_text(words.SIGNS["silent" if silent else look])
        self._verdict.set_text(words.SILENT if silent else words.verdict(decision, health, estimate))
        self._verdict_bar.classes(replace=f"verdict-bar is-{look}")
        self._name.set_text(words.clipped(vehicle.name))
        lines = words.against(decision, estimate, health)
        self._against.set_text(words.SAID_LAST if silent else lines_of(lines) or "nothing against it")
        self._status.set_content(
            "".join(
                f"<span{' class=bad' if bad else ''}>{escape(words.clipped(text))}</span>"
                for text, bad in words.status(estimate, health)
            )
        )
        figures = words.figures(estimate)
        figures["armed"], figures["mode"] = words.flying(health)
        self._inclination.set_text(figures["inclination_deg"])
        self._slopes.set_text(figures["slopes"])
        for name, figure in self._figures.items():
            figure.set_text(words.clipped(figures[name]))
        if estimate is not None:
            status = words.clipped(estimate.status).replace("_", " ")
            self._frame.set_text(
                f"frame {estimate.frame}: {status}, {estimate.features} tracks,"
                f" {vehicle.rate_hz:.1f} estimates/s"
            )
        self._scene.set_content(scene_svg(estimate, look))
        drawn = ground_svg(vehicle.ground, vehicle.ground_map, words.steered(decision), vehicle.path)
        self._ground_card.set_visibility(bool(drawn))
        self._ground.set_content(drawn)
        self._show_mesh(vehicle)
        self._permission.set_text(words.clipped(words.permission(decision)))
        self._command.set_text(words.clipped(words.command(decision)))
        self._procedure.set_text(words.clipped(words.procedure(decision)))

    def _show_mesh(self, vehicle: Vehicle) -> None:
        """The mesh is sent when there is a new map, the vehicle's place with every ground message."""
        if vehicle.ground is self._shown_ground:
            return
        self._shown_ground = vehicle.ground
        given = {"data-pose": pose_of(vehicle.ground)}
        if vehicle.ground_map is not self._shown_map:
            self._shown_map = vehicle.ground_map
            given["data-map"] = mesh_of(vehicle.ground, vehicle.ground_map)
        self._mesh.props.update(given)
        self._mesh.update()
        self._mesh_card.set_visibility(bool(given["data-pose"] and self._mesh.props.get("data-map")))

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
        source = "data:image/jpeg;base64," + base64.b64encode(vehicle.picture).decode()
        self._picture.props(f'src="{source}" alt="camera of the vehicle"')
        self._overlay.set_content(
            f'<svg width="100%" height="100%" viewBox="0 0 {preview.width} {preview.height}"'
            f' preserveAspectRatio="none" aria-hidden="true">{tracks_svg(preview)}</svg>'
        )
        self._preview_words.set_text(counts(preview))

    def _look_back(self, event: Any) -> None:
        given = event.args
        back_s = -float(given) if isinstance(given, int | float) else 0.0
        self._back_s = min(max(back_s, 0.0), self._watch.options.history_s)
        self._charts_due_s = 0.0

    def _look_at_now(self) -> None:
        self._back_s = self._charts_due_s = 0.0
        ui.run_javascript("document.querySelector('.look-back').value = 0")

    def _show_charts(self, vehicle: Vehicle, now_s: float) -> None:
        options = self._watch.options
        with self._watch.lock:
            points, limits = list(vehicle.points), vehicle.limits
        end_s, span_s = now_s - self._back_s, options.chart_s
        self._timeline.set_content(
            timeline_svg(points, now_s, options.history_s, (self._back_s + span_s, self._back_s))
        )
        words_back = "now" if not self._back_s else in_words(at(points, end_s), self._back_s)
        self._back.set_text(words_back)
        for chart in CHARTS:
            content = chart_svg(chart, points, end_s, span_s, limits.get(chart.limit), self._back_s)
            self._charts[chart.name].set_content(content)
