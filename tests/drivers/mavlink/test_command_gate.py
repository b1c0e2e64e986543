"""The gate between MAVSDK and the vehicle: what passes, what ends it, and that nothing opens it again by itself."""

import math

import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from drivers.mavlink.command_gate import CommandGate
from drivers.mavlink.framing import FrameSplitter, WireFrame
from drivers.samples import CurrentMode, Heartbeat, StatusText

VELOCITY_AND_YAW = 0b0000_1001_1100_0111
GUIDED = frozenset({"GUIDED"})
CODEC = dialect.MAVLink(None, 1, 191)


def framed(message: object) -> WireFrame:
    (frame,) = FrameSplitter().feed(bytes(message.pack(CODEC)))
    return frame


def setpoint(v=(0.5, 0.0, 0.2), mask: int = VELOCITY_AND_YAW, axes: int = 1, yaw: float = 1.0) -> WireFrame:
    return framed(
        dialect.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, axes, mask, 0, 0, 0, *v, 0, 0, 0, yaw, 0
        )
    )


def command(number: int) -> WireFrame:
    return framed(dialect.MAVLink_command_long_message(1, 1, number, 0, 0, 0, 0, 0, 0, 0, 0))


def beat(mode: str = "GUIDED", armed: bool = True, status: int = 4) -> Heartbeat:
    return Heartbeat(0, armed, mode, "ardupilot", status)


class Clock:
    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def gate(clock: Clock) -> CommandGate:
    gate = CommandGate(clock)
    gate.saw(beat())
    assert gate.expect("GUIDED", GUIDED)
    gate.open(2.0, 0.5)
    return gate


def test_it_is_shut_until_it_is_opened() -> None:
    gate = CommandGate()
    gate.open(2.0, 0.5)
    assert gate.refusal(setpoint()) == "shut"
    assert not gate.renew()


def test_velocities_within_the_limit_pass_and_nothing_else_that_flies(gate: CommandGate) -> None:
    assert gate.refusal(setpoint((1.2, -1.2, 1.0))) == ""
    assert gate.refusal(setpoint((1.5, 0.0, 1.5))) == "too_fast"
    assert gate.refusal(setpoint((math.nan, 0.0, 0.0))) == "too_fast"
    assert gate.refusal(setpoint(yaw=math.nan)) == "too_fast"
    assert gate.refusal(setpoint(mask=0b0000_1001_1111_1000)) == "not_a_velocity"
    assert gate.refusal(setpoint(axes=8)) == "not_a_velocity"
    attitude = dialect.MAVLink_set_attitude_target_message(0, 1, 1, 0, [1, 0, 0, 0], 0, 0, 0, 0.5)
    assert gate.refusal(framed(attitude)) == "no_use"
    override = dialect.MAVLink_rc_channels_override_message(1, 1, *[1500] * 8)
    assert gate.refusal(framed(override)) == "no_use"


@pytest.mark.parametrize(
    ("said", "why"),
    [
        (beat("LOITER"), "mode_left"),
        (CurrentMode(0, "POSCTL", ""), "mode_left"),
        (beat(status=5), "failsafe"),
        (StatusText(0, 6, "Pilot took over using sticks"), "pilot"),
    ],
)
def test_the_vehicles_own_word_ends_it_for_good(
    gate: CommandGate, clock: Clock, said: object, why: str
) -> None:
    gate.saw(said)
    assert gate.refusal(setpoint()) == why
    gate.saw(beat())
    gate.open(2.0, 0.5)
    assert not gate.renew()
    assert gate.refusal(setpoint()) == why
    for number in (dialect.MAV_CMD_DO_SET_MODE, dialect.MAV_CMD_NAV_LAND):
        assert gate.refusal(command(number)) == why, "MAVSDK repeats an unanswered command"
    assert gate.refusal(command(dialect.MAV_CMD_REQUEST_MESSAGE)) == ""
    assert not gate.expect(None, GUIDED, after=True), "what comes after it ends with it"
    assert gate.expect("GUIDED", GUIDED), "another order begins anew"
    assert gate.refusal(setpoint()) == "shut"


def test_disarming_ends_setpoints(gate: CommandGate) -> None:
    gate.saw(beat(armed=False))
    assert gate.refusal(setpoint()) == "shut"
    assert not gate.renew()


def test_an_order_that_is_not_renewed_lapses_and_a_fresh_one_goes_on(gate: CommandGate, clock: Clock) -> None:
    clock.now_s = 0.5
    assert gate.refusal(setpoint()) == ""
    clock.now_s = 0.51
    assert gate.refusal(setpoint()) == "order_too_old", "the pipeline hangs, MAVSDK goes on"
    assert gate.renew()
    assert gate.refusal(setpoint()) == ""


def test_an_order_is_void_in_another_mode_than_it_was_given_in() -> None:
    gate = CommandGate()
    gate.saw(beat("LOITER"))
    assert not gate.expect("GUIDED", GUIDED)
    assert gate.refusal(command(dialect.MAV_CMD_DO_SET_MODE)) == "mode_left"


def test_once_the_goal_was_reached_the_mode_before_is_a_takeover() -> None:
    gate = CommandGate()
    gate.saw(beat("LOITER"))
    assert gate.expect("LOITER", GUIDED)
    gate.open(2.0, 0.5)
    gate.saw(beat("LOITER"))
    assert gate.refusal(setpoint()) == ""
    gate.saw(beat("GUIDED"))
    gate.saw(beat("LOITER"))
    assert gate.refusal(setpoint()) == "mode_left"


STEPS = st.one_of(
    st.tuples(
        st.just("saw"), st.sampled_from(["GUIDED", "LOITER", "LAND"]), st.booleans(), st.sampled_from([4, 5])
    ),
    st.tuples(st.just("expect"), st.sampled_from(["GUIDED", "LOITER", None])),
    st.tuples(st.sampled_from(["open", "renew", "shut"])),
    st.tuples(st.just("wait"), st.floats(0.0, 1.0)),
)


@examples(200)
@given(st.lists(STEPS, max_size=30), st.floats(0.0, 4.0))
def test_in_no_order_of_things_does_a_setpoint_pass_that_should_not(steps: list[tuple], speed: float) -> None:
    """Open, ordered lately, in the mode that the order was for, within the limit, and nothing said against it since."""
    clock = Clock()
    gate = CommandGate(clock)
    mode, sound, opened, ordered_s = None, False, False, -math.inf
    allowed: frozenset[str] = frozenset()
    for name, *about in steps:
        if name == "saw":
            mode, armed, status = about
            gate.saw(beat(mode, armed, status))
            sound = sound and status == 4 and mode in allowed
            opened = opened and armed and sound
            if mode == "GUIDED":
                allowed = GUIDED
        elif name == "expect":
            allowed = GUIDED if about[0] is None or mode == "GUIDED" else GUIDED | {about[0]}
            sound = gate.expect(about[0], GUIDED)
            assert sound == (mode is None or mode in GUIDED | {about[0]})
            opened = False
        elif name == "wait":
            clock.now_s += about[0]
        elif name == "shut":
            gate.shut()
            opened = False
        elif name == "open":
            gate.open(2.0, 0.5)
            opened = opened or sound
            ordered_s = clock.now_s if opened else ordered_s
        elif gate.renew():
            ordered_s = clock.now_s
        passes = gate.refusal(setpoint((speed, 0.0, 0.0))) == ""
        assert passes == (opened and sound and clock.now_s - ordered_s <= 0.5 and speed <= 2.0)
