"""Ten minutes of one vehicle as a bar in the colours of the verdict, and what was true at a moment of it."""

from bisect import bisect_right
from collections.abc import Sequence

from companion.monitor.charts import verdict_spans
from companion.monitor.state import Point
from companion.monitor.words import VERDICTS, duration, number

WIDTH, HEIGHT = 1000, 34


def timeline_svg(points: Sequence[Point], now_s: float, span_s: float, shown: tuple[float, float]) -> str:
    """The bar of the last ``span_s`` seconds; ``shown``: what the charts show, seconds back (from, to)."""

    def x(time_s: float) -> float:
        return max(0.0, (time_s - now_s + span_s) / span_s * WIDTH)

    bars = "".join(
        f'<rect class="v-{verdict}" x="{x(start):.1f}" y="0" height="{HEIGHT}"'
        f' width="{max(1.0, x(end) - x(start)):.1f}"/>'
        for start, end, verdict in verdict_spans(points)
    )
    left, right = x(now_s - shown[0]), x(now_s - shown[1])
    return (
        f'<svg class="timeline" viewBox="0 0 {WIDTH} {HEIGHT}" preserveAspectRatio="none" role="img"'
        f' aria-label="verdict over the last {span_s / 60:.0f} minutes">{bars}'
        f'<rect class="window" x="{left:.1f}" y="1" width="{max(2.0, right - left):.1f}" height="{HEIGHT - 2}"/></svg>'
    )


def at(points: Sequence[Point], time_s: float) -> Point | None:
    """The newest point not after the time."""
    index = bisect_right(points, time_s, key=lambda point: point.time_s)
    return points[index - 1] if index else None


def in_words(point: Point | None, back_s: float) -> str:
    """What was true so many seconds ago."""
    if point is None:
        return f"{duration(back_s)} ago: nothing was heard yet"
    what = VERDICTS.get(point.verdict, point.verdict.upper())
    height = f", height {number(point.height_m, 1, ' m')}" if point.height_m is not None else ""
    return f"{duration(back_s)} ago: {what}, inclination {number(point.inclination_deg, 1, '°')}{height}"
