"""The daemon: live camera and autopilot in, estimates, decisions and the landing command out."""

import logging
import signal
import time
from collections.abc import Callable
from contextlib import ExitStack

import msgspec

from companion.clocks.date import Date
from companion.core.approach import Ordered
from companion.core.command import NAV_LAND
from companion.core.core import LandRequest, Output, Processed
from companion.core.landing_watch import LandingWatch
from companion.errors import LandslopeError
from companion.live.commander import TOO_LATE, Commander
from companion.live.inputs import Inputs
from companion.live.kept_mask import KeptMask
from companion.live.live_pipeline import LivePipeline
from companion.live.overload import Overload
from companion.live.publisher import Publisher
from companion.live.recording import FlightRecording
from companion.live.reload import reloaded
from companion.live.reporting import GroundReport
from companion.live.steering import Steering
from companion.messages.conditions import Code, Condition, condition
from companion.messages.messages import Estimate, Health, Message
from companion.messages.preview import PreviewPublisher
from companion.settings.settings import Settings
from drivers.errors import DriverError
from drivers.events import DriverEvent
from drivers.samples import CommandAnswer, Heartbeat, Imu, Sample, SystemTime
from drivers.system.host_clock import now_us
from drivers.system.service_manager import ServiceManager
from drivers.system.wall_clock import WallClock, wall_clock

log = logging.getLogger(__name__)

TICK_S = 0.1
"""How long the loop waits for something to happen; silence is noticed that often."""

ANSWER_S = 10.0
"""How long the end waits for the answer to a command; MAVSDK gives up by then."""
CLOSE_S = 2.0
ESTIMATORS_NEED = frozenset({"ATTITUDE", "RAW_IMU", "HIGHRES_IMU"})
"""Messages whose rate the estimates depend on."""

LOOK_S = 1.0
"""How often the wall clock is looked at."""

GATHER_S = 0.02
"""Telemetry is gathered for so long while no frame waits for it."""


