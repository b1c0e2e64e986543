"""The core: samples in, messages and requests out. Single-threaded, deterministic, without a clock of its own."""

from dataclasses import dataclass

from companion.attitude import BodyAttitude
from companion.command import CommandChange, CommandState
from companion.events import event
from companion.health import HealthMonitor
from companion.messages import Decision, Event, Message, estimate_message
from companion.settings import Settings
from companion.sync import Notice, ReadyFrame, Synchroniser
from drivers.samples import CommandAnswer, Frame, Heartbeat, LandedState, Refusal, Sample
from landing.camera import CameraModel
from landing.decision import Decider, Verdict
from landing.estimate import SurfaceEstimate
from landing.observation import Observation
from landing.options import Options
from landing.permit import Permit, PermitInputs, PermitState
from landing.pipeline import SurfacePipeline

ATTITUDE_WITNESSES = 3
"""Frames in a row without an attitude (or with one again) before an event tells of it."""

SECOND_US = 1_000_000


@dataclass(frozen=True, slots=True)
class LandRequest:
    """The autopilot is to be told to land."""

    frame: int
    time_unix_us: int
    text: str


@dataclass(frozen=True, slots=True)
class Processed:
    """A frame and its estimate, for pictures and recordings."""

    frame: Frame
    estimate: SurfaceEstimate


Output = Message | LandRequest | Processed


