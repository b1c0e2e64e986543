"""The core, live: frames and telemetry in, outputs out to everybody who wants them. One thread, no waiting."""

import logging
import math
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from companion.core.camera_model import camera_model
from companion.core.core import Core, Output, Processed
from companion.core.enable import EnableSwitch
from companion.messages.messages import Event, Health
from companion.settings.settings import Settings
from drivers.events import DriverEvent
from drivers.files.camera_info import read_camera_info
from drivers.samples import Frame, Sample

log = logging.getLogger(__name__)

UNCALIBRATED_SIZE = (320, 240)
"""Image size that is assumed until the first frame of a camera without calibration tells."""
TIMES_KEPT = 100
LEVELS = {"info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}

Handler = Callable[[Output], None]
Counters = Callable[[], dict[str, int]]


class LivePipeline:
    """Feeds the core and hands its outputs to ``on_output``, in order.

    ``may_enable()`` False withholds the pilot's permission whatever the switch says; ``counters()`` are added to
    the health that is told.
    """

    def __init__(
        self,
        settings: Settings,
        on_output: Handler,
        may_enable: Callable[[], bool] = lambda: True,
        counters: Counters = dict,
    ) -> None:
        self._settings = settings
        self._on_output = on_output
        self._may_enable = may_enable
        self._counters = counters
        self._size = _size(settings)
        self._core = self._new_core()
        self._switch = EnableSwitch(settings.landing)
        self._against_enabling = "nothing came yet"
        self._times_ms: deque[float] = deque(maxlen=TIMES_KEPT)
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
        for sample in samples:
            if isinstance(sample, Frame):
                self.counted["frames"] += 1
                self._fit(sample)
            self._set_enabled(self._switch.feed(sample), sample.arrival_us)
            started = time.perf_counter()
            outputs = self._core.feed(sample)
            self._hand_on(outputs, started)

    def tick(self, now_us: int) -> None:
        """Time passed without a sample."""
        started = time.perf_counter()
        self._hand_on(self._core.tick(now_us), started)

    def tell(self, event: DriverEvent) -> None:
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

    def finish(self) -> None:
        """The end: what still waits is processed."""
        self._hand_on(self._core.finish(), time.perf_counter())

    def _new_core(self) -> Core:
        self._camera, self._calibrated = camera_model(self._settings.camera, *self._size)
        telemetry = bool(self._settings.mavlink.connection)
        # The pilot's switch decides, not the settings alone.
        landing = replace(self._settings.landing, enabled=False)
        return Core(
            replace(self._settings, landing=landing),
            self._camera,
            calibrated=self._calibrated,
            telemetry=telemetry,
            monotonic=True,
        )

    def _fit(self, frame: Frame) -> None:
        """Without a calibration the first frame tells the size."""
        height, width = frame.image.shape
        if (
            not self._settings.camera.calibration
            and self.counted["frames"] == 1
            and (width, height) != self._size
        ):
            self._size = (width, height)
            self._core = self._new_core()
            self._core.set_enabled(not self._against_enabling)

    def _set_enabled(self, wanted: bool, time_us: int) -> None:
        """What the pilot wants, as far as it is safe; every change is told."""
        against = self._switch.reason if not wanted else self._against()
        if against == self._against_enabling:
            return
        self._against_enabling = against
        self._core.set_enabled(not against)
        name = "landing_disabled" if against else "landing_enabled"
        text = f"landing is not enabled: {against}" if against else "landing is enabled"
        self.tell(DriverEvent(name, "info", text, time_us))

    def _against(self) -> str:
        if not self._calibrated:
            return "the camera is not calibrated"
        return "" if self._may_enable() else "two vehicles on the link: set vehicle.system_id"

    def _hand_on(self, outputs: list[Output], started: float) -> None:
        if any(isinstance(output, Processed) for output in outputs):
            self.estimated_at = time.monotonic()
            self._times_ms.append((time.perf_counter() - started) * 1e3)
        for output in outputs:
            self._output(output)

    def _output(self, output: Output) -> None:
        if isinstance(output, Health):
            output = self._completed(output)
        elif isinstance(output, Event):
            log.log(LEVELS[output.severity], "%s: %s", output.event, output.text)
        self._on_output(output)

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
