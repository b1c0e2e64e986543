"""frames.csv: which frame of the video was stamped when, on the companion's clock."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from itertools import pairwise
from pathlib import Path
from statistics import median

from drivers.errors import DriverError
from drivers.files.tlog_survey import STEP_US, ClockStep
from drivers.refusals import RefusalCode
from drivers.samples import Refusal

COLUMNS = ("frame", "host_time_us")
LARGEST = 2 * 10**17
"""Frame numbers and stamps are smaller."""
STEP_AGREEMENT_US = 200_000
"""How well a step of the frames' stamps must match one of the telemetry's to be the same."""


@dataclass(frozen=True, slots=True)
class FrameRow:
    """Frame ``number`` (its index in the video) and its stamp; ``order_us``: the stamp with clock steps taken out."""

    number: int
    stamp_us: int
    order_us: int


@dataclass(frozen=True, slots=True)
class FrameTable:
    """The rows of frames.csv by frame number, ascending, and what was refused of it."""

    rows: dict[int, FrameRow]
    refusals: tuple[Refusal, ...]


def read_frame_table(path: Path, steps: Sequence[ClockStep] = ()) -> FrameTable:
    """Read frames.csv; ``steps`` are those of the telemetry's clock. DriverError if there is nothing to use in it."""
    try:
        text = path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise DriverError(
            f"{path}: the frames' time stamps cannot be read ({error.strerror}); "
            "without them, replay the video file alone"
        ) from None
    reader = csv.DictReader(text.replace("\0", "?").splitlines(), skipinitialspace=True)
    reader.fieldnames = [name.strip() for name in reader.fieldnames or ()]
    if not set(COLUMNS) <= set(reader.fieldnames):
        raise DriverError(f"{path}: {_wrong_header(reader.fieldnames)}")
    stamps: dict[int, int] = {}
    bad: list[tuple[int, RefusalCode, str]] = []
    last_us = 0
    for line in reader:
        try:
            if any(line.get(None) or ()):  # csv's key of what is too much
                raise ValueError("it has more values than columns: a decimal comma?")
            number, stamp_us = (_whole(line[column]) for column in COLUMNS)
        except ValueError as error:
            bad.append(
                (last_us, RefusalCode.UNREADABLE_ROW, f"line {reader.line_num} of {path.name}: {error}")
            )
            continue
        if number in stamps or number < 0 or stamp_us < 0:
            reason = RefusalCode.REPEATED_ROW if number in stamps else RefusalCode.UNREADABLE_ROW
            bad.append((last_us, reason, f"line {reader.line_num} of {path.name}, frame {number}"))
            continue
        stamps[number] = last_us = stamp_us
    if not stamps:
        why = f" ({bad[0][2]})" if bad else ""
        raise DriverError(
            f"{path}: no row with a frame and its time stamp{why}; host_time_us is a whole number of microseconds; "
            "without them, replay the video alone"
        )
    first_us = next(iter(stamps.values()))
    refusals = tuple(
        Refusal(at_us or first_us, "frames.csv", reason, detail) for at_us, reason, detail in bad
    )
    return FrameTable(_ordered(stamps, steps), refusals)


def _wrong_header(names: Sequence[str]) -> str:
    """What is wrong with a first line."""
    needed = " and ".join(COLUMNS)
    for separator, word in ((";", "semicolons"), ("\t", "tabulators")):
        if set(COLUMNS) <= {name.strip() for name in separator.join(names).split(separator)}:
            return f"its values are separated by {word}: separate them by commas"
    return f"the first line must name the columns {needed}"


def _whole(text: str | None) -> int:
    """A whole number, also as spreadsheets write it (12.0, 1.2e3); ValueError, in words, for anything else."""
    try:
        value = Decimal(str(text).strip())
        if value.is_finite() and abs(value) < LARGEST and value == value.to_integral_value():
            return int(value)
    except InvalidOperation:
        raise ValueError(f"{text!r} is no number") from None
    raise ValueError(f"{text} is no whole number (of microseconds: are these seconds?)")


def _ordered(stamps: dict[int, int], steps: Sequence[ClockStep]) -> dict[int, FrameRow]:
    """Rows by number, with the times they are sorted by among the telemetry.

    Where the clock was set, stamps and the telemetry's arrivals step together; sorted by raw stamps, one would
    run ahead of the other. A single stamp that falls back is wrong, and no step.
    """
    numbers = sorted(stamps)
    values = [stamps[n] for n in numbers]
    rising = [b - a for a, b in pairwise(values) if b > a]
    period_us = round(median(rising)) if rising else 0
    rows: dict[int, FrameRow] = {}
    shift, newest = 0, values[0] - period_us
    for k, (number, stamp_us) in enumerate(zip(numbers, values, strict=True)):
        delta_us = stamp_us - newest
        following = values[k + 1] if k + 1 < len(values) else stamp_us
        outlier = delta_us <= 0 and following > newest
        if not outlier:
            excess_us = delta_us - period_us
            step = next((s for s in steps if _same(s, excess_us, newest, stamp_us)), None)
            if step is not None:
                shift += step.size_us
            elif delta_us <= 0:
                shift += excess_us
            newest = stamp_us
        rows[number] = FrameRow(number, stamp_us, max(stamp_us, newest) - shift)
    return rows


def _same(step: ClockStep, excess_us: int, before_us: int, after_us: int) -> bool:
    """Whether the frames' stamps step by the same amount at the same time as the telemetry's."""
    near = max(abs(step.before_us - before_us), abs(step.after_us - after_us)) < STEP_US
    return near and abs(excess_us - step.size_us) < STEP_AGREEMENT_US
