"""The newest minute, or an earlier one, as charts in SVG: value, standard deviation, limit, the verdict behind them."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from companion.monitor.state import Point

LONGEST_CONTACT_S = 60.0
WIDTH, HEIGHT = 360, 150
LEFT, RIGHT, TOP, BOTTOM = 44, 6, 6, 24
MOST_TICKS = 4
LIMIT_ROOM = 1.4
"""The axis reaches so far beyond a limit, so that it can be seen how far away it is."""
GAP_S = 2.0
"""Points further apart than this are not joined."""


@dataclass(frozen=True, slots=True)
class Chart:
    """One chart: a value, its standard deviation or a second value, and the setting that limits it."""

    name: str
    title: str
    value: Callable[[Point], float | None]
    std: Callable[[Point], float | None] | None = None
    second: Callable[[Point], float | None] | None = None
    limit: str = ""
    floor: float | None = 0.0
    """Where the axis starts; None follows the data."""
    names: tuple[str, str] = ("", "")
    """What the two lines are, where there are two."""


CHARTS = (
    Chart(
        "inclination",
        "Inclination, °",
        lambda p: p.inclination_deg,
        lambda p: p.inclination_std_deg,
        limit="max_inclination_deg",
    ),
    Chart("height", "Height over the surface, m", lambda p: p.height_m, lambda p: p.height_std_m),
    Chart("contact", "Time to contact up to 60 s", lambda p: _soon(p.time_to_contact_s)),
    Chart(
        "flow",
        "Ventral flow, 1/s",
        lambda p: p.ventral_flow_x,
        second=lambda p: p.ventral_flow_y,
        floor=None,
        names=("to the right", "down the image"),
    ),
    Chart(
        "roughness",
        "Roughness, relief over distance",
        lambda p: p.roughness,
        lambda p: p.roughness_std,
        limit="max_roughness",
    ),
)


def _soon(time_to_contact_s: float | None) -> float | None:
    """Far contacts would flatten the curve where it matters; they show as a gap."""
    near = time_to_contact_s is not None and 0 <= time_to_contact_s <= LONGEST_CONTACT_S
    return time_to_contact_s if near else None


def chart_svg(
    chart: Chart,
    points: Sequence[Point],
    end_s: float,
    span_s: float,
    limit: float | None,
    back_s: float = 0.0,
) -> str:
    """The chart of ``span_s`` seconds up to ``end_s``, which is ``back_s`` ago; only finite numbers go into the SVG."""
    shown = [p for p in points if end_s - span_s <= p.time_s <= end_s]
    low, high = _range(chart, shown, limit)

    def x(time_s: float) -> float:
        return LEFT + (time_s - end_s + span_s) / span_s * (WIDTH - LEFT - RIGHT)

    def y(value: float) -> float:
        return TOP + (high - min(max(value, low), high)) / (high - low) * (HEIGHT - TOP - BOTTOM)

    parts = [
        f'<rect class="v-{verdict}" x="{x(start):.1f}" y="{TOP}" width="{max(0.0, x(end) - x(start)):.1f}"'
        f' height="{HEIGHT - TOP - BOTTOM}"/>'
        for start, end, verdict in verdict_spans(shown)
    ]
    for tick, text in ticks(low, high):
        parts.append(f'<path class="grid" d="M{LEFT} {y(tick):.1f}H{WIDTH - RIGHT}"/>')
        parts.append(f'<text x="{LEFT - 5}" y="{y(tick) + 5:.1f}" text-anchor="end">{text}</text>')
    for back in (0.0, span_s / 2, span_s):
        anchor = "end" if back == 0 else "start" if back == span_s else "middle"
        text = "now" if back + back_s == 0 else f"-{back + back_s:.0f} s"
        parts.append(f'<text x="{x(end_s - back):.1f}" y="{HEIGHT - 6}" text-anchor="{anchor}">{text}</text>')
    if chart.std is not None:
        parts.append(_band(chart, shown, x, y))
    if chart.second is not None:
        parts.append(f'<path class="second" d="{_line(shown, chart.second, x, y)}"/>')
    parts.append(f'<path class="value" d="{_line(shown, chart.value, x, y)}"/>')
    if limit is not None:
        parts.append(f'<path class="limit" d="M{LEFT} {y(limit):.1f}H{WIDTH - RIGHT}"/>')
    return (
        f'<svg class="chart" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{described(chart, shown, limit)}">'
        f"{''.join(parts)}</svg>{_legend(chart, limit)}"
    )


def described(chart: Chart, points: Sequence[Point], limit: float | None) -> str:
    """The chart in words, for those who cannot see it."""
    known = [v for p in points if (v := chart.value(p)) is not None and math.isfinite(v)]
    words = f"{chart.title}: unknown" if not known else f"{chart.title}: {min(known):.3g} to {max(known):.3g}"
    return words + ("" if limit is None else f", limit {limit:g}")


def verdict_spans(points: Sequence[Point]) -> list[tuple[float, float, str]]:
    """(start, end, verdict) of the stretches of one verdict; silence between them is left out."""
    spans: list[tuple[float, float, str]] = []
    for point in points:
        if spans and point.time_s - spans[-1][1] <= GAP_S:
            start, _, verdict = spans[-1]
            spans[-1] = (start, point.time_s, verdict)
            if verdict == point.verdict:
                continue
        spans.append((point.time_s, point.time_s, point.verdict))
    return spans


def ticks(low: float, high: float) -> list[tuple[float, str]]:
    """Round values between the two, with their texts."""
    raw = (high - low) / MOST_TICKS
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * power for factor in (1, 2, 5, 10) if factor * power >= raw * 0.999)
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    first = math.ceil(low / step)
    return [
        (number * step, f"{number * step:.{digits}f}")
        for number in range(first, first + 3 * MOST_TICKS)
        if number * step <= high
    ]


def _range(chart: Chart, points: Sequence[Point], limit: float | None) -> tuple[float, float]:
    getters = [chart.value] if chart.second is None else [chart.value, chart.second]
    known = [v for p in points for get in getters if (v := get(p)) is not None and math.isfinite(v)]
    low = min(known, default=0.0) if chart.floor is None else chart.floor
    high = max([*known, low])
    if limit is not None:
        high = max(high, LIMIT_ROOM * limit)
    least = max(1e-6, 1e-6 * abs(high))
    if high - low < least:  # nothing, or one value alone
        high = low + max(1.0, 0.1 * abs(high))
    room = 0.06 * (high - low)
    return low - (room if chart.floor is None else 0.0), high + room


def _line(
    points: Iterable[Point],
    get: Callable[[Point], float | None],
    x: Callable[[float], float],
    y: Callable[[float], float],
) -> str:
    parts, before_s = [], -math.inf
    for point in points:
        value = get(point)
        if value is None or not math.isfinite(value):
            before_s = -math.inf
            continue
        joined = point.time_s - before_s <= GAP_S
        parts.append(f"{'L' if joined else 'M'}{x(point.time_s):.1f} {y(value):.1f}")
        if not joined:
            parts.append("h.1")
        before_s = point.time_s
    return "".join(parts)


def _band(
    chart: Chart, points: Sequence[Point], x: Callable[[float], float], y: Callable[[float], float]
) -> str:
    bars = []
    for number, point in enumerate(points):
        after = points[number + 1] if number + 1 < len(points) else None
        value, std = chart.value(point), chart.std(point) if chart.std else None
        if value is None or std is None or not math.isfinite(value) or not math.isfinite(std):
            continue
        end_s = point.time_s + 0.3 if after is None else min(after.time_s, point.time_s + GAP_S)
        top, foot = y(value + std), y(value - std)
        bars.append(f"M{x(point.time_s):.1f} {top:.1f}H{x(end_s):.1f}V{foot:.1f}H{x(point.time_s):.1f}Z")
    return f'<path class="band" d="{"".join(bars)}"/>'


def _legend(chart: Chart, limit: float | None) -> str:
    items = []
    if chart.second is not None:
        items += [
            f'<span class="key value">{chart.names[0]}</span>',
            f'<span class="key second">{chart.names[1]}</span>',
        ]
    if chart.std is not None:
        items.append('<span class="key band">± 1 sigma</span>')
    if limit is not None:
        items.append(f'<span class="key limit">limit {limit:g}</span>')
    return f'<div class="legend small">{"".join(items)}</div>'