class Core:
    """Samples in order of arrival in, outputs out; the same samples give the same outputs, bit for bit.

    ``calibrated`` is passed on to the estimates; ``telemetry`` False: a plain video, frames do not wait.
    """

    def __init__(self, settings: Settings, camera: CameraModel, *, calibrated: bool, telemetry: bool) -> None:
        self._settings = settings
        self._camera = camera
        self._calibrated = calibrated
        self._pipeline = SurfacePipeline(
            camera, Options(settings.tracking, settings.estimator, settings.decision)
        )
        self._decider = Decider(settings.decision)
        self._permit = Permit()
        self._command = CommandState(settings.landing.mode_timeout_s)
        self._sync = Synchroniser(settings, telemetry)
        self._health = HealthMonitor(settings.health, telemetry)
        self._enabled = settings.landing.enabled
        self._heartbeat: Heartbeat | None = None
        self._landed: LandedState | None = None
        self._verdict = Verdict("unknown", ("nothing seen yet",), 0.0, False)
        self._verdict_us = 0
        self._verdict_frame = 0
        self._since_us = 0
        self._decision: Decision | None = None
        self._attitude_known: bool | None = None
        self._attitude_streak = 0
        self._stale: frozenset[str] = frozenset()
        self._health_due_us: int | None = None
        self._frame_number: int | None = None

    def set_enabled(self, enabled: bool) -> None:
        """The user's permission to land; taking it back and giving it again allows another request."""
        self._enabled = enabled
        if not enabled:
            self._step_permit(False)
            self._command.reset()

    def feed(self, sample: Sample) -> list[Output]:
        """Take one sample; returns what came of it, in order."""
        out: list[Output] = []
        ready, notices = self._sync.feed(sample)
        self._count(sample, out)
        for notice in notices:
            self._tell(notice, out)
        for frame in ready:
            self._process(frame, out)
        if isinstance(sample, Heartbeat | LandedState | CommandAnswer):
            self._follow(sample, out)
        self._tick(out)
        return out

    def tick(self, now_us: int) -> list[Output]:
        """Time passed without a sample, as happens live: frames that waited long enough go on, silence is told."""
        out: list[Output] = []
        for frame in self._sync.tick(now_us):
            self._process(frame, out)
        self._tick(out)
        return out

    def finish(self) -> list[Output]:
        """End of the input: frames still waiting are processed, the last state is told."""
        out: list[Output] = []
        for frame in self._sync.flush("end_of_input"):
            self._process(frame, out)
        if self._health_due_us is not None:
            self._tell_health(out)
            self._decide(self._verdict_frame, self._verdict_us, out, always=True)
        return out

    def _count(self, sample: Sample, out: list[Output]) -> None:
        self._health.count(sample, self._sync.now_us)
        refused = self._sync.refused
        if isinstance(sample, Refusal):
            if sample.reason == "second_vehicle" and not self._health.vehicles_clash:
                self._health.vehicles_clash = True
                out.append(event("second_vehicle", None, sample.arrival_us, detail=sample.detail))
        elif isinstance(sample, Frame):
            if refused:
                reason = next(iter(refused))[1]
                self._refuse_frame(sample, reason, out)
            self._frame_number = sample.number
        for (name, reason), count in refused.items():
            for _ in range(count):
                self._health.refuse(name, reason)
        refused.clear()

    def _refuse_frame(self, frame: Frame, reason: str, out: list[Output]) -> None:
        """An estimate that says why there is none."""
        at_us = frame.stamp_us - round(self._settings.camera.time_offset_s * 1e6)
        estimate = SurfaceEstimate(frame.number, at_us * 1e-6, reason, self._settings.estimator.method)
        out.append(estimate_message(estimate, at_us, None, self._calibrated))

    def _process(self, ready: ReadyFrame, out: list[Output]) -> None:
        frame, attitude = ready.frame, ready.attitude
        if frame.image.shape != (self._camera.height, self._camera.width):
            self._health.refuse("frames", "image_size")
            self._refuse_frame(frame, "image_size", out)
            return
        known = isinstance(attitude, BodyAttitude)
        if isinstance(attitude, BodyAttitude):
            observation = Observation(
                frame.number,
                ready.time_us * 1e-6,
                frame.image,
                attitude.ned_from_body,
                attitude.rotation_std,
                ready.velocity_ned,
            )
        else:
            self._health.counters[f"frames without attitude: {attitude}"] += 1
            observation = Observation(frame.number, ready.time_us * 1e-6, frame.image)
        self._watch_attitude(known, "" if known else str(attitude), ready, out)
        estimate = self._pipeline.step(observation)
        self._health.counters[f"estimates {estimate.status}"] += 1
        boot_s = None if ready.boot_us is None else ready.boot_us * 1e-6
        out.append(estimate_message(estimate, ready.exposure_us, boot_s, self._calibrated))
        out.append(Processed(frame, estimate))
        self._verdict = self._decider.step(estimate)
        self._verdict_us, self._verdict_frame = ready.exposure_us, frame.number
        self._since_us = ready.exposure_us - round((estimate.time_s - self._verdict.since_s) * 1e6)
        if self._verdict.changed:
            text = f"surface {self._verdict.verdict}"
            if self._verdict.reasons:
                text += ": " + "; ".join(self._verdict.reasons)
            out.append(
                event(
                    "decision_changed",
                    frame.number,
                    ready.exposure_us,
                    text,
                    verdict=self._verdict.verdict,
                    reasons=list(self._verdict.reasons),
                )
            )
        self._decide(frame.number, ready.exposure_us, out)

    def _decide(self, frame: int, time_unix_us: int, out: list[Output], *, always: bool = False) -> None:
        """Ask the permit, request a landing if it says so, and tell the decision when it is due."""
        permit = self._step_permit(self._verdict.verdict == "fit")
        if permit.request:
            text = f"surface fit for landing since {(time_unix_us - self._since_us) * 1e-6:.1f} s"
            self._commanded(self._command.request(time_unix_us), out, text)
            out.append(LandRequest(frame, time_unix_us, text))
        decision = Decision(
            frame=frame,
            time_unix_us=time_unix_us,
            verdict=self._verdict.verdict,
            reasons=self._verdict.reasons,
            since_unix_us=self._since_us,
            permitted=permit.permitted,
            withheld=permit.withheld,
            requested=self._permit.requested,
            command=self._command.state,
        )
        last = self._decision
        if (
            always
            or last is None
            or _gist(decision) != _gist(last)
            or (abs(time_unix_us - last.time_unix_us) >= SECOND_US)
        ):
            self._decision = decision
            out.append(decision)

    def _step_permit(self, fit: bool) -> PermitState:
        now_us = self._sync.now_us
        stale = list(self._health.stale(now_us))
        if self._health.vehicles_clash:
            stale.append("two vehicles on the link")
        heartbeat = self._heartbeat if "heartbeat" not in stale else None
        landed = self._landed.state if self._landed and "landed_state" not in stale else "undefined"
        return self._permit.step(
            PermitInputs(
                time_s=now_us * 1e-6,
                verdict_fit=fit,
                enabled=self._enabled,
                armed=None if heartbeat is None else heartbeat.armed,
                in_air=None if landed == "undefined" else landed == "in_air",
                mode_allowed=None
                if heartbeat is None
                else heartbeat.mode in self._settings.landing.allowed_modes,
                fresh=not stale,
                stale=tuple(stale),
                command_busy=self._command.busy,
            )
        )

    def _follow(self, sample: Heartbeat | LandedState | CommandAnswer, out: list[Output]) -> None:
        if isinstance(sample, Heartbeat):
            self._heartbeat = sample
        elif isinstance(sample, LandedState):
            self._landed = sample
        changes = self._command.feed(sample)
        if changes:
            self._commanded(changes, out)
            self._decide(self._verdict_frame, self._sync.raw_us(), out)

    def _commanded(self, changes: list[CommandChange], out: list[Output], text: str = "") -> None:
        for change in changes:
            out.append(
                Event(
                    event=change.event,
                    frame=self._verdict_frame,
                    time_unix_us=change.time_us,
                    severity=change.severity,
                    text=text or f"command to land: {change.state}",
                )
            )

    def _watch_attitude(self, known: bool, reason: str, ready: ReadyFrame, out: list[Output]) -> None:
        if reason == "no_telemetry":
            return
        if known == self._attitude_known:
            self._attitude_streak = 0
            return
        self._attitude_streak += 1
        first = self._attitude_known is None and known
        if not first and self._attitude_streak < ATTITUDE_WITNESSES:
            return
        self._attitude_known, self._attitude_streak = known, 0
        if not first:
            name, text = ("attitude_back", "") if known else ("attitude_lost", reason.replace("_", " "))
            out.append(event(name, ready.frame.number, ready.exposure_us, text))

    def _tell(self, notice: Notice, out: list[Output]) -> None:
        if notice.name == "autopilot_rebooted":
            # Nothing that the autopilot said before holds any more.
            self._heartbeat = self._landed = None
        out.append(event(notice.name, self._frame_number, self._sync.raw_us(), **notice.details))

    def _tick(self, out: list[Output]) -> None:
        """Health, and the decision while no frames come, at their rate of sample time."""
        now_us = self._sync.now_us
        if now_us == 0:
            return
        if self._health_due_us is None:
            self._health_due_us = now_us + round(self._settings.health.period_s * 1e6)
        if now_us < self._health_due_us:
            return
        period_us = round(self._settings.health.period_s * 1e6)
        self._health_due_us += period_us * (1 + (now_us - self._health_due_us) // period_us)
        self._tell_health(out)
        if self._health.state("frames", now_us) != "ok":
            self._verdict = Verdict("unknown", ("no frames",), self._verdict.since_s, False)
            self._decide(self._verdict_frame, self._sync.raw_us(), out)

    def _tell_health(self, out: list[Output]) -> None:
        sync = self._sync
        stale = frozenset(self._health.stale(sync.now_us)) if self._health.telemetry else frozenset()
        for name in sorted(stale ^ self._stale):
            text = name.replace("_", " ") + (" stopped" if name in stale else " is back")
            what = "input_stale" if name in stale else "input_back"
            out.append(event(what, self._frame_number, sync.raw_us(), text, input=name))
        self._stale = stale
        settled = sync.clock.settled
        offset = sync.clock.offset_us(sync.clock.boot_us(sync.now_us)) if settled else None
        out.append(
            self._health.message(
                sync.now_us, sync.raw_us(), settled, offset, sync.clock.std_s if settled else None
            )
        )


def _gist(decision: Decision) -> tuple[object, ...]:
    """What of a decision is told at once when it changes."""
    d = decision
    return d.verdict, d.permitted, d.withheld, d.requested, d.command
