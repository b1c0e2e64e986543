"""A recorded flight: camera.mkv, frames.csv, vehicle.tlog, camera.yaml and landslope.toml in one folder.

The telemetry may also be the autopilot's own log, with its clock related to the companion's.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from heapq import merge
from pathlib import Path

from drivers.errors import DriverError
from drivers.files.autopilot_log import AutopilotLog, LogInTime
from drivers.files.dataflash import read_dataflash
from drivers.files.folder_clock import read_clock
from drivers.files.frame_table import FrameRow, read_frame_table
from drivers.files.tlog import read_tlog
from drivers.files.tlog_survey import STEP_US, ClockStep, Survey, survey_tlog
from drivers.files.ulog import read_ulog
from drivers.files.video_file import DEFAULT_FPS, Image, VideoFile
from drivers.mavlink.telemetry import TelemetryDecoder
from drivers.refusals import RefusalCode
from drivers.samples import ClockOffset, Frame, Refusal, Sample

VIDEO, STAMPS, TELEMETRY = "camera.mkv", "frames.csv", "vehicle.tlog"
LOGS: dict[str, Callable[[Path], AutopilotLog]] = {"vehicle.ulg": read_ulog, "vehicle.bin": read_dataflash}
"""Logs of PX4 and ArduPilot that take the place of the tlog."""
GAP_MIN = 0.5
"""Share of a frame's period by which a gap in the presentation times must be longer, and rows may differ from it."""

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
ROUNDED_FROM = 10
"""So many frames distinguish rounded stamps from repeated ones."""

CALIBRATION, SETTINGS = "camera.yaml", "landslope.toml"


