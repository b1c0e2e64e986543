"""A camera read by a thread of its own, which can be given up and replaced when the device hangs."""

import threading
import time
from collections import Counter, deque
from collections.abc import Callable

from drivers.cameras.checks import FrameCheck
from drivers.cameras.interface import Camera, CameraStatus, Grab, Grabber, Notify, ReaderLimits
from drivers.errors import DriverError
from drivers.events import DriverEvent
from drivers.samples import Frame, Refusal
from drivers.system.hanging import HangingThread
from drivers.system.host_clock import now_us

MAX_WAITING_REFUSALS = 256
"""Refusals kept for a consumer that does not come; older ones stay counted in the status."""

CHECK_S = 0.1
"""How often the supervisor looks whether a read hangs."""


class ReaderCamera(Camera):
    """Supervises one reader thread after another and keeps the newest frame.

    A read that blocks longer than the limits say is abandoned: its thread ends by itself whenever the driver lets it
    go, its late frames are ignored, and a new one opens the device again, with a pause that grows to the longest.
    """

    def __init__(
        self,
        name: str,
        make_grabber: Callable[[], Grabber],
        limits: ReaderLimits,
        notify: Notify | None = None,
    ) -> None:
        self._name = name
        self._make_grabber = make_grabber
        self._limits = limits
        self._notify = notify
        self._check = FrameCheck()
        self._changed = threading.Condition()
        self._closing = threading.Event()
        self._newest: Frame | None = None
        self._refusals: deque[Refusal] = deque(maxlen=MAX_WAITING_REFUSALS)
        self._events: deque[DriverEvent] = deque(maxlen=MAX_WAITING_REFUSALS)
        self._state = "opening"
        self._problem = ""
        self._size = (0, 0)
        self._grabbed = self._delivered = self._skipped = self._reopened = 0
        self._refused: Counter[str] = Counter()
        self._hanging: list[_Worker] = []
        self._all_hang_since: float | None = None
        self._remedy = ""
        self._supervisor = threading.Thread(target=self._supervise, name="camera supervisor", daemon=True)
        self._supervisor.start()

    def take(self) -> list[Frame | Refusal]:
        with self._changed:
            return self._take()

    def read(self, timeout_s: float) -> list[Frame | Refusal]:
        with self._changed:
            self._changed.wait_for(self._something, timeout_s)
            return self._take()

    def status(self) -> CameraStatus:
        with self._changed:
            self._hanging = [worker for worker in self._hanging if worker.is_alive()]
            all_hang = len(self._hanging) >= self._limits.max_hanging_reads
            if not all_hang:
                self._all_hang_since = None
            elif self._all_hang_since is None:
                self._all_hang_since = time.monotonic()
            return CameraStatus(
                state=self._state,
                problem=self._problem,
                width=self._size[0],
                height=self._size[1],
                grabbed=self._grabbed,
                delivered=self._delivered,
                skipped=self._skipped,
                waiting=int(self._newest is not None),
                refused=dict(self._refused),
                reopened=self._reopened,
                hanging_reads=len(self._hanging),
                stuck=self._is_stuck(),
                remedy=self._remedy,
            )

    def events(self) -> list[DriverEvent]:
        with self._changed:
            events = list(self._events)
            self._events.clear()
            return events

    def close(self) -> None:
        self._closing.set()
        self._supervisor.join(timeout=1.0)
        with self._changed:
            self._state = "closed"
            self._changed.notify_all()

    def _is_stuck(self) -> bool:
        since = self._all_hang_since
        return since is not None and time.monotonic() - since >= self._limits.stuck_after_s

    def _something(self) -> bool:
        return self._newest is not None or bool(self._refusals) or self._state in ("ended", "closed")

    def _take(self) -> list[Frame | Refusal]:
        samples: list[Frame | Refusal] = list(self._refusals)
        self._refusals.clear()
        if self._newest is not None:
            samples.append(self._newest)
            self._delivered += 1
            self._newest = None
        return samples

    def _supervise(self) -> None:
        pause_s = self._limits.first_retry_s
        while not self._closing.is_set():
            if self.status().hanging_reads < self._limits.max_hanging_reads:
                worker = _Worker(self._make_grabber(), self._deliver)
                worker.start()
                self._watch(worker)
                if worker.ended:
                    self._set_state("ended", "")
                    return
                if worker.grabbed:
                    pause_s = self._limits.first_retry_s
            if self._closing.wait(pause_s):
                return
            pause_s = min(2 * pause_s, self._limits.longest_retry_s)
            with self._changed:
                self._reopened += 1

    def _watch(self, worker: "_Worker") -> None:
        """Until the worker is done, has been silent for too long, or the camera is closed."""
        while not worker.finished.wait(CHECK_S):
            limit_s = self._limits.read_timeout_s if worker.grabbed else self._limits.open_timeout_s
            if self._closing.is_set():
                worker.abandoned.set()
                worker.finished.wait(CHECK_S)
                return
            if time.monotonic() - worker.last_progress > limit_s:
                worker.abandoned.set()
                with self._changed:
                    self._hanging.append(worker)
                self._set_state("lost", f"no frame from {self._name} for {limit_s:g} s; it is opened again")
                return
        if not worker.ended and not self._closing.is_set():
            self._remedy = worker.remedy
            self._set_state("lost", worker.error or f"the reader of {self._name} ended without a word")

    def _deliver(self, worker: "_Worker", grab: Grab) -> None:
        with self._changed:
            if worker.abandoned.is_set():
                return
            if grab.remark is not None:
                self._report(grab.remark[0], "warning", grab.remark[1])
            frame = Frame(self._grabbed, grab.captured_us, now_us(), grab.image)
            self._grabbed += 1
            sample = self._check.check(frame)
            if isinstance(sample, Refusal):
                self._refused[sample.reason] += 1
                self._refusals.append(sample)
            else:
                self._skipped += int(self._newest is not None)
                self._newest = sample
                self._size = sample.image.shape[1], sample.image.shape[0]
            self._changed.notify_all()
        self._set_state("ok", "")
        if self._notify is not None:
            self._notify()

    def _set_state(self, state: str, problem: str) -> None:
        with self._changed:
            if (state, problem) == (self._state, self._problem):
                return
            if state == "lost":
                self._report("camera_lost", "warning", problem)
            elif state == "ok" and self._state == "lost":
                self._report("camera_back", "info", f"{self._name} gives frames again")
            elif state == "ended":
                self._report("camera_ended", "info", f"{self._name} is at its end")
            self._state, self._problem = state, problem
            self._changed.notify_all()
        if self._notify is not None:
            self._notify()

    def _report(self, event: str, severity: str, text: str) -> None:
        self._events.append(DriverEvent(event, severity, text, now_us()))


class _Worker(HangingThread):
    """Opens, reads and closes one grabber; nobody else touches it, so a release never meets a read."""

    def __init__(self, grabber: Grabber, deliver: Callable[["_Worker", Grab], None]) -> None:
        super().__init__(name="camera reader")
        self._grabber = grabber
        self._hand_on = deliver
        self.last_progress = time.monotonic()
        self.grabbed = 0
        self.ended = False
        self.error = self.remedy = ""
        self.abandoned = threading.Event()
        self.finished = threading.Event()

    def run(self) -> None:
        """Read until the end, a failure, or until nobody waits any more."""
        try:
            self._grabber.open()
            self.last_progress = time.monotonic()
            while not self.abandoned.is_set():
                grab = self._grabber.grab()
                self.last_progress = time.monotonic()
                if grab is None:
                    self.ended = True
                    return
                self.grabbed += 1
                self._hand_on(self, grab)
        except DriverError as error:
            self.error, self.remedy = str(error), error.remedy
        finally:
            self._grabber.close()
            self.finished.set()