class Daemon:
    """Wires camera, link, core, bus, ground report and commander, and runs until ``stop``.

    ``load`` reads the settings again for ``reload``. Closes ``inputs`` at its end. Everything that the outside may
    break is reopened by its driver; what is wrong in the settings raises an error of the packages at once.
    """

    def __init__(
        self,
        settings: Settings,
        inputs: Inputs,
        load: Callable[[], Settings] | None = None,
        look: Callable[[], WallClock] = wall_clock,
    ) -> None:
        self.settings = settings
        self._inputs, self._inbox = inputs, inputs.inbox
        self._link, self._camera = inputs.link, inputs.camera
        self._estimate_us = 0
        self._camera_now = inputs.camera.status()
        self._overload = Overload()
        self._date, self._look, self._look_at = Date(), look, 0.0
        self.failed = ""
        """Why the daemon ends by itself, to be started anew; empty while it need not."""
        self._load, self._reload_wanted = load, False
        with ExitStack() as stack:
            stack.callback(inputs.close)
            self.service = ServiceManager()
            stack.callback(self.service.close)
            self.recording = FlightRecording(settings)
            stack.callback(self.recording.close)
            self.pipeline = LivePipeline(
                settings, self._output, self._conditions, self.counters, KeptMask(settings.camera)
            )
            self._report = GroundReport(settings.mavlink, self.pipeline.body_from_camera)
            self._watch = LandingWatch(settings.landing, settings.decision.dwell_s, self.pipeline)
            self._publisher = stack.enter_context(Publisher(settings, retry=True))
            self._preview = PreviewPublisher(self._publisher.bus, settings.preview)
            stack.callback(self._preview.close)
            self._commander = self._steering = None
            if self._link is not None:
                self._link.may_beat = self._alive
                self._link.on_frame = self.recording.mavlink
                on_target = settings.landing.procedure == "landing_target"
                self._commander = Commander(
                    self._link, self._inbox.put, self._inbox.report, on_target=on_target
                )
                self._steering = Steering(settings, self._link, self._commander)
                self._commander.start()
                stack.callback(self._commander.close, CLOSE_S)
            self._stack = stack.pop_all()

    def run(self) -> None:
        """Work until ``stop``; a command under way gets its answer first."""
        self.service.ready()
        log.info("landslope runs for vehicle %s", self.settings.vehicle.name)
        with self._stack:
            while not self._inputs.stopped.is_set():
                self._turn()
            self.service.stopping()
            if self._commander is not None:
                self._commander.give_back()
            self._let_command_end()
            self.pipeline.finish()

    def stop(self) -> None:
        """End soon; from any thread or signal handler."""
        self._inputs.stop()

    def reload(self) -> None:
        """Take over what can be taken over of changed settings, soon; safe in a signal handler."""
        self._reload_wanted = True
        self._inbox.wake()

    @property
    def commander_connected(self) -> bool:
        """Whether a command to land could go out: MAVSDK has found the vehicle."""
        return self._commander is not None and self._commander.connected

    def counters(self) -> dict[str, int]:
        """What every part counted, for the health message."""
        status = self._camera.status()
        counted = {
            "camera grabbed": status.grabbed,
            "camera delivered": status.delivered,
            "camera skipped": status.skipped,
            "camera waiting": status.waiting,
            "camera reopened": status.reopened,
            "inbox dropped": self._inbox.dropped,
            "zenoh unsent": self._publisher.bus.unsent,
        }
        counted |= {f"camera refused: {reason}": count for reason, count in status.refused.items()}
        counted |= self.recording.counters
        if self._link is not None:
            counted |= {f"link {name}": count for name, count in sorted(self._link.counters.items())}
        return counted

    def _turn(self) -> None:
        """One round: what came is fed in order of arrival; the watchdog is fed when all of it went through."""
        if self._reload_wanted:
            self._reload_wanted = False
            self._reload()
        samples, events = self._inbox.take(TICK_S, 0.0 if self.pipeline.waiting else GATHER_S)
        samples += self._camera.take()
        samples.sort(key=_arrival)
        self._learn_date(samples)
        self.recording.samples(samples)
        for event in (*events, *self._camera.events(), *self.recording.step(now_us())):
            self.pipeline.report(event)
        if samples:
            if self._steering is not None:
                self._steering.feed(samples)
            self._feed_gyro(samples)
            self.pipeline.feed(samples)
        else:
            self.pipeline.tick(now_us())
        if self._camera_now.stuck and not self.failed:
            self.failed = "every read of the camera hangs in its driver; only a new process can open it again"
            self.pipeline.report(DriverEvent("camera_stuck", "error", self.failed, now_us()))
            self.stop()
        self.service.alive()

    def _reload(self) -> None:
        try:
            found = reloaded(self.settings, self._load() if self._load is not None else self.settings)
            settings = found.settings
            if found.changed:
                self.recording.set_settings(settings)
        except (LandslopeError, DriverError, OSError) as error:
            text = f"the settings stay as they are: {str(error).splitlines()[0]}"
            self.pipeline.report(DriverEvent("settings_refused", "error", text, now_us()))
            return
        self.settings = settings
        self.pipeline.set_settings(settings)
        self._report.set_settings(settings.mavlink)
        self._preview.set_settings(settings.preview)
        self._publisher.set_settings(settings)
        severity = "warning" if found.refused else "info"
        self.pipeline.report(DriverEvent("settings_reloaded", severity, found.text, now_us()))

    def _learn_date(self, samples: list[Sample]) -> None:
        """Looks at the wall clock once a second, and at every time that the autopilot sends."""
        found = []
        if time.monotonic() >= self._look_at:
            self._look_at = time.monotonic() + LOOK_S
            found.append(self._date.wall(self._look(), now_us()))
        found += [self._date.autopilot(sample) for sample in samples if isinstance(sample, SystemTime)]
        for event in filter(None, found):
            self.recording.set_date(self._date.offset_us, self._date.source)
            self.pipeline.report(event)

    def _feed_gyro(self, samples: list[Sample]) -> None:
        if self.settings.mavlink.optical_flow:
            for sample in samples:
                if isinstance(sample, Imu):
                    self._report.gyro(sample)
                elif isinstance(sample, Heartbeat):
                    self._report.autopilot = sample.autopilot

    def _output(self, output: Output) -> None:
        if isinstance(output, LandRequest):
            self._request(output)
        elif isinstance(output, Ordered):
            if self._steering is not None and not self._inputs.stopped.is_set():
                self._steering.carry_out(output.order, output.time_unix_us)
        elif isinstance(output, Processed):
            self._preview.put(
                output.frame, output.estimate, self._estimate_us + self._date.offset_us, output.mask
            )
            self.recording.processed(output)
        else:
            self._message(output)

    def _request(self, request: LandRequest) -> None:
        if self._commander is None or self._inputs.stopped.is_set():
            return
        if now_us() - request.time_unix_us > self.settings.landing.request_max_age_s * 1e6:
            self._inbox.put([CommandAnswer(now_us(), NAV_LAND, TOO_LATE)])
        else:
            self._commander.request(request)

    def _message(self, message: Message) -> None:
        if isinstance(message, Estimate):
            self._estimate_us = message.time_unix_us
        elif isinstance(message, Health):
            recording = self.recording.recording if self.settings.record.directory else None
            message = msgspec.structs.replace(message, recording=recording)
            self.service.status("; ".join(message.problems) or "all well")
        dated = self._date.dated(message)
        if isinstance(dated, Health):
            self._inputs.health_file.write(msgspec.json.encode(dated))  # for the doctor
        self._publisher.publish(dated)
        self.recording.message(dated)
        if self._link is not None:
            for outgoing in self._report.feed(message):
                self._link.send(outgoing)
        watched = self._watch.feed(message)
        if watched is not None:
            self._message(watched.event)
            if watched.hold and self._commander is not None:
                self.pipeline.hold()
                self._commander.hold()

    def _alive(self) -> bool:
        """Whether our heartbeats may go out: the pipeline made an estimate lately."""
        return time.monotonic() - self.pipeline.estimated_at < self.settings.mavlink.heartbeat_max_age_s

    def _conditions(self) -> tuple[Condition, ...]:
        """What stands wrong beside the pipeline."""
        found = list(self.recording.conditions())
        if self._link is not None and self._link.ambiguous:
            found.append(condition(Code.TWO_VEHICLES))
        if self._link is not None:
            wanted = self._link.rates.wanted_hz
            for name, hz in self._link.slow.items():
                if name not in ESTIMATORS_NEED:
                    continue  # an event reports it; its age is checked where it matters
                found.append(condition(Code.RATE_TOO_LOW, name, f"{hz:.1f} Hz of {wanted[name]:g}"))
            if self._link.unsigned_only:
                found.append(condition(Code.UNSIGNED))
        status = self._camera_now = self._camera.status()
        overloaded = self._overload.step(now_us(), status.delivered, status.skipped)
        if overloaded is not None:
            found.append(overloaded)
        if not self._date.known:
            found.append(condition(Code.CLOCK_WITHOUT_DATE))
        return tuple(found)

    def _let_command_end(self) -> None:
        if self._commander is None or not self._commander.busy:
            return
        log.info("a command is under way; waiting for its answer")
        self.service.more_time(ANSWER_S + CLOSE_S)
        deadline = time.monotonic() + ANSWER_S
        while self._commander.busy and time.monotonic() < deadline:
            self._turn()
        self._turn()


def stop_on_signals(daemon: Daemon) -> None:
    """SIGTERM and SIGINT end the daemon in good order; SIGHUP takes over changed settings.

    SIGUSR1 starts a recording by hand, SIGUSR2 stops it.
    """
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: daemon.stop())
    signal.signal(signal.SIGHUP, lambda *_: daemon.reload())
    signal.signal(signal.SIGUSR1, lambda *_: daemon.recording.by_hand(True))
    signal.signal(signal.SIGUSR2, lambda *_: daemon.recording.by_hand(False))


def _arrival(sample: Sample) -> int:
    return sample.arrival_us
