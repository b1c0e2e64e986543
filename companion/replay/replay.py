"""One recorded flight through the core: as fast as it goes, or at its own pace."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import cv2

from companion.core.approach import Ordered
from companion.core.core import Core, LandRequest, Output, Processed
from companion.errors import LandslopeError
from companion.messages.ground import Ground
from companion.messages.messages import Decision, Message, topic_of
from companion.replay.history import History
from companion.replay.output import LineFile, Outputs
from companion.replay.overlay import OverlayWriter
from companion.replay.report.page import write_report
from companion.replay.report.recorder import ReportRecorder
from companion.replay.source import PlainCamera, ReplaySource, open_source
from companion.replay.summary import Pace, summary
from drivers.errors import DriverError
from drivers.samples import Frame, Sample

if TYPE_CHECKING:
    from companion.live.publisher import Publisher
    from companion.messages.preview import PreviewPublisher

PROGRESS_EVERY_FRAMES = 10
FOLLOW_POLL_S = 0.05
SUBSCRIBER_WAIT_S = 1.0
"""A watcher that is there already is given this long to be found before the first message."""

LONGEST_WAIT_S = 5.0
"""A hole in the recording is not waited out for longer than this at the recorded pace."""


class Autopilot(Protocol):
    """The real autopilot of a rehearsal, as the replay uses it."""

    def request(self, request: LandRequest) -> None:
        """Send the command; returns at once."""

    def replaces(self, sample: Sample) -> bool:
        """Whether a recorded sample gives way to the autopilot's own."""

    def samples(self) -> list[Sample]:
        """What the autopilot said since the last call, at the recording's time."""

    @property
    def busy(self) -> bool:
        """Whether a command still waits for its outcome."""

    def close(self) -> None:
        """End the link."""


@dataclass(frozen=True, slots=True)
class ReplayJob:
    """One flight and what is wanted of it."""

    name: str
    path: Path
    config: Path | None = None
    overrides: tuple[str, ...] = ()
    plain: PlainCamera = field(default_factory=PlainCamera)
    outputs: Outputs = field(default_factory=Outputs)
    publish: bool = False
    realtime: bool = False
    enable_after_s: float | None = None
    enable_from_rc: bool = False
    connect: str | None = None
    address: str = ""
    """Where a flight lies that is not on this machine; ``path`` is its copy."""


@dataclass(frozen=True, slots=True)
class Replayed:
    """What a replay gave: its summary in words, the messages, and how long it took."""

    text: str
    history: History
    pace: Pace


Progress = Callable[[int, int | None], None]
"""Called with the frames done and the frames there are (None: not known)."""


def replay(job: ReplayJob, progress: Progress = lambda done, total: None) -> Replayed:
    """Replay one flight. Raises the packages' errors, one line each."""
    cv2.setNumThreads(1)  # one core, and the same rounding everywhere
    source = open_source(job.path, job.config, job.overrides, job.plain)
    with ExitStack() as stack:
        run = _Run(job, source, stack, progress)
        damage = run.all()
        text = summary(job.name, run.history, source.settings.decision, run.pace, source.cautions)
        if run.report is not None and job.outputs.report is not None:
            write_report(job.name, run.history, source.settings, run.report, job.outputs.report)
    if job.outputs.plot is not None:
        from companion.replay.plot import plot

        plot(job.name, run.history, source.settings.decision, job.outputs.plot)
    if damage is not None:
        text = f"{text}\n  stopped    {damage}"
    return Replayed(text, run.history, run.pace)


