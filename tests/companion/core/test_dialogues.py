"""Dialogues with a real ArduCopter and a real PX4, replayed against the permission and the command's state."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

import pytest
from places import REPOSITORY
from pymavlink.dialects.v20 import ardupilotmega as dialect
from vehicle_support import tlog_frames

from companion.core.command import NAV_LAND, Command, CommandState
from companion.core.decision_logic import DecisionLogic, Followed
from companion.core.health import HealthMonitor
from companion.messages.messages import Event
from companion.settings.settings import LandingSettings, Settings
from drivers.mavlink.telemetry import TelemetryDecoder
from drivers.samples import (
    Attitude,
    CommandAnswer,
    Frame,
    Heartbeat,
    LandedState,
    RcChannels,
    Sample,
    SystemStatus,
)

DIALOGUES = REPOSITORY / "tests" / "data" / "dialogues"
SWITCH = LandingSettings(enable_rc_channel=7)
OURS = 191
Edit = Callable[[float, Sample], Iterable[Sample]]


def unedited(at_s: float, sample: Sample) -> Iterable[Sample]:
    return (sample,)


@dataclass
class Story:
    """What was reported at which second of the file."""

    events: list[tuple[float, str]] = field(default_factory=list)
    free: list[tuple[float, float]] = field(default_factory=list)
    """Spans in which a fit surface would have been landed on."""

    def named(self, beginning: str) -> list[tuple[float, str]]:
        return [(at_s, name) for at_s, name in self.events if name.startswith(beginning)]


def messages(name: str) -> Iterator[tuple[float, int, object]]:
    parser = dialect.MAVLink(None)
    start_us = None
    for stamp_us, frame in tlog_frames(DIALOGUES / f"{name}.tlog"):
        start_us = stamp_us if start_us is None else start_us
        yield (stamp_us - start_us) * 1e-6, stamp_us, parser.decode(bytearray(frame))


def replayed(name: str, landing: LandingSettings = SWITCH, edit: Edit = unedited) -> Story:
    """What the decision logic sees: our own requests and holds as they were sent, camera and attitude always well."""
    settings = Settings(landing=landing)
    health = HealthMonitor(settings.health, True)
    logic, story, decoder = (
        DecisionLogic(settings, health, by_pilot=True),
        Story(),
        TelemetryDecoder(1, 1, OURS),
    )
    for at_s, now_us, message in messages(name):
        if message.get_srcComponent() == OURS:
            if message.get_type() == "COMMAND_LONG" and message.command == NAV_LAND:
                logic._command.request(now_us)
                logic._consent.permission.use()
            elif message.get_type() == "COMMAND_LONG" and message.command == dialect.MAV_CMD_DO_SET_MODE:
                logic.hold()
            continue
        samples = [s for sample in decoder.decode(message, now_us) for s in edit(at_s, sample)]
        health.count(Frame(0, now_us, now_us, None), now_us)
        health.count(Attitude(now_us, now_us, 0, 0, 0), now_us)
        for sample in samples:
            health.count(sample, now_us)
            if isinstance(sample, Followed):
                out = logic.follow(sample, now_us, now_us)
                story.events += [(round(at_s, 2), o.event) for o in out if isinstance(o, Event)]
        if not logic._consent.objections(now_us, command_busy=logic._command.busy):
            last = story.free[-1][1] if story.free else -1.0
            if at_s - last > 0.5:
                story.free.append((at_s, at_s))
            story.free[-1] = (story.free[-1][0], at_s)
    return story


def names(story: Story) -> list[str]:
    wanted = ("accepted", "started", "landed", "held", "failsafe", "taken_over", "failed")
    return [n for _, name in story.events if (n := name.removeprefix("landing_")) in wanted]


@pytest.mark.parametrize(
    "name", ["px4_stairs_landed", "ardupilot_stairs_landed", "ardupilot_stream_rates_taken"]
)
def test_a_landing_is_followed_to_the_ground(name: str) -> None:
    story = replayed(name)
    assert names(story) == ["accepted", "started", "landed"]
    assert len(story.named("landing_enabled")) == 1
    assert len(story.free) == 1


def test_a_failsafes_hold_is_not_broken_by_a_switch_turned_on_meanwhile() -> None:
    story = replayed("px4_failsafe_hold_cancelled")
    assert not story.named("landing_enabled")
    assert story.free == []


def test_each_end_of_a_landing_is_reported_as_what_it_was() -> None:
    story = replayed("px4_hold_three_times")
    assert names(story) == ["accepted", "started", "held"] * 2 + ["accepted", "started", "taken_over"] + [
        "accepted",
        "started",
        "held",
    ]
    ends = [at_s for at_s, name in story.events if name in ("landing_held", "landing_taken_over")]
    assert ends == pytest.approx([33.97, 48.57, 75.57, 95.37], abs=0.05)


def test_in_px4s_modes_only_the_allowed_ones_are_free() -> None:
    landing = LandingSettings(enabled=True, allowed_modes=("HOLD",))
    free = replayed("px4_modes", landing).free
    assert free
    modes: dict[float, str] = {}
    decoder = TelemetryDecoder(1, 1, OURS)
    for at_s, now_us, message in messages("px4_modes"):
        for sample in decoder.decode(message, now_us):
            if isinstance(sample, Heartbeat):
                modes[at_s] = sample.mode
    for at_s, mode in modes.items():
        inside = any(begin + 1.1 < at_s < end - 0.1 for begin, end in free)
        assert not inside or mode == "HOLD"


def test_a_lost_radio_ends_the_permission_though_the_channels_go_on() -> None:
    story = replayed("ardupilot_radio_lost_rssi255")
    enabled, disabled = story.named("landing_enabled"), story.named("landing_disabled")
    assert [at_s for at_s, _ in enabled] == pytest.approx([8.27], abs=0.1)
    assert [at_s for at_s, _ in disabled][-1] == pytest.approx(12.23, abs=0.05)
    assert [round(b, 1) for _, b in story.free] == pytest.approx([12.2], abs=0.1)


def test_a_lost_radio_without_a_failsafe_ends_it_by_system_status() -> None:
    lost_s = 12.0

    def with_status(at_s: float, sample: Sample) -> Iterable[Sample]:
        """SYS_STATUS was not asked for then; as the autopilot would have sent it."""
        if isinstance(sample, RcChannels):
            yield SystemStatus(sample.arrival_us, True, True, at_s < lost_s)
        yield sample

    free = replayed("ardupilot_radio_lost_no_failsafe", edit=with_status).free
    assert free
    assert free[-1][1] == pytest.approx(lost_s, abs=0.5)


def test_after_a_takeover_there_is_silence_until_the_switch_was_turned_off_and_on() -> None:
    story = replayed("ardupilot_pilot_takes_over")
    taken = [at_s for at_s, name in story.events if name == "landing_taken_over"]
    assert taken == pytest.approx([18.57, 83.99], abs=0.02)
    renewed = [at_s for at_s, _ in story.named("landing_enabled")]
    for end_s in taken:
        again = min((at_s for at_s in renewed if at_s > end_s), default=1e9)
        assert not [span for span in story.free if span[1] > end_s and span[0] < again - 0.01]
    assert names(story)[-1] == "landed"


def test_our_own_hold_is_reported_as_that() -> None:
    story = replayed("ardupilot_hold_on_unfit")
    assert names(story) == ["accepted", "started", "held"]


def test_a_takeover_into_the_enabling_mode_is_followed_by_silence() -> None:
    """PX4, a joystick: not recorded, built from a description of it."""
    settings = Settings(landing=LandingSettings(enable_modes=("POSCTL",)))
    health = HealthMonitor(settings.health, True)
    logic = DecisionLogic(settings, health, by_pilot=True)
    now_us = 1_000_000_000

    def see(*samples: Sample) -> list[str]:
        nonlocal now_us
        now_us += 500_000
        reported = []
        for sample in (Frame(0, now_us, now_us, None), Attitude(now_us, now_us, 0, 0, 0), *samples):
            health.count(sample, now_us)
            if isinstance(sample, Followed):
                reported += [o.event for o in logic.follow(sample, now_us, now_us) if isinstance(o, Event)]
        return reported

    def beat(mode: str, armed: bool = True) -> Heartbeat:
        return Heartbeat(now_us, armed, mode, "px4", 4)

    def free() -> bool:
        return not logic._consent.objections(now_us, command_busy=logic._command.busy)

    air = LandedState(0, "in_air")
    see(beat("ALTCTL"), air)
    see(beat("POSCTL"), air)
    assert free()
    logic._consent.permission.use()
    logic._command.request(now_us)
    see(CommandAnswer(now_us, NAV_LAND, "ACCEPTED"), beat("LAND"), LandedState(now_us, "landing"))
    assert "landing_taken_over" in see(beat("POSCTL"), air)
    for step in (beat("POSCTL"), beat("POSCTL", armed=False), beat("LAND"), beat("POSCTL"), beat("POSCTL")):
        see(step, air)
        assert not free()
    see(beat("ALTCTL"), air)
    see(beat("POSCTL"), air)
    assert free()


def test_a_reboot_ends_the_permission_though_the_switch_stays_on() -> None:
    def on(at_s: float, sample: Sample) -> Iterable[Sample]:
        if isinstance(sample, RcChannels) and at_s > 2.0:
            pulses = list(sample.pulse_us)
            pulses[SWITCH.enable_rc_channel - 1] = 2000
            sample = RcChannels(sample.arrival_us, tuple(pulses))
        return (sample,)

    story = replayed("ardupilot_reboot", edit=on)
    assert [end < 18.0 for _, end in story.free] == [True]
    assert len(story.named("landing_enabled")) == 1


def test_a_reboot_ends_the_command_and_forgets_it() -> None:
    state = CommandState()
    state.request(0)
    assert [change.code for change in state.reboot(1)] == [Command.REBOOTED]
    assert state.reboot(2) == []
