"""The last minute as charts: options for ECharts, which ship with the web framework."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from companion.messages.messages import Estimate
from companion.monitor.state import Point

LONGEST_CONTACT_S = 60.0
LINE, BAND, LIMIT = "#0050c8", "#9cc2ff", "#b3001b"


@dataclass(frozen=True, slots=True)
class Chart:
    """One chart: a value, and where there is one, its standard deviation as a band."""

    name: str
    title: str
    value: Callable[[Estimate], float | None]
    std: Callable[[Estimate], float | None] | None = None
    second: Callable[[Estimate], float | None] | None = None
    floor: float | None = 0.0
    """Where the axis starts; None follows the data."""


CHARTS = (
    Chart("inclination", "inclination, °", lambda e: e.inclination_deg, lambda e: e.inclination_std_deg),
    Chart("contact", "time to contact up to 60 s", lambda e: _soon(e.time_to_contact_s)),
    Chart(
        "flow",
        "ventral flow x, y, 1/s",
        lambda e: e.ventral_flow_x,
        second=lambda e: e.ventral_flow_y,
        floor=None,
    ),
    Chart(
        "roughness",
        "roughness",
        lambda e: e.roughness,
        lambda e: e.roughness_std,
    ),
)


def _soon(time_to_contact_s: float | None) -> float | None:
    """Far contacts would flatten the curve where it matters; they show as a gap."""
    near = time_to_contact_s is not None and 0 <= time_to_contact_s <= LONGEST_CONTACT_S
    return time_to_contact_s if near else None


def frame_of(chart: Chart, span_s: float) -> dict[str, Any]:
    """The chart without data."""
    line = {"type": "line", "showSymbol": False, "animation": False, "data": []}
    bare = {**line, "lineStyle": {"opacity": 0}, "stack": "band", "silent": True}
    return {
        "animation": False,
        "title": {"text": chart.title, "left": 0, "top": 0, "textStyle": {"fontSize": 16, "color": "#000"}},
        "grid": {"left": 48, "right": 10, "top": 30, "bottom": 26},
        "xAxis": {
            "type": "value",
            "min": -span_s,
            "max": 0,
            "axisLine": {"onZero": False},
            "axisLabel": {"fontSize": 14, "color": "#000", "formatter": "{value} s"},
        },
        "yAxis": {
            "type": "value",
            "scale": chart.floor is None,
            "min": chart.floor,
            "axisLabel": {"fontSize": 14, "color": "#000"},
        },
        "series": [
            bare,
            {**bare, "areaStyle": {"color": BAND, "opacity": 0.7}},
            {**line, "lineStyle": {"color": LINE, "width": 2.5}},
            {**line, "lineStyle": {"color": LIMIT, "width": 2.5}},
        ],
    }


def series_of(chart: Chart, points: Sequence[Point], now_s: float, span_s: float) -> list[list[Any]]:
    """The four series' data: band's foot, band's height, value, second value; gaps where unknown."""
    low: list[Any] = []
    height: list[Any] = []
    value: list[Any] = []
    second: list[Any] = []
    for point in points:
        age = round(point.time_s - now_s, 2)
        if age < -span_s:
            continue
        v = chart.value(point.estimate)
        value.append([age, v])
        if chart.second is not None:
            second.append([age, chart.second(point.estimate)])
        if chart.std is not None:
            s = chart.std(point.estimate)
            if v is None or s is None:
                low.append([age, None])
                height.append([age, None])
            else:
                low.append([age, round(v - s, 5)])
                height.append([age, round(2 * s, 5)])
    return [low, height, value, second]
