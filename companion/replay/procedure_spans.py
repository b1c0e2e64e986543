"""What the landing procedure did, or in a replay would have done: stretches of one state."""

from dataclasses import dataclass

from companion.messages.messages import Decision, ProcedureState
from companion.replay.history import History

IDLE = "idle"
SHOWN = 12


@dataclass(frozen=True, slots=True)
class ProcedureSpan:
    """A stretch of one state; ``text`` is the first reason in it. The place from the vehicle where it ended, if any."""

    start_s: float
    end_s: float
    state: str
    text: str
    spot_m: tuple[float, float] | None

    def __str__(self) -> str:
        state = self.state.replace("_", " ")
        return f"{self.start_s:5.1f} to {self.end_s:5.1f} s  {state}: {self.text}"


def steered(decision: Decision) -> ProcedureState | None:
    """The procedure of a decision; None where there is none."""
    return decision.procedure if isinstance(decision.procedure, ProcedureState) else None


def procedure_spans(history: History) -> list[ProcedureSpan]:
    """Of the whole flight; empty without a procedure."""
    found: list[ProcedureSpan] = []
    for at_s, decision in history.decisions:
        now = steered(decision)
        if now is None:
            continue
        spot = None
        if now.spot_north_m is not None and now.spot_east_m is not None:
            spot = now.spot_north_m, now.spot_east_m
        if found and found[-1].state == now.state:
            last = found.pop()
            found.append(ProcedureSpan(last.start_s, at_s, last.state, last.text, spot or last.spot_m))
            continue
        if found:
            last = found.pop()
            found.append(ProcedureSpan(last.start_s, at_s, last.state, last.text, last.spot_m))
        found.append(ProcedureSpan(at_s, at_s, now.state, now.text, spot))
    if found:
        last = found.pop()
        end_s = max(history.duration_s, last.start_s)
        found.append(ProcedureSpan(last.start_s, end_s, last.state, last.text, last.spot_m))
    return found


def procedure_lines(history: History) -> list[str]:
    """For the summary: what it does but wait; the wait only where there is nothing else."""
    spans = procedure_spans(history)
    moving = [span for span in spans if span.state != IDLE]
    lines = [str(span) for span in (moving or spans[-1:])]
    more = len(lines) - SHOWN
    return lines if more <= 0 else [*lines[:SHOWN], f"and {more} more: --events FILE.jsonl has them"]