class FlightFolder:
    """A flight folder, looked over when it is opened; ``samples()`` reads it from its beginning.

    ``system_id`` 0 takes the only vehicle in the telemetry. Raises DriverError, naming the file, for what cannot
    be replayed at all; damage inside of a file comes as refusals among the samples.
    """

    def __init__(
        self, path: Path, system_id: int = 0, component_id: int = 1, telemetry: LogInTime | None = None
    ) -> None:
        """``telemetry`` takes the place of vehicle.tlog: the autopilot's log in the companion's time."""
        self.path = Path(path)
        if not self.path.is_dir():
            raise DriverError(f"{path}: there is no such flight folder; check the path")
        self.video = VideoFile(self.path / VIDEO)
        self.calibration = _existing(self.path / CALIBRATION)
        self.settings = _existing(self.path / SETTINGS)
        self._system_id, self._component_id = system_id, component_id
        self._tlog = self.path / TELEMETRY
        self._log = telemetry
        if telemetry is None and not self._tlog.is_file():
            raise DriverError(
                f"{self._tlog}: the telemetry is missing; to go without it, replay {VIDEO} alone"
            )
        survey = survey_tlog(self._tlog, component_id) if telemetry is None else telemetry.survey()
        if system_id == 0 and len(survey.vehicles) > 1:
            ids = " and ".join(map(str, survey.vehicles))
            raise DriverError(
                f"{self._tlog}: vehicles {ids} speak in it; set vehicle.system_id to one of them"
            )
        if system_id and survey.vehicles and system_id not in survey.vehicles:
            ids = ", ".join(map(str, survey.vehicles))
            raise DriverError(
                f"{self._tlog}: nothing of vehicle {system_id} in it, but of {ids}; set vehicle.system_id"
            )
        self._steps = survey.steps
        self.attitude_hz = survey.attitude_hz
        """Rate of the attitudes recorded; 0: none."""
        self._table = read_frame_table(self.path / STAMPS, survey.steps)
        rows = list(self._table.rows.values())
        self.width, self.height = self.video.width, self.video.height
        self.frame_count = len(rows)
        self.start_us = min(rows[0].order_us, survey.first_us or rows[0].order_us)
        self._check_overlap(survey)
        clock = read_clock(self.path)
        self.add_us = 0 if clock is None else clock.add_us or 0
        """What was added to all times, since the recorder did not know the date."""
        self.start_us += self.add_us
        self.duration_s = (rows[-1].order_us - rows[0].order_us) * 1e-6

    def _check_overlap(self, survey: Survey) -> None:
        """DriverError where frames and telemetry were stamped at different times, or the stamps are rounded."""
        times = [row.order_us for row in self._table.rows.values()]
        first_us, last_us = min(times), max(times)
        # both spans with the steps of the clock taken out
        start_us, end_us = survey.first_us, survey.last_us - sum(step.size_us for step in survey.steps)
        if survey.first_us and (last_us < start_us or first_us > end_us):
            apart_s = (start_us - last_us if last_us < start_us else first_us - end_us) * 1e-6
            order = "earlier" if last_us < start_us else "later"
            raise DriverError(
                f"{self.path}: video and telemetry do not overlap: {STAMPS} spans {_span(first_us, last_us)}, "
                f"{TELEMETRY} {_span(start_us, end_us)}: the frames are {apart_s:.0f} s {order} (local time "
                f"against UTC?); correct host_time_us, or replay {VIDEO} alone"
            )
        stamps = [row.stamp_us for row in self._table.rows.values()]
        if len(stamps) > ROUNDED_FROM and len(set(stamps)) < len(stamps) / 2:
            raise DriverError(
                f"{self.path / STAMPS}: {len(stamps)} frames have {len(set(stamps))} different stamps, as {stamps[0]}: "
                "a spreadsheet has rounded them; take the table as it was recorded"
            )

    def samples(self) -> Iterator[Sample]:
        """Everything recorded, in the order in which it arrived; frames are decoded one at a time."""
        for _, _, sample in merge(self._telemetry(), self._frames(), key=lambda item: item[:2]):
            yield later(sample, self.add_us) if self.add_us else sample

    def frames(self) -> Iterator[Frame]:
        """The frames alone, with their stamps as they were recorded."""
        return (sample for _, _, sample in self._frames() if isinstance(sample, Frame))

    def _telemetry(self) -> Iterator[tuple[int, int, Sample]]:
        """(order, 0, sample); the order is the arrival with clock steps taken out."""
        decoder = TelemetryDecoder(self._system_id, self._component_id)
        shift, previous, order = 0, 0, 0
        steps = list(self._steps)
        recorded = read_tlog(self._tlog, decoder) if self._log is None else self._log.samples()
        for sample in recorded:
            arrival_us = sample.arrival_us
            if previous and steps and _is_step(steps[0], arrival_us - previous):
                shift += steps.pop(0).size_us
            previous = arrival_us or previous
            order = max(order, arrival_us - shift)
            yield order, 0, sample

    def _frames(self) -> Iterator[tuple[int, int, Sample]]:
        """(order, 1, frame or refusal)."""
        rows = self._table.rows
        first = next(iter(rows.values()))
        order, stamp_us, due, decoded = first.order_us, first.stamp_us, 0, 0
        refusals = list(self._table.refusals)
        for index, image in self._numbered_images():
            for lost in range(due, index):
                if lost in rows:
                    order, stamp_us = max(order, rows[lost].order_us), rows[lost].stamp_us
                    detail = f"frame {lost} of {VIDEO}"
                    yield order, 1, Refusal(stamp_us, "camera", RefusalCode.UNDECODABLE_FRAME, detail)
            due, decoded = index + 1, decoded + 1
            row = rows.get(index)
            if row is None:
                detail = f"frame {index} of {VIDEO}"
                yield order, 1, Refusal(stamp_us, "camera", RefusalCode.FRAME_WITHOUT_STAMP, detail)
                continue
            order, stamp_us = max(order, row.order_us), row.stamp_us
            while refusals and refusals[0].arrival_us < stamp_us:
                yield order, 1, refusals.pop(0)
            yield order, 1, Frame(index, stamp_us, stamp_us, image)
        if decoded == 0:
            raise DriverError(f"{self.video.path}: not a single frame can be decoded; record or copy it anew")
        for refusal in refusals:
            yield order, 1, refusal
        for number in [n for n in rows if n >= due]:
            order, stamp_us = max(order, rows[number].order_us), rows[number].stamp_us
            detail = f"frame {number}: {VIDEO} ends before"
            yield order, 1, Refusal(stamp_us, "camera", RefusalCode.VIDEO_ENDED, detail)

    def _numbered_images(self) -> Iterator[tuple[int, Image]]:
        """Frames of the video with their number in frames.csv.

        The rows count the frames as they were written. Where damage took frames out of the video, the gap in its
        presentation times gives how many rows to skip: as many as the stamps need to make up for the gap. With as
        many frames as rows nothing is missing, whatever the times say: a camera a little off the file's nominal rate
        leaves gaps in them too.
        """
        rows = self._table.rows
        period_s = 1 / (self.video.fps or DEFAULT_FPS)
        number, last_s = -1, 0.0
        complete: bool | None = None
        for time_s, image in self.video.timed_images():
            number += 1
            before = rows.get(number - 1)
            if before is not None and time_s - last_s > (1 + GAP_MIN) * period_s:
                complete = self.video.count() == len(rows) if complete is None else complete
                number = number if complete else self._row_after(before, number, time_s - last_s, period_s)
            last_s = time_s
            yield number, image

    def _row_after(self, before: FrameRow, number: int, gap_s: float, period_s: float) -> int:
        """The row that stands a gap in time behind the row before; the next one, ``number``, if none does."""
        rows = self._table.rows
        for later in range(number, number + round(gap_s / period_s) + 1):
            row = rows.get(later)
            if row is not None and abs((row.order_us - before.order_us) * 1e-6 - gap_s) < GAP_MIN * period_s:
                return later
        return number


