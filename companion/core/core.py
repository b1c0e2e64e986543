"""The core: samples in, messages and requests out. Single-threaded, deterministic, without a clock of its own."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from companion.core.approach import Approach, Ordered
from companion.core.attitude import BodyAttitude, FramesAttitude
from companion.core.camera_times import CameraTimes
from companion.core.decision_logic import DecisionLogic, Followed, LandRequest
from companion.core.estimator_doubt import ASSUMED_VELOCITY_STD
from companion.core.frozen_camera import FrozenCamera
from companion.core.ground import GroundReporter
from companion.core.health import Clocks, HealthMonitor
from companion.core.mask_watch import MaskWatch
from companion.core.recurring_events import RecurringEvents
from companion.core.sync import Notice, ReadyFrame, Synchroniser
from companion.messages.conditions import Condition
from companion.messages.events import event
from companion.messages.messages import Message, estimate_message
from companion.settings.settings import Settings
from drivers.refusals import RefusalCode
from drivers.samples import Frame, Refusal, Sample, Velocity
from landing.estimate import SurfaceEstimate
from landing.ground.landing_area import LandingArea
from landing.ground.spots import Disc
from landing.observation import Observation
from landing.options import DecisionOptions, Options
from landing.pipeline import SurfacePipeline
from landing.vision.camera import CameraModel


@dataclass(frozen=True, slots=True)
class Processed:
    """A frame and its estimate, for pictures and recordings."""

    frame: Frame
    estimate: SurfaceEstimate
    mask: NDArray[np.bool_] | None = None
    """Pixels (height, width) that do not show the ground."""


Output = Message | LandRequest | Processed | Ordered


def observation_of(ready: ReadyFrame) -> Observation:
    """What the pipeline is given for a frame."""
    frame, attitude, time_s = ready.frame, ready.attitude, ready.time_us * 1e-6
    if not isinstance(attitude, BodyAttitude):
        return Observation(frame.number, time_s, frame.image, late_s=ready.late_s, delay_s=ready.delay_s)
    rotation, std = attitude.ned_from_body, attitude.rotation_std
    return Observation(
        frame.number,
        time_s,
        frame.image,
        rotation,
        std,
        ready.velocity_ned,
        velocity_age_s=ready.velocity_age_s,
        velocity_noise=ready.velocity_noise,
        velocity_std=ASSUMED_VELOCITY_STD * ready.doubt.velocity_factor,
        velocity_factor=ready.doubt.velocity_factor,
        tilt_std_rad=math.hypot(attitude.tilt_std, ready.doubt.tilt_std),
        turn_rate=attitude.turn_rate,
        late_s=ready.late_s,
        delay_s=ready.delay_s,
        range_m=math.nan if ready.range_m is None else ready.range_m[0],
        range_std_m=math.nan if ready.range_m is None else ready.range_m[1],
        rotation_wander=attitude.wander,
    )


class Core:
    """Samples in order of arrival in, outputs out; the same samples give the same outputs, bit for bit.

    ``calibrated`` is passed on to the estimates; ``telemetry`` False: a plain video, frames do not wait.
    ``by_pilot``: the pilot's switch gives the permission, as in flight, and an uncalibrated camera withholds it;
    otherwise ``landing.enabled`` and ``set_enabled`` give it.
    ``monotonic``: nobody sets the clock that stamps arrivals, as the live daemon's.
    ``fixed``: pixels (height, width) that an earlier flight found to stand still in the picture.
    """

    def __init__(
        self,
        settings: Settings,
        camera: CameraModel,
        *,
        calibrated: bool,
        telemetry: bool,
        by_pilot: bool = False,
        monotonic: bool = False,
        fixed: NDArray[np.bool_] | None = None,
    ) -> None:
        self._calibrated = calibrated
        self._method = settings.estimator.method
        self._pipeline = SurfacePipeline(
            camera, Options(settings.tracking, settings.estimator, settings.decision, settings.ground)
        )
        camera = self._camera = self._pipeline.camera
        if settings.camera.learn_mask:
            self._pipeline.find_fixed(fixed)
        self._masked = MaskWatch(camera)
        self._ground = GroundReporter(self._pipeline.ground)
        self._sync = Synchroniser(settings, telemetry, monotonic)
        self._health = HealthMonitor(settings.health, telemetry)
        self._health.calibrated = calibrated
        self._frozen = FrozenCamera(settings.health, camera)
        self._logic = DecisionLogic(
            settings,
            self._health,
            LandingArea(camera, settings.decision, settings.tracking),
            self._pipeline.ground,
            by_pilot=by_pilot,
            approach=None
            if settings.landing.procedure == "land"
            else lambda consent: Approach(settings, camera, self._pipeline.ground, consent),
        )
        self._health_period_us = round(settings.health.period_s * 1e6)
        self._health_due_us: int | None = None
        self._stale: frozenset[str] = frozenset()
        self._attitudes = FramesAttitude()
        self._recurring = RecurringEvents()
        self._frame_number: int | None = None
        self._seen: tuple[int, int] | None = None
        """Time of the newest processed frame, and when it was processed."""
        self._times = CameraTimes(self._pipeline.time_offset, self._sync.offset_us * 1e-6)

    def set_enabled(self, enabled: bool) -> None:
        """The user's permission to land; taking it back and giving it again allows another request."""
        self._logic.set_enabled(enabled, self._sync.now_us)

    def hold(self) -> None:
        """The autopilot is being asked for hold, by us."""
        self._logic.hold()

    def set_decision(self, options: DecisionOptions) -> None:
        """Other limits of the decision from now on."""
        self._pipeline.options = replace(self._pipeline.options, decision=options)
        self._pipeline.ground.limit(options.max_inclination_deg, options.sigmas)
        self._logic.set_decision(options, LandingArea(self._camera, options, self._pipeline.options.tracking))

    def under_way(self) -> tuple[Disc, Disc]:
        """The ground map's answer, see ``GroundBelow``."""
        return self._pipeline.ground.under_way()

    @property
    def fixed(self) -> NDArray[np.bool_] | None:
        """Pixels (height, width) found to stand still in the picture; None where they are not looked for."""
        found = self._pipeline.fixed
        return None if found is None else found.mask

    def set_standing(self, conditions: tuple[Condition, ...]) -> None:
        """Conditions that stand outside of the core (recording, clock, two vehicles), until others are set."""
        self._health.standing = conditions

    @property
    def waiting(self) -> bool:
        """Whether a frame waits for the attitude behind its exposure."""
        return self._sync.waiting

    def feed(self, sample: Sample) -> list[Output]:
        """Take one sample; returns what came of it, in order."""
        out: list[Output] = []
        ready, notices = self._sync.feed(sample)
        self._count(sample, out)
        for notice in notices:
            self._report(notice, out)
        for frame in ready:
            self._process(frame, out)
        if isinstance(sample, Followed):
            out += self._logic.follow(sample, self._sync.now_us, self._sync.raw_us())
        elif isinstance(sample, Velocity):
            self._logic.locate(sample.position_ned, self._sync.now_us)
        self._tick(out)
        return self._recurring.step(out, self._sync.now_us)

    def tick(self, now_us: int) -> list[Output]:
        """Time passed without a sample: frames that waited long enough are processed, silence is reported."""
        out: list[Output] = []
        for frame in self._sync.tick(now_us):
            self._process(frame, out)
        self._tick(out)
        return self._recurring.step(out, self._sync.now_us)

    def finish(self) -> list[Output]:
        """End of the input: frames still waiting are processed, the last state is reported."""
        out: list[Output] = []
        for frame in self._sync.flush("end_of_input"):
            self._process(frame, out)
        if self._health_due_us is not None:
            self._report_health(out)
            out += self._logic.decide(self._sync.now_us, self._sync.raw_us(), always=True)
        now_us = self._sync.now_us
        return [*self._recurring.step(out, now_us), *self._recurring.finish(now_us)]

    def _count(self, sample: Sample, out: list[Output]) -> None:
        refusals = self._sync.refusals()
        if not refusals:
            self._health.count(sample, self._sync.now_us)
        if isinstance(sample, Refusal):
            second = sample.reason is RefusalCode.SECOND_VEHICLE
            if second and self._health.second_vehicle(self._sync.now_us):
                out.append(event("second_vehicle", None, sample.arrival_us, details={"heard": sample.detail}))
        elif isinstance(sample, Frame):
            self._frame_number = sample.number
        for name, reason in refusals:
            self._health.refuse(name, reason)
            if isinstance(sample, Frame):
                self._no_estimate(sample, sample.stamp_us - self._sync.offset_us, reason, out)

    def _no_estimate(self, frame: Frame, exposure_us: int, reason: str, out: list[Output]) -> None:
        """An estimate that says why there is none."""
        estimate = SurfaceEstimate(frame.number, exposure_us * 1e-6, reason, self._method)
        out.append(estimate_message(estimate, exposure_us, None, self._calibrated))
        self._health.counters[f"estimates {reason}"] += 1

    def _process(self, ready: ReadyFrame, out: list[Output]) -> None:
        frame, attitude = ready.frame, ready.attitude
        height, width = frame.image.shape
        asked = self._camera.width, self._camera.height
        right = (width, height) == asked
        self._health.wrong_size = (
            "" if right else f"pictures are {width} x {height}, not {asked[0]} x {asked[1]}"
        )
        if not right:
            self._health.refuse("frames", RefusalCode.IMAGE_SIZE)
            self._no_estimate(frame, ready.exposure_us, "image_size", out)
            return
        if not isinstance(attitude, BodyAttitude):
            self._health.counters[f"frames without attitude: {attitude}"] += 1
        observation = observation_of(ready)
        self._watch_attitude(ready, out)
        estimate = self._pipeline.step(observation)
        self._sync.allow_for(self._pipeline.time_offset.late_s, self._pipeline.time_offset.std_s)
        self._watch_contradictions(ready, out)
        out += self._masked.step(frame.number, ready.exposure_us)
        if self._watch_picture(observation, ready, out):
            self._pipeline.ground.forget()
            estimate = SurfaceEstimate(frame.number, estimate.time_s, "camera_frozen", estimate.method)
        self._health.counters[f"estimates {estimate.status}"] += 1
        boot_s = None if ready.boot_us is None else ready.boot_us * 1e-6
        out.append(estimate_message(estimate, ready.exposure_us, boot_s, self._calibrated))
        out.append(Processed(frame, estimate, self._camera.mask))
        out += self._ground.step(estimate, ready.exposure_us, boot_s)
        self._seen = ready.time_us, self._sync.now_us
        out += self._logic.see(estimate, self._sync.now_us, ready.exposure_us, observation.ned_from_body)

    def _watch_attitude(self, ready: ReadyFrame, out: list[Output]) -> None:
        """Report when frames begin to lack an attitude, and when they have one again."""
        changed = self._attitudes.step(ready.attitude)
        self._health.attitude_missing = self._attitudes.missing
        if changed:
            out.append(event(changed, ready.frame.number, ready.exposure_us, self._attitudes.missing))

    def _watch_contradictions(self, ready: ReadyFrame, out: list[Output]) -> None:
        """Report which comparison of images and vehicle begins to fail, and when none does any more."""
        failing = tuple(str(status) for status in self._pipeline.contradictions.failing)
        before, self._health.contradictions = self._health.contradictions, failing
        for name in failing:
            if name not in before:
                out.append(event(name, ready.frame.number, ready.exposure_us))
        if before and not failing:
            out.append(event("motion_agrees", ready.frame.number, ready.exposure_us))

    def _watch_picture(self, seen: Observation, ready: ReadyFrame, out: list[Output]) -> bool:
        """Whether the camera is frozen, as far as the attitude shows it; changes are reported."""
        if seen.ned_from_body is None:
            return self._frozen.frozen
        before = self._frozen.frozen
        frozen = self._frozen.step(seen.time_s, seen.image, seen.ned_from_body)
        if frozen != before:
            self._health.camera_frozen = frozen
            out.append(event("camera_frozen" if frozen else "camera_moves", seen.frame, ready.exposure_us))
        return frozen

    def _report(self, notice: Notice, out: list[Output]) -> None:
        if notice.name == "autopilot_rebooted":
            out += self._logic.forget_autopilot(self._sync.raw_us())
        if notice.name in ("autopilot_rebooted", "clock_corrected", "clock_jump_taken_back"):
            self._pipeline.time_offset.loosen()
        text = ""
        if notice.name == "link_late":
            late_s, spells = notice.details["late_s"], notice.details["spells"]
            text = f"telemetry came up to {late_s:.2f} s late over this link, {spells} times"
        out.append(event(notice.name, self._frame_number, self._sync.raw_us(), text, notice.details))

    def _tick(self, out: list[Output]) -> None:
        """Health, and the decision while no frames come, at their rate of sample time."""
        now_us, period_us = self._sync.now_us, self._health_period_us
        if now_us == 0:
            return
        if self._health.second_vehicle_gone(now_us):
            out.append(event("second_vehicle_gone", None, self._sync.raw_us()))
        if self._seen is not None:
            time_us, seen_us = self._seen
            out += self._logic.watch(now_us, self._sync.raw_us(), (time_us + now_us - seen_us) * 1e-6)
        if self._health_due_us is None:
            self._health_due_us = now_us + period_us
        if now_us < self._health_due_us:
            return
        self._health_due_us += period_us * (1 + (now_us - self._health_due_us) // period_us)
        self._report_health(out)
        if self._health.state("frames", now_us) != "ok":
            out += self._logic.no_frames(now_us, self._sync.raw_us())

    def _report_health(self, out: list[Output]) -> None:
        now_us, raw_us, clock = self._sync.now_us, self._sync.raw_us(), self._sync.clock
        doubt = self._sync.doubt.at(now_us)
        self._health.velocity_unknown, self._health.tilt_unaided = not doubt.velocity_known, doubt.unaided
        stale = frozenset(self._health.stale(now_us)) if self._health.telemetry else frozenset()
        for name in sorted(stale ^ self._stale):
            kind, what = ("input_stale", "stopped") if name in stale else ("input_back", "back")
            if self._health.state(name, now_us) == "missing":
                what = "none came yet"
            out.append(event(kind, self._frame_number, raw_us, f"{_words(name)}: {what}", {"input": name}))
        self._stale = stale
        clocks = Clocks()
        if clock.settled:
            found = self._pipeline.time_offset
            offset_s = clock.offset_us(clock.boot_us(now_us)) * 1e-6
            contradicted = bool(self._pipeline.contradictions.failing)
            out += self._times.step(now_us * 1e-6, self._frame_number, raw_us, contradicted)
            late_std_s = None if found.at_bound else found.std_s
            clocks = Clocks(offset_s, clock.std_s, found.late_s, late_std_s, *self._times.readout)
        self._health.masked = self._masked.share
        self._health.readout_unknown = self._health.telemetry and self._times.readout_unknown
        out.append(self._health.message(now_us, raw_us, clocks))


def _words(name: str) -> str:
    return name.replace("_", " ")
