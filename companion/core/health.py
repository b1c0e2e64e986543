"""How the inputs fare: counts, rates, ages and refusals, and what is wrong in words."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from companion.messages.conditions import Code, Condition, condition, gravest_first, state_of
from companion.messages.messages import Health, InputHealth
from companion.settings.settings import HealthSettings
from drivers.refusals import SECOND_GONE_S, RefusalCode
from drivers.samples import (
    Attitude,
    ClockOffset,
    CommandAnswer,
    CurrentMode,
    Distance,
    EstimatorReport,
    Frame,
    Heartbeat,
    Imu,
    LandedState,
    ManualControl,
    RcChannels,
    Refusal,
    Sample,
    StatusText,
    SystemStatus,
    SystemTime,
    Velocity,
)

INPUTS: dict[type, str] = {
    Frame: "frames",
    Attitude: "attitude",
    Imu: "gyro",
    Velocity: "velocity",
    Distance: "distance",
    Heartbeat: "heartbeat",
    LandedState: "landed_state",
    CurrentMode: "current_mode",
    EstimatorReport: "estimator",
    SystemStatus: "system_status",
    SystemTime: "system_time",
    StatusText: "status_text",
    ManualControl: "manual_control",
    RcChannels: "rc_channels",
    ClockOffset: "timesync",
    CommandAnswer: "command_answers",
}
"""Sample type -> the input's name in Health."""

SOURCES = {
    "camera": "frames",
    "frames.csv": "frames",
    "ATTITUDE": "attitude",
    "ATTITUDE_QUATERNION": "attitude",
    "RAW_IMU": "gyro",
    "SCALED_IMU": "gyro",
    "SCALED_IMU2": "gyro",
    "SCALED_IMU3": "gyro",
    "HIGHRES_IMU": "gyro",
    "LOCAL_POSITION_NED": "velocity",
    "DISTANCE_SENSOR": "distance",
    "HEARTBEAT": "heartbeat",
    "EXTENDED_SYS_STATE": "landed_state",
    "CURRENT_MODE": "current_mode",
    "EKF_STATUS_REPORT": "estimator",
    "ESTIMATOR_STATUS": "estimator",
    "ODOMETRY": "estimator",
    "SYS_STATUS": "system_status",
    "SYSTEM_TIME": "system_time",
    "STATUSTEXT": "status_text",
    "MANUAL_CONTROL": "manual_control",
    "RC_CHANNELS": "rc_channels",
    "TIMESYNC": "timesync",
}
"""Source of a refusal -> the input it would have been."""

LARGE_MASK = 1 / 3
"""Share of the picture from which a mask leaves too little of the ground."""

NEEDED = ("frames", "attitude", "heartbeat", "landed_state")
"""Inputs without which no landing is requested."""

VITAL = ("frames", "attitude")
"""Inputs without which there is nothing to say of the surface."""


@dataclass(frozen=True, slots=True)
class Clocks:
    """How the clocks stand to each other: ``offset_s`` companion minus autopilot, ``late_s`` lateness found of the
    frames, ``readout_s`` readout found of the rows, each with its standard deviation; None where it is not known."""

    offset_s: float | None = None
    std_s: float | None = None
    late_s: float | None = None
    late_std_s: float | None = None
    readout_s: float | None = None
    readout_std_s: float | None = None


@dataclass(slots=True)
class _Input:
    count: int = 0
    refused: int = 0
    newest_us: int | None = None
    reported: int = 0