class _Run:
    """The replay of one flight, from the first sample to the outcome of the command."""

    def __init__(self, job: ReplayJob, source: ReplaySource, stack: ExitStack, progress: Progress) -> None:
        self.history = History()
        self.pace = Pace(0.0, 0.0)
        self._drawing_s = 0.0
        self._job = job
        self._source = source
        self._progress = progress
        self._frames = 0
        self._last_decision: Decision | None = None
        if job.enable_from_rc:
            _check_switch(source)
        self._core = Core(
            source.settings,
            source.camera,
            calibrated=source.calibrated,
            telemetry=source.telemetry,
            by_pilot=job.enable_from_rc,
        )
        outputs = job.outputs
        self._out = LineFile(outputs.out) if outputs.out else None
        self._ground = LineFile(outputs.ground) if outputs.ground else None
        self._events = LineFile(outputs.events) if outputs.events else None
        self._video = (
            OverlayWriter(outputs.video, source.camera, radius_m=source.settings.vehicle.landing_radius_m)
            if outputs.video
            else None
        )
        self.report = (
            ReportRecorder(source.camera, source.settings.vehicle.landing_radius_m)
            if outputs.report
            else None
        )
        for file in (self._out, self._ground, self._events, self._video, self.report):
            if file:
                stack.callback(file.close)
        self._publisher, self._preview = _published(job, source, stack)
        self._autopilot = _connected(job, source, stack)

    def all(self) -> DriverError | None:
        """Everything there is; the error that ended the input early, if one did."""
        damage = None
        started_s, used_s = time.perf_counter(), time.thread_time()
        try:
            for sample in _paced(self._source.samples(), self._job.realtime):
                self._one(sample)
        except DriverError as error:
            if not self._frames:
                raise
            damage = error
        self._follow_command()
        self._take(self._core.finish())
        used_s = time.thread_time() - used_s - self._drawing_s
        self.pace = Pace(time.perf_counter() - started_s, used_s)
        return damage

    def _one(self, sample: Sample) -> None:
        if isinstance(sample, Frame):
            self._frames += 1
            if self._frames % PROGRESS_EVERY_FRAMES == 0:
                self._progress(self._frames, self._source.frame_count)
        after_s = self._job.enable_after_s
        if after_s is not None and self.history.now_s >= after_s:
            self._core.set_enabled(True)
        if self.report:
            self.report.sample(sample, self.history.now_s)
        if not (self._autopilot and self._autopilot.replaces(sample)):
            self._take(self._core.feed(sample))
        self._take_answers()

    def _take_answers(self) -> None:
        if self._autopilot:
            for answer in self._autopilot.samples():
                self._take(self._core.feed(answer))

    def _take(self, outputs: list[Output]) -> None:
        for output in outputs:
            if isinstance(output, LandRequest):
                for picture in (self._video, self.report):
                    if picture:
                        picture.requested(self.history.now_s)
                if self._autopilot:
                    self._autopilot.request(output)
            elif isinstance(output, Ordered):
                pass  # what it would have asked for stands in the decision
            elif not isinstance(output, Processed):
                self._message(output)
            elif self._preview:
                self._preview.put(output.frame, output.estimate, self.history.estimates[-1].time_unix_us)
        if self._video or self.report:
            self._draw(outputs)

    def _draw(self, outputs: list[Output]) -> None:
        started_s = time.thread_time()
        for output in outputs:
            if isinstance(output, Processed):
                if self._video:
                    self._video.add(output.frame.image, output.estimate, self.history.now_s)
                if self.report:
                    self.report.picture(output.frame, output.estimate, self.history.now_s)
        self._drawing_s += time.thread_time() - started_s

    def _message(self, message: Message) -> None:
        self.history.add(message)
        if self._out and topic_of(message) == "estimate":
            self._out.message(message)
        if self._ground and topic_of(message) == "ground":
            self._ground.message(message)
        if self._events:
            self._events.event(message, self._last_decision)
        if isinstance(message, Decision):
            self._last_decision = message
            if self._video:
                self._video.decided(message)
        if isinstance(message, Ground) and self._video is not None:
            self._video.mapped(message)
        if self.report:
            self.report.message(message, self.history.now_s)
        if self._publisher:
            self._publisher.publish(message)

    def _follow_command(self) -> None:
        """A command under way gets its outcome, though the recording has ended."""
        while self._autopilot and self._autopilot.busy:
            time.sleep(FOLLOW_POLL_S)
            self._take_answers()


def _check_switch(source: ReplaySource) -> None:
    """LandslopeError where the settings name no switch of the pilot's."""
    landing = source.settings.landing
    if not landing.enable_rc_channel and not landing.enable_modes:
        raise LandslopeError(
            "--enable-from-rc: the settings name no switch; --set landing.enable_rc_channel=CHANNEL, or "
            "landing.enable_modes"
        )


def _published(
    job: ReplayJob, source: ReplaySource, stack: ExitStack
) -> "tuple[Publisher | None, PreviewPublisher | None]":
    if not job.publish:
        return None, None
    from companion.live.publisher import Publisher  # zenoh, only for those who publish
    from companion.messages.preview import PreviewPublisher

    publisher = stack.enter_context(Publisher(source.settings))
    preview = PreviewPublisher(publisher.bus, source.settings.preview)
    stack.callback(preview.close)
    publisher.await_subscriber(SUBSCRIBER_WAIT_S)
    return publisher, preview


def _connected(job: ReplayJob, source: ReplaySource, stack: ExitStack) -> Autopilot | None:
    if job.connect is None:
        return None
    from companion.replay.rehearsal import Rehearsal  # MAVSDK starts slowly; only a rehearsal pays for it

    autopilot: Autopilot = Rehearsal(job.connect, source.settings)
    stack.callback(autopilot.close)
    return autopilot


def _paced(samples: Iterator[Sample], realtime: bool) -> Iterator[Sample]:
    """The samples, each at its recorded time when ``realtime``."""
    started: float | None = None
    first_us = last_us = 0
    for sample in samples:
        if realtime:
            now = time.monotonic()
            if started is None:
                started, first_us, last_us = now, sample.arrival_us, sample.arrival_us
            if not 0 <= sample.arrival_us - last_us <= LONGEST_WAIT_S * 1e6:
                started, first_us = now, sample.arrival_us  # a clock that jumped is not waited for
            last_us = sample.arrival_us
            wait_s = max(0.0, started + (sample.arrival_us - first_us) / 1e6 - now)
            if wait_s:
                time.sleep(wait_s)
        yield sample
