"""The core, live: frames and telemetry in, outputs out to everybody who wants them. One thread, no waiting."""

import logging
import math
import time
from collections import Counter, deque
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from companion.core.camera_model import camera_model
from companion.core.core import Core, Output, Processed
from companion.live.event_rate import EventRate
from companion.live.kept_mask import KeptMask
from companion.messages.conditions import Condition
from companion.messages.messages import Event, Health
from companion.settings.settings import Settings
from drivers.events import DriverEvent
from drivers.files.camera_info import read_camera_info
from drivers.samples import Frame, Sample
from landing.ground.spots import Disc

log = logging.getLogger(__name__)

UNCALIBRATED_SIZE = (320, 240)
"""Image size that is assumed until the first frame of a camera without calibration."""
TIMES_KEPT = 100
LEVELS = {"info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}

Handler = Callable[[Output], None]
Counters = Callable[[], dict[str, int]]


class LivePipeline:
    """Feeds the core and hands its outputs to ``on_output``, in order.

    ``conditions()`` are those that stand outside of the core, asked at every turn; ``counters()`` are added to the
    health that is published. ``kept_mask`` keeps what stands still in the picture for the next start.
    """

    def __init__(
        self,
        settings: Settings,
        on_output: Handler,
        conditions: Callable[[], tuple[Condition, ...]] = tuple,
        counters: Counters = dict,
        kept_mask: KeptMask | None = None,
    ) -> None:
        self._settings = settings
        self._kept = kept_mask
        self._on_output = on_output
        self._conditions = conditions
        self._counters = counters
        self._size = _size(settings)
        self._core = self._new_core()
        self._times_ms: deque[float] = deque(maxlen=TIMES_KEPT)
        self._events = EventRate()
        self.estimated_at = -math.inf
        """Monotonic time (s) of the newest processed frame."""
        self.counted: Counter[str] = Counter()

    @property
    def body_from_camera(self) -> NDArray[np.float64]:
        """How the camera is mounted, (3, 3)."""
        return self._camera.body_from_camera

    @property
    def waiting(self) -> bool:
        """Whether a frame waits for the attitude behind its exposure."""
        return self._core.waiting

    def feed(self, samples: list[Sample]) -> None:
        """Take samples in order of arrival."""
        self._stand()
        for sample in samples:
            if isinstance(sample, Frame):
                self.counted["frames"] += 1
                self._fit(sample)
            started = time.perf_counter()
            outputs = self._core.feed(sample)
            self._hand_on(outputs, started)
        if samples:
            self._let_pass(self._events.step(samples[-1].arrival_us))
            self._keep(samples[-1].arrival_us)

    def tick(self, now_us: int) -> None:
        """Time passed without a sample."""
        self._stand()
        started = time.perf_counter()
        self._hand_on(self._core.tick(now_us), started)
        self._let_pass(self._events.step(now_us))

    def report(self, event: DriverEvent) -> None:
        """Something happened in a driver."""
        e = event
        self._output(
            Event(
                event=e.event,
                frame=None,
                time_unix_us=e.arrival_us,
                severity=e.severity,
                text=e.text,
                details=e.details,
            )
        )

    def hold(self) -> None:
        """The autopilot is being asked for hold, by us."""
        self._core.hold()

    def under_way(self) -> tuple[Disc, Disc]:
        """The ground map's answer, see ``GroundBelow``."""
        return self._core.under_way()

    def set_settings(self, settings: Settings) -> None:
        """Other settings of the decision from now on; the rest of them must be the same."""
        if settings.decision != self._settings.decision:
            self._core.set_decision(settings.decision)
        self._settings = settings

    def finish(self) -> None:
        """The end: what still waits is processed."""
        self._hand_on(self._core.finish(), time.perf_counter())
        self._let_pass(self._events.finish())
        self._keep(0, always=True)

    def _keep(self, now_us: int, always: bool = False) -> None:
        if self._kept is not None:
            self._kept.save(self._core.fixed, now_us, always)

    def _new_core(self) -> Core:
        self._camera, self._calibrated = camera_model(self._settings.camera, *self._size)
        telemetry = bool(self._settings.mavlink.connection)
        return Core(
            self._settings,
            self._camera,
            calibrated=self._calibrated,
            telemetry=telemetry,
            by_pilot=True,
            monotonic=True,
            fixed=None if self._kept is None else self._kept.load(*self._size),
        )

    def _fit(self, frame: Frame) -> None:
        """Without a calibration the frames say the size."""
        height, width = frame.image.shape
        if not self._settings.camera.calibration and (width, height) != self._size:
            self._size = (width, height)
            self._core = self._new_core()

    def _stand(self) -> None:
        """Let the core know what stands outside of it."""
        self._core.set_standing(self._conditions())

    def _hand_on(self, outputs: list[Output], started: float) -> None:
        if not outputs:
            return  # as of nearly every sample of telemetry
        if any(isinstance(output, Processed) for output in outputs):
            self.estimated_at = time.monotonic()
            self._times_ms.append((time.perf_counter() - started) * 1e3)
        for output in outputs:
            self._output(output)

    def _output(self, output: Output) -> None:
        if isinstance(output, Health):
            output = self._completed(output)
        elif isinstance(output, Event):
            self._let_pass(self._events.feed(output))
            return
        self._on_output(output)

    def _let_pass(self, events: list[Event]) -> None:
        for event in events:
            log.log(LEVELS[event.severity], "%s: %s", event.event, event.text)
            self._on_output(event)

    def _completed(self, health: Health) -> Health:
        mean_ms = round(sum(self._times_ms) / len(self._times_ms), 3) if self._times_ms else None
        return msgspec.structs.replace(
            health, counters={**health.counters, **self._counters()}, pipeline_ms=mean_ms
        )


def _size(settings: Settings) -> tuple[int, int]:
    if settings.camera.calibration:
        info = read_camera_info(Path(settings.camera.calibration))
        return info.width, info.height
    return settings.camera.width or UNCALIBRATED_SIZE[0], settings.camera.height or UNCALIBRATED_SIZE[1]
