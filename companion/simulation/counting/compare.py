"""What a change did: two tables of the same flights, class by class, with intervals, the worst flights first."""

from collections.abc import Iterable, Sequence
from typing import Any

from companion.simulation.counting.shares import wilson

Row = dict[str, Any]
GRAVITY = {"crashed": 4, "unsafe": 3, "view": 2, "missed": 1}
"""How bad an outcome is; every other is 0."""
MOST_FLIGHTS = 20


def worse_flights(before: Sequence[Row], after: Sequence[Row]) -> int:
    """How many flights of both tables ended worse."""
    return sum(_gravity(b) > _gravity(a) for a, b in _pairs(before, after))


def comparison(before: Sequence[Row], after: Sequence[Row]) -> str:
    """Markdown, ready for a pull request."""
    lines = ["| ground | outcome | before | after |", "|---|---|---|---|"]
    for ground in ["all", *sorted({row["ground"] for row in (*before, *after)})]:
        old, new = ([r for r in rows if ground in ("all", r["ground"])] for rows in (before, after))
        for outcome in GRAVITY:
            counts = [sum(row["outcome"] == outcome for row in rows) for rows in (old, new)]
            if ground == "all" or any(counts):
                cells = [_share(count, len(rows)) for count, rows in zip(counts, (old, new), strict=True)]
                lines.append(f"| {ground} | {outcome} | {cells[0]} | {cells[1]} |")
    return "\n".join([*lines, "", *_flights(before, after)])


def _flights(before: Sequence[Row], after: Sequence[Row]) -> Iterable[str]:
    pairs = _pairs(before, after)
    changed = [(a, b) for a, b in pairs if a["outcome"] != b["outcome"]]
    worse = worse_flights(before, after)
    better = sum(_gravity(b) < _gravity(a) for a, b in changed)
    same = len(pairs) - worse - better
    yield f"{len(pairs)} flights in both tables: {worse} worse, {better} better, {same} as before."
    changed.sort(key=lambda pair: (_gravity(pair[0]) - _gravity(pair[1]), pair[1]["seed"]))
    for a, b in changed[:MOST_FLIGHTS]:
        yield f"- seed {b['seed']} ({b['ground']}): {a['outcome']} -> {b['outcome']}"


def _pairs(before: Sequence[Row], after: Sequence[Row]) -> list[tuple[Row, Row]]:
    """The flights of both tables, by seed."""
    old = {row["seed"]: row for row in before}
    return [(old[row["seed"]], row) for row in after if row["seed"] in old]


def _gravity(row: Row) -> int:
    return GRAVITY.get(row["outcome"], 0)


def _share(count: int, total: int) -> str:
    low, high = wilson(count, total)
    return f"{count} of {total} ({100 * low:.1f} to {100 * high:.1f} %)" if total else "none of 0"