def log_in(path: Path) -> AutopilotLog | None:
    """The autopilot's log of a folder without a tlog: PX4's or ArduPilot's; None where there is none.

    DriverError where it cannot be read.
    """
    if (path / TELEMETRY).exists():
        return None
    found = [(path / name, read) for name, read in LOGS.items() if (path / name).is_file()]
    return found[0][1](found[0][0]) if found else None


def by_round_trips(log: AutopilotLog, path: Path) -> LogInTime | None:
    """The log in the time of the folder's frames; None where no round trip in it was made with their clock."""
    orders = [row.order_us for row in read_frame_table(path / STAMPS).rows.values()]
    return log.by_round_trips(min(orders), max(orders))


def at_the_start(log: AutopilotLog, path: Path) -> LogInTime:
    """The log as if it began with the folder's frames: for reading those before the clocks are related."""
    first_us = min(row.order_us for row in read_frame_table(path / STAMPS).rows.values())
    return log.by_offset(first_us - log.recorded[0].arrival_us, 0.0)


def later(sample: Sample, add_us: int) -> Sample:
    """The sample with its times of the companion's clock moved."""
    arrival_us = sample.arrival_us + add_us
    if isinstance(sample, Frame):
        return replace(sample, arrival_us=arrival_us, stamp_us=sample.stamp_us + add_us)
    if isinstance(sample, ClockOffset):
        return replace(sample, arrival_us=arrival_us, offset_us=sample.offset_us + add_us)
    return replace(sample, arrival_us=arrival_us)


def _is_step(step: ClockStep, delta_us: int) -> bool:
    """Whether two arrivals in a row stand on either side of a step of the clock."""
    return abs(delta_us - step.size_us) < STEP_US


def _span(first_us: int, last_us: int) -> str:
    """Two times in UTC."""
    first, last = (EPOCH + timedelta(microseconds=us) for us in (first_us, last_us))
    return f"{first:%Y-%m-%d %H:%M:%S} to {last:%Y-%m-%d %H:%M:%S} UTC"


def _existing(path: Path) -> Path | None:
    return path if path.is_file() else None
