"""The state of a vehicle's inputs, clocks and counters."""

from typing import Any

from nicegui import ui

from companion.messages.messages import Health
from companion.monitor import words
from companion.monitor.elements import label, lines_of
from companion.monitor.state import Vehicle

MOST_INPUTS = 40


class HealthCard:
    """Built where it is made."""

    def __init__(self) -> None:
        self._inputs: list[Any] = []
        self._health = label("figure", "health")
        self._problems = label("words", "problems")
        self._input_grid = ui.element("div").classes("inputs").props("id=inputs")
        self._clock = label("small", "clock")
        self._traffic = label("small", "traffic")
        self._counters = label("small", "counters")

    def show(self, vehicle: Vehicle, now_s: float, dropped: int) -> None:
        """Bring the card up to date; ``dropped``: deliveries lost here."""
        health = vehicle.health
        self._health.set_text(words.DASH if health is None else words.clipped(health.state))
        self._health.classes(replace="figure" if health is None or health.state == "ok" else "figure bad")
        self._problems.set_text("" if health is None else lines_of(health.problems))
        self._clock.set_text(words.clock(health))
        heard = (
            words.DASH
            if vehicle.heard_s is None
            else words.duration(max(0.0, now_s - vehicle.heard_s)) + " ago"
        )
        self._traffic.set_text(
            f"last heard {heard}; received {vehicle.received.total()}, frames missed {vehicle.missed},"
            f" not understood {vehicle.refused}, dropped here {dropped}"
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
        for cell, (text, bad) in zip(self._inputs, cells, strict=True):
            cell.set_text(words.clipped(text))
            cell.classes(add="bad" if bad else "", remove="" if bad else "bad")