class HealthMonitor:
    """Counts every sample; all times are the steady companion time in microseconds.

    ``telemetry`` False: a plain video, of which only frames are expected.
    """

    def __init__(self, settings: HealthSettings, telemetry: bool) -> None:
        s = settings
        self._max_age_s = {
            "frames": s.frames_max_age_s,
            "attitude": s.attitude_max_age_s,
            "gyro": s.gyro_max_age_s,
            "velocity": s.velocity_max_age_s,
            "heartbeat": s.heartbeat_max_age_s,
            "landed_state": s.landed_state_max_age_s,
        }
        self._expected = tuple(self._max_age_s) if telemetry else ("frames",)
        self._inputs = {name: _Input() for name in self._expected}
        self.telemetry = telemetry
        self._early: set[str] = set()
        """Inputs counted before there was a time: they came when time begins."""
        self._start_us: int | None = None
        self._reported_us: int | None = None
        self.counters: Counter[str] = Counter()
        self.vehicles_clash = False
        self._second_us: int | None = None
        self.attitude_missing = ""
        """Why frames have no attitude, in words; empty while they have one."""
        self.camera_frozen = False
        self.contradictions: tuple[str, ...] = ()
        """Comparisons of the pictures' motion with the vehicle's that fail: statuses of an estimate."""
        self.velocity_unknown = self.tilt_unaided = False
        """What the autopilot's estimator says of itself."""
        self._heartbeat: Heartbeat | None = None
        self.wrong_size = ""
        """What size the pictures have where it is not the calibration's; empty while it is."""
        self.calibrated = True
        self.masked = 0.0
        """Share of the picture that is masked."""
        self.readout_unknown = False
        self.radio_lost = False
        self.standing: tuple[Condition, ...] = ()
        """Conditions that others found: recording, clock, two vehicles on the link."""

    def count(self, sample: Sample, now_us: int) -> None:
        """Take note of one sample."""
        if not self._start_us:
            self._start_us = now_us
        if isinstance(sample, Refusal):
            self.refuse(SOURCES.get(sample.source, sample.source), sample.reason)
            return
        if isinstance(sample, Heartbeat):
            self._heartbeat = sample
        entry = self._inputs.setdefault(INPUTS[type(sample)], _Input())
        entry.count += 1
        entry.newest_us = now_us
        if now_us == 0:
            self._early.add(INPUTS[type(sample)])

    def refuse(self, name: str, reason: RefusalCode) -> None:
        """Count a refusal of an input."""
        self.counters[f"refused {name}: {reason}"] += 1
        if name in self._inputs:
            self._inputs[name].refused += 1

    def second_vehicle(self, now_us: int) -> bool:
        """A second vehicle was heard; whether it is new."""
        new = not self.vehicles_clash
        self.vehicles_clash, self._second_us = True, now_us
        return new

    def second_vehicle_gone(self, now_us: int) -> bool:
        """Whether the second vehicle has just been silent for so long that it counts as gone."""
        last_us = self._second_us
        if last_us is None or now_us - last_us <= SECOND_GONE_S * 1e6:
            return False
        self.vehicles_clash, self._second_us = False, None
        return True

    def state(self, name: str, now_us: int) -> str:
        """Of one input: "ok", "stale", "missing" (never came)."""
        if self._early and now_us > 0:
            for early in self._early:
                if self._inputs[early].newest_us == 0:
                    self._inputs[early].newest_us = now_us
            self._early.clear()
        entry = self._inputs.get(name)
        if entry is None or entry.newest_us is None:
            return "missing"
        limit_s = self._max_age_s.get(name)
        return "stale" if limit_s is not None and now_us - entry.newest_us > limit_s * 1e6 else "ok"

    def stale(self, now_us: int) -> tuple[str, ...]:
        """Needed inputs that are stale or missing, by name."""
        return tuple(name for name in NEEDED if self.state(name, now_us) != "ok")

    def conditions(self, now_us: int, settled: bool) -> tuple[Condition, ...]:
        """What is wrong now, the gravest first; ``settled``: the clocks are related."""
        found = [*self._of_inputs(now_us), *self._constant()]
        if self.telemetry and not settled:
            found.append(condition(Code.CLOCKS_UNRELATED))
        return gravest_first(found)

    def standing_codes(self) -> frozenset[str]:
        """Codes of the conditions that stand now beside those of the inputs' ages: some forbid any landing."""
        return frozenset(c.code for c in self._constant())

    def _of_inputs(self, now_us: int) -> Iterator[Condition]:
        for name in self._expected:
            state, vital = self.state(name, now_us), name in VITAL
            newest_us = self._inputs[name].newest_us
            if state == "missing":
                yield condition(Code.VITAL_INPUT_MISSING if vital else Code.INPUT_MISSING, name)
            elif state == "stale" and newest_us is not None:
                code = Code.VITAL_INPUT_STALE if vital else Code.INPUT_STALE
                yield condition(code, name, f"{(now_us - newest_us) * 1e-6:.1f} s")

    def _constant(self) -> Iterator[Condition]:
        yield from self.standing
        if self.camera_frozen:
            yield condition(Code.CAMERA_FROZEN)
        for name in self.contradictions:
            yield condition(Code(name))
        if self.velocity_unknown:
            yield condition(Code.VELOCITY_UNKNOWN)
        elif self.tilt_unaided:
            yield condition(Code.ATTITUDE_UNSURE)
        if self.attitude_missing:
            yield condition(Code.ATTITUDE_MISSING, detail=self.attitude_missing)
        if self.vehicles_clash:
            yield condition(Code.TWO_VEHICLES)
        if self.wrong_size:
            yield condition(Code.IMAGE_SIZE, detail=self.wrong_size)
        if not self.calibrated:
            yield condition(Code.UNCALIBRATED)
        if self.masked > LARGE_MASK:
            yield condition(Code.MASK_LARGE, detail=f"{100 * self.masked:.0f} %")
        if self.readout_unknown:
            yield condition(Code.READOUT_UNKNOWN)
        if self.radio_lost:
            yield condition(Code.RADIO_LOST)

    def message(self, now_us: int, time_unix_us: int, clocks: Clocks) -> Health:
        """Health since the last call."""
        since_us = self._reported_us if self._reported_us is not None else self._start_us
        span_s = (now_us - since_us) * 1e-6 if since_us is not None else 0.0
        inputs = {}
        for name in sorted(self._inputs):
            entry = self._inputs[name]
            rate = (entry.count - entry.reported) / span_s if span_s > 0 else None
            age = None if entry.newest_us is None else max(0.0, (now_us - entry.newest_us) * 1e-6)
            inputs[name] = InputHealth(
                state=self.state(name, now_us),
                count=entry.count,
                refused=entry.refused,
                rate_hz=None if rate is None else round(rate, 2),
                age_s=None if age is None else round(age, 4),
            )
            entry.reported = entry.count
        self._reported_us = now_us
        beat = self._heartbeat if self.state("heartbeat", now_us) == "ok" else None
        conditions = self.conditions(now_us, clocks.offset_s is not None)
        return Health(
            time_unix_us=time_unix_us,
            state=state_of(conditions),
            problems=tuple(c.text for c in conditions),
            inputs=inputs,
            counters=dict(sorted(self.counters.items())),
            mode=None if beat is None else beat.mode,
            armed=None if beat is None else beat.armed,
            clock_offset_s=_rounded(clocks.offset_s),
            clock_std_s=_rounded(clocks.std_s),
            camera_late_s=_rounded(clocks.late_s),
            camera_late_std_s=_rounded(clocks.late_std_s),
            camera_readout_s=_rounded(clocks.readout_s),
            camera_readout_std_s=_rounded(clocks.readout_std_s),
            camera_masked=round(self.masked, 4),
            pipeline_ms=None,
            conditions=conditions,
        )


def _rounded(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds, 6)
