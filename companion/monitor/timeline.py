"""The timeline of the monitor's page: the last minutes' verdicts as an SVG bar, and the state at a chosen moment."""

from bisect import bisect_right
from collections.abc import Sequence

from companion.monitor.charts import verdict_spans
from companion.monitor.state import Point
from companion.monitor.words import VERDICTS, duration, number

WIDTH, HEIGHT = 1000, 34


def timeline_svg(points: Sequence[Point], now_s: float, span_s: float, shown: tuple[float, float]) -> str:
    """The bar of the last ``span_s`` seconds before ``now_s``, coloured by verdict, as SVG.

    ``points``: the vehicle's history in the order of time. ``shown``: the part that the charts show, framed in the bar,
    as seconds before ``now_s`` (from, to).
    """

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
    """The newest point that is not later than ``time_s``; None when there is none."""
    index = bisect_right(points, time_s, key=lambda point: point.time_s)
    return points[index - 1] if index else None


def in_words(point: Point | None, back_s: float) -> str:
    """The state ``back_s`` seconds ago in words: verdict, inclination and height."""
    if point is None:
        return f"{duration(back_s)} ago: nothing was heard yet"
    what = VERDICTS.get(point.verdict, point.verdict.upper())
    height = f", height {number(point.height_m, 1, ' m')}" if point.height_m is not None else ""
    return f"{duration(back_s)} ago: {what}, inclination {number(point.inclination_deg, 1, '°')}{height}"
