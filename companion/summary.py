"""What happened in a flight, in words that a pilot understands."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from companion.history import History
from landing.options import DecisionOptions

LEVEL_DEG = 3.0
BIN_S = 0.5
SAME_SLOPE_DEG = 6.0
KNOWN_SHARE = 0.3
LABEL_WIDTH = 11


@dataclass(frozen=True, slots=True)
class Stretch:
    """A time over which the surface below was much the same; inclinations NaN where it was unknown."""

    start_s: float
    end_s: float
    kind: str
    rough: bool
    inclination_deg: float
    low_deg: float
    high_deg: float

    def __str__(self) -> str:
        if self.kind == "unknown":
            return "not known"
        surface = {
            "level": "level",
            "gentle": f"gentle slope of {self.inclination_deg:.0f} degrees",
            "slope": f"slope of {self.inclination_deg:.0f} degrees",
        }[self.kind]
        spread = f"{self.low_deg:.0f} to {self.high_deg:.0f} degrees measured"
        return f"{surface}, {'uneven' if self.rough else 'even'} ({spread})"


def stretches(history: History, limits: DecisionOptions) -> list[Stretch]:
    """The flight cut into stretches of like surface, from the estimates in bins of half a second."""
    times, inclination = history.times_s(), history.series("inclination_deg")
    if np.all(np.isnan(inclination)):
        inclination = np.hypot(history.series("slope_x_deg"), history.series("slope_y_deg"))
    roughness = history.series("roughness")
    if not times.size:
        return []
    bins = np.floor(times / BIN_S).astype(int)
    runs: list[tuple[str, bool, list[int]]] = []
    for number in range(bins[-1] + 1):
        members = np.flatnonzero(bins == number)
        kind, rough = _describe(inclination[members], roughness[members], limits)
        if runs and _same(runs[-1], kind, rough, inclination, members):
            runs[-1][2].extend(members.tolist())
        else:
            runs.append((kind, rough, members.tolist()))
    frame_s = history.duration_s / times.size
    found = []
    for kind, rough, indices in _absorb_short(runs):
        known = inclination[indices][np.isfinite(inclination[indices])]
        low, middle, high = np.percentile(known, (10, 50, 90)) if known.size else (np.nan,) * 3
        start, end = times[indices[0]], times[indices[-1]] + frame_s
        found.append(Stretch(float(start), float(end), kind, rough, float(middle), float(low), float(high)))
    return found


def summary(name: str, history: History, limits: DecisionOptions, elapsed_s: float) -> str:
    """The summary of one flight, several lines."""
    estimates = history.estimates
    head = f"{name}: {len(estimates)} frames in {history.duration_s:.1f} s"
    if elapsed_s > 0 and estimates:
        head += f", replayed in {elapsed_s:.1f} s: {history.duration_s / elapsed_s:.1f} times real time on one core"
    return "\n".join([head, *(f"  {line}" for line in _body(history, limits))])


def _body(history: History, limits: DecisionOptions) -> Iterator[str]:
    estimates = history.estimates
    if not estimates:
        yield "no frame could be used"
        yield from _refusals(history)
        return
    yield from _labelled("estimates", [_share(history)])
    if not all(e.calibrated for e in estimates):
        yield from _labelled("caution", ["uncalibrated camera: slopes are only roughly right"])
    if all(e.inclination_deg is None for e in estimates):
        yield from _labelled("caution", ["no attitude: slopes are relative to the camera, not to gravity"])
    below = [f"{s.start_s:5.1f} to {s.end_s:5.1f} s  {s}" for s in stretches(history, limits)]
    yield from _labelled("below", below)
    yield from _labelled("fit", [_fit(history)])
    yield from _labelled("landing", list(_landing(history)))
    yield from _refusals(history)


def _labelled(label: str, lines: list[str]) -> Iterator[str]:
    for number, line in enumerate(lines):
        yield f"{label if number == 0 else '':<{LABEL_WIDTH}}{line}"


def _share(history: History) -> str:
    statuses = Counter(e.status for e in history.estimates)
    total, good = len(history.estimates), statuses.pop("ok", 0)
    text = f"{good} of {total} frames ({100 * good / total:.0f} %)"
    if statuses:
        text += "; the others: " + ", ".join(f"{n} {s.replace('_', ' ')}" for s, n in statuses.most_common())
    return text


def _fit(history: History) -> str:
    first = next((d for d in history.decisions if d.verdict == "fit"), None)
    if first is None:
        against = Counter(reason for e in history.estimates for reason in e.against_flat)
        why = f"; mostly: {against.most_common(1)[0][0]}" if against else ""
        return f"never fit for landing{why}"
    share = sum(verdict == "fit" for verdict in history.verdicts()) / len(history.estimates)
    when = history.seconds(first.time_unix_us)
    return f"first fit for landing at {when:.1f} s (frame {first.frame}); fit {100 * share:.0f} % of the time"


def _landing(history: History) -> Iterator[str]:
    requests = [e for e in history.events if e.event == "landing_requested"]
    for event in requests:
        yield f"requested at {history.seconds(event.time_unix_us):.1f} s (frame {event.frame})"
    if requests:
        for event in history.events:
            if event.event.startswith("landing_") and event.event != "landing_requested":
                yield f"{history.seconds(event.time_unix_us):.1f} s: {event.text}"
        return
    fit = [d for d in history.decisions if d.verdict == "fit"]
    ready = next((d for d in fit if not [w for w in d.withheld if "enabled" not in w]), None)
    if ready is not None:
        yield f"not requested, as it was not enabled; it would have been at {history.seconds(ready.time_unix_us):.1f} s"
    elif fit:
        yield "not requested: " + "; ".join(fit[-1].withheld)
    else:
        yield "not requested"


def _refusals(history: History) -> Iterator[str]:
    lines = [
        f"{n} of {source}: {reason.replace('_', ' ')}"
        for (source, reason), n in history.refused.most_common()
    ]
    yield from _labelled("refused", lines)


def _describe(inclination: np.ndarray, roughness: np.ndarray, limits: DecisionOptions) -> tuple[str, bool]:
    known = inclination[np.isfinite(inclination)]
    if not inclination.size or known.size < KNOWN_SHARE * inclination.size:
        return "unknown", False
    rough = roughness[np.isfinite(roughness)]
    middle = float(np.median(known))
    kind = "level" if middle < LEVEL_DEG else "gentle" if middle <= limits.max_inclination_deg else "slope"
    return kind, bool(rough.size and np.median(rough) > limits.max_roughness)


def _same(
    run: tuple[str, bool, list[int]], kind: str, rough: bool, inclination: np.ndarray, members: np.ndarray
) -> bool:
    if not members.size:
        return True
    if (run[0], run[1]) != (kind, rough):
        return False
    if kind != "slope":
        return True
    return bool(abs(np.nanmedian(inclination[run[2]]) - np.nanmedian(inclination[members])) <= SAME_SLOPE_DEG)


def _absorb_short(runs: list[tuple[str, bool, list[int]]]) -> list[tuple[str, bool, list[int]]]:
    """A stretch of one bin between two of the same kind is noise, not a surface."""
    merged: list[tuple[str, bool, list[int]]] = []
    longest = max(len(run[2]) for run in runs)
    for at, (kind, rough, members) in enumerate(runs):
        after = runs[at + 1] if at + 1 < len(runs) else None
        before = merged[-1] if merged else None
        brief = len(members) * 8 < longest or len(members) <= 20
        if brief and before and after and before[:2] == after[:2]:
            kind, rough = before[:2]
        if before and before[:2] == (kind, rough):
            before[2].extend(members)
        else:
            merged.append((kind, rough, list(members)))
    return merged
