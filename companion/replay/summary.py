"""What happened in a flight, in words that a pilot understands."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from companion.messages.events import LANDING_EVENTS
from companion.replay.history import History
from companion.replay.procedure_spans import procedure_lines
from landing.options import DecisionOptions

LEVEL_DEG = 3.0
BIN_S = 0.5
SAME_DEG = 4.0
UNKNOWN_DISTANCE_DEG = 15.0
ROUGH_DISTANCE_DEG = 5.0
"""How far apart an even and an uneven surface of one inclination are, to call them different."""
ROUGH_SHARE = 0.5
BRIEF_BINS = 4
PARTLY = (0.2, 0.7)
"""Shares of the frames: fewer rough ones make an even surface, more an uneven one."""
KNOWN_SHARE = 0.3
TROUBLE_SHOWN = 8
TROUBLE_REPEATED = 3
"""An event that came more often is one line with its count."""
REFUSED = "refused "
NOT_ENABLED = "landing is not enabled"
LABEL_WIDTH = 11


@dataclass(frozen=True, slots=True)
class Pace:
    """How long a replay took, and how much of one core it used without the drawing of pictures."""

    elapsed_s: float
    computing_s: float


@dataclass(frozen=True, slots=True)
class Stretch:
    """A time over which the surface below was much the same; inclinations NaN where it was unknown."""

    start_s: float
    end_s: float
    surface: str
    low_deg: float
    high_deg: float

    def __str__(self) -> str:
        spread = (
            f" ({self.low_deg:.0f} to {self.high_deg:.0f} degrees)" if math.isfinite(self.low_deg) else ""
        )
        return f"{self.start_s:5.1f} to {self.end_s:5.1f} s  {self.surface}{spread}"


@dataclass(slots=True)
class _Run:
    """Bins in a row; ``members`` are indices of their estimates, the inclination NaN where unknown."""

    bins: int
    members: list[int]
    inclination_deg: float
    rough: bool

    def distance_deg(self, other: "_Run") -> float:
        both = math.isnan(self.inclination_deg), math.isnan(other.inclination_deg)
        if any(both):
            return 0.0 if all(both) else UNKNOWN_DISTANCE_DEG
        apart = abs(self.inclination_deg - other.inclination_deg)
        return apart if self.rough == other.rough else apart + ROUGH_DISTANCE_DEG


def stretches(history: History, limits: DecisionOptions) -> list[Stretch]:
    """The flight cut into stretches of like inclination, from the estimates in bins of half a second."""
    times, inclination = np.array(history.times), history.series("inclination_deg")
    if np.all(np.isnan(inclination)):
        inclination = np.hypot(history.series("slope_x_deg"), history.series("slope_y_deg"))
    rough = history.series("roughness") > limits.max_roughness
    numbers = np.floor(times / BIN_S).astype(int)
    bins = []
    for number in np.unique(numbers):
        members = np.flatnonzero(numbers == number).tolist()
        is_rough = float(rough[members].mean()) > ROUGH_SHARE
        bins.append(_Run(1, members, _middle(inclination[members]), is_rough))
    frame_s = history.duration_s / max(times.size, 1)
    found = []
    for run in _without_brief(_joined(bins, inclination), inclination):
        known = inclination[run.members]
        known = known[np.isfinite(known)]
        low, high = np.percentile(known, (10, 90)) if math.isfinite(run.inclination_deg) else (np.nan, np.nan)
        surface = _words(run.inclination_deg, float(rough[run.members].mean()), limits)
        start_s, end_s = float(times[run.members[0]]), float(times[run.members[-1]] + frame_s)
        found.append(Stretch(start_s, end_s, surface, float(low), float(high)))
    return found


def summary(
    name: str, history: History, limits: DecisionOptions, pace: Pace, cautions: Sequence[str] = ()
) -> str:
    """The summary of one flight, several lines; ``cautions`` are what the recording lacks."""
    estimates = history.estimates
    head = f"{name}: {len(estimates)} frames in {history.duration_s:.1f} s"
    if pace.computing_s > 0 and estimates:
        factor = history.duration_s / pace.computing_s
        head += f", replayed in {pace.elapsed_s:.1f} s"
        head += f"; computing took {pace.computing_s:.1f} s of one core: {factor:.1f} times real time"
    return "\n".join([head, *(f"  {line}" for line in _body(history, limits, cautions))])


def _body(history: History, limits: DecisionOptions, cautions: Sequence[str]) -> Iterator[str]:
    estimates = history.estimates
    if not estimates:
        yield "no frame could be used"
        yield from _refusals(history)
        return
    yield from _labelled("estimates", [share_line(history)])
    yield from _labelled("caution", list(cautions))
    if not all(e.calibrated for e in estimates):
        yield from _labelled("caution", ["uncalibrated camera: slopes are only roughly right"])
    good = [e for e in estimates if e.status == "ok"]
    if good and all(e.inclination_deg is None for e in good):
        yield from _labelled("caution", ["no attitude: slopes are relative to the camera, not to gravity"])
    yield from _labelled("below", [str(stretch) for stretch in stretches(history, limits)])
    yield from _labelled("fit", [fit_line(history)])
    yield from _labelled("landing", list(landing_lines(history)))
    yield from _labelled("procedure", procedure_lines(history))
    yield from _labelled("trouble", list(_trouble(history)))
    yield from _refusals(history)


def _labelled(label: str, lines: list[str]) -> Iterator[str]:
    for number, line in enumerate(lines):
        yield f"{label if number == 0 else '':<{LABEL_WIDTH}}{line}"


def share_line(history: History) -> str:
    """How many frames have an estimate, and why the others have none."""
    statuses = Counter(e.status for e in history.estimates)
    total, good = len(history.estimates), statuses.pop("ok", 0)
    text = f"{good} of {total} frames ({100 * good / total:.0f} %)"
    if statuses:
        text += "; the others: " + ", ".join(f"{n} {s.replace('_', ' ')}" for s, n in statuses.most_common())
    return text


def fit_line(history: History) -> str:
    """Since when and how long the surface was fit."""
    first = next((entry for entry in history.decisions if entry[1].verdict == "fit"), None)
    if first is None:
        against = Counter(reason.partition(":")[0] for e in history.estimates for reason in e.against_flat)
        why = f"; most often: {against.most_common(1)[0][0]}" if against else ""
        return f"never fit for landing{why}"
    share = history.verdicts.count("fit") / len(history.estimates)
    at_s, decision = first
    return (
        f"first fit for landing at {at_s:.1f} s (frame {decision.frame}); fit {100 * share:.0f} % of the time"
    )


def landing_lines(history: History) -> Iterator[str]:
    """The request to land and what became of it, or why there was none."""
    events = [(at_s, e) for at_s, e in history.events if e.event in LANDING_EVENTS]
    for at_s, event in events:
        if event.event == "landing_requested":
            yield f"requested at {at_s:.1f} s (frame {event.frame})"
        else:
            yield f"{at_s:.1f} s: {event.text}"
    if events:
        return
    fit = [(at_s, d) for at_s, d in history.decisions if d.verdict == "fit"]
    ready_s = next((at_s for at_s, d in fit if not [w for w in d.withheld if w != NOT_ENABLED]), None)
    if ready_s is not None:
        yield f"not requested, as it was not enabled (--enable-after); it would have been at {ready_s:.1f} s"
    elif fit:
        yield "not requested: " + "; ".join(fit[-1][1].withheld)
    else:
        yield "not requested"


def _refusals(history: History) -> Iterator[str]:
    counters = history.health.counters if history.health else {}
    lines = [
        f"{count} of {name.removeprefix(REFUSED).replace('_', ' ')}"
        for name, count in sorted(counters.items())
        if name.startswith(REFUSED)
    ]
    yield from _labelled("refused", lines)


def _trouble(history: History) -> Iterator[str]:
    events = [t for t in history.events if t[1].severity != "info" and t[1].event not in LANDING_EVENTS]
    often = Counter(event.event for _, event in events)
    shown: Counter[str] = Counter()
    lines = []
    for at_s, event in events:
        shown[event.event] += 1
        if often[event.event] <= TROUBLE_REPEATED:
            lines.append(f"{at_s:5.1f} s  {event.text}")
        elif shown[event.event] == 1:
            name = event.event.replace("_", " ")
            lines.append(f"{at_s:5.1f} s  {event.text} ({name} {often[event.event]} times)")
    yield from lines[:TROUBLE_SHOWN]
    if len(events) > min(len(lines), TROUBLE_SHOWN):
        yield f"{len(events)} in all: --events FILE.jsonl has them"


def _middle(inclination: np.ndarray) -> float:
    known = inclination[np.isfinite(inclination)]
    return float(np.median(known)) if known.size > KNOWN_SHARE * inclination.size else math.nan


def _words(inclination_deg: float, rough_share: float, limits: DecisionOptions) -> str:
    if math.isnan(inclination_deg):
        return "not known"
    if inclination_deg < LEVEL_DEG:
        surface = "level"
    else:
        surface = f"slope of {inclination_deg:.0f} degrees"
        if inclination_deg > limits.max_inclination_deg:
            surface += ", too steep to land"
    few, most = PARTLY
    return surface + (
        ", uneven" if rough_share > most else ", partly uneven" if rough_share > few else ", even"
    )


def _joined(bins: list[_Run], inclination: np.ndarray) -> list[_Run]:
    """Neighbours of like inclination become one."""
    joined: list[_Run] = []
    for run in bins:
        if joined and joined[-1].distance_deg(run) <= SAME_DEG:
            joined[-1] = _union(joined[-1], run, inclination)
        else:
            joined.append(run)
    return joined


def _without_brief(runs: list[_Run], inclination: np.ndarray) -> list[_Run]:
    """What lasts only a moment, such as the way over an edge, goes to the neighbour that it is most like."""
    runs = list(runs)
    while len(runs) > 1:
        at = min(range(len(runs)), key=lambda i: runs[i].bins)
        if runs[at].bins >= BRIEF_BINS:
            break
        neighbours = [i for i in (at - 1, at + 1) if 0 <= i < len(runs)]
        to = min(neighbours, key=lambda i: runs[i].distance_deg(runs[at]))
        first, last = min(at, to), max(at, to)
        kept = runs[to]
        runs[first : last + 1] = [_union(runs[first], runs[last], inclination)]
        runs[first].inclination_deg, runs[first].rough = kept.inclination_deg, kept.rough
    return _joined(runs, inclination)


def _union(first: _Run, second: _Run, inclination: np.ndarray) -> _Run:
    members = first.members + second.members
    larger = first if first.bins >= second.bins else second
    return _Run(first.bins + second.bins, members, _middle(inclination[members]), larger.rough)
