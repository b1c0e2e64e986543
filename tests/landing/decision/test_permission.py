"""The permission's states and transitions, the gate's rules, and a model of random sequences."""

from dataclasses import dataclass, replace

import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from landing.decision.permission import Gate, Permission, Phase, Position, Seen, Switch, objections
from landing.decision.withheld import WORDS, Objection, Withheld

ON, OFF, UNCLEAR = Position.ON, Position.OFF, Position.UNCLEAR
RADIO = Switch(radio=True)
MODE = Switch(modes=frozenset({"POSCTL"}))
BOTH = Switch(radio=True, modes=frozenset({"POSCTL"}))
HAND = Switch()
GOOD = Gate(armed=True, landed="in_air", mode_allowed=True)


def radio(position: Position, **change: object) -> Seen:
    return Seen(radio=position, mode="POSCTL", **change)


def mode(name: str | None, **change: object) -> Seen:
    return Seen(mode=name, **change)


def after(switch: Switch, *steps: Seen | Withheld | str) -> Permission:
    """A permission after steps; a code ends it, "use" is a request."""
    permission = Permission(switch)
    for step in steps:
        if isinstance(step, Withheld):
            permission.end(step)
        elif isinstance(step, str):
            permission.use()
        else:
            permission.step(step)
    return permission


def state(permission: Permission) -> str:
    """The phase, and the cause of a lock."""
    return permission.cause.value if permission.phase is Phase.LOCKED else permission.phase.value


STANDING = (radio(OFF), radio(ON))
BY_MODE = (mode("ALTCTL"), mode("POSCTL"))
LANDED_BY_US = (*BY_MODE, "use", mode("LAND"))

TRANSITIONS = [
    # By radio.
    (RADIO, (), "switch_not_renewed"),
    (RADIO, (radio(ON),), "switch_not_renewed"),
    (RADIO, (radio(OFF),), "off"),
    (RADIO, STANDING, "standing"),
    (RADIO, (*STANDING, radio(OFF)), "off"),
    (RADIO, (*STANDING, "use"), "used"),
    (RADIO, (*STANDING, "use", radio(ON)), "used"),
    (RADIO, (*STANDING, "use", radio(OFF)), "off"),
    (RADIO, (*STANDING, "use", radio(OFF), radio(ON)), "standing"),
    (RADIO, (*STANDING, "use", radio(ON, armed=False), radio(ON)), "used"),
    # Silence and a lost radio end it, and what comes back does not renew it.
    (RADIO, (*STANDING, radio(UNCLEAR)), "radio_lost"),
    (RADIO, (*STANDING, radio(UNCLEAR), radio(ON)), "radio_lost"),
    (RADIO, (radio(OFF), radio(UNCLEAR), radio(ON)), "mode_not_chosen"),
    (RADIO, (*STANDING, radio(ON, radio_lost=True)), "radio_lost"),
    (RADIO, (*STANDING, radio(ON, radio_lost=True), radio(OFF, radio_lost=True), radio(ON)), "radio_lost"),
    (RADIO, (*STANDING, radio(ON, radio_lost=True), radio(OFF), radio(ON)), "standing"),
    (MODE, (*BY_MODE, mode("POSCTL", radio_lost=True)), "radio_lost"),
    # Failsafes.
    (RADIO, (*STANDING, radio(ON, failsafe=True)), "failsafe"),
    (RADIO, (*STANDING, "use", radio(ON, failsafe=True), radio(ON)), "failsafe"),
    (RADIO, (radio(OFF), radio(ON, failsafe=True)), "failsafe"),
    (RADIO, (radio(OFF), radio(ON, failsafe=True), radio(ON)), "failsafe"),
    (RADIO, (radio(OFF, failsafe=True), radio(ON)), "standing"),
    (MODE, (*BY_MODE, mode("HOLD", failsafe=True), mode("HOLD"), mode("POSCTL")), "failsafe"),
    (MODE, (mode("ALTCTL"), mode("POSCTL", failsafe=True), mode("POSCTL")), "off"),
    (MODE, (mode("ALTCTL", failsafe=True), mode("POSCTL")), "switch_not_renewed"),
    (MODE, (*BY_MODE, mode("HOLD", failsafe=True), mode("ALTCTL"), mode("POSCTL")), "standing"),
    (RADIO, (*STANDING, radio(ON, failsafe=True, armed=False)), "failsafe"),
    (MODE, (mode("ALTCTL"), mode("ALTCTL", failsafe=True), mode("POSCTL")), "mode_not_chosen"),
    (MODE, (mode("ALTCTL"), mode("ALTCTL", failsafe=True), mode("ALTCTL"), mode("POSCTL")), "standing"),
    # Sticks.
    (RADIO, (*STANDING, radio(ON, sticks=(1500,)), radio(ON), radio(ON, sticks=(1800,))), "sticks_moved"),
    (RADIO, (*STANDING, radio(ON, sticks=(1500,)), radio(ON, sticks=(0,))), "standing"),
    (RADIO, (*STANDING, radio(ON, sticks=(1500,)), radio(ON, sticks=(1800,))), "sticks_moved"),
    (RADIO, (*STANDING, radio(ON, sticks=(1500,)), radio(ON, sticks=(1799,))), "standing"),
    (RADIO, (*STANDING, radio(ON, sticks=(0,)), radio(ON, sticks=(1800,))), "standing"),
    (RADIO, (*STANDING, radio(ON, sticks=(1500,)), "use", radio(ON, sticks=(1200,))), "sticks_moved"),
    (RADIO, (radio(OFF, sticks=(1500,)), radio(ON, sticks=(1900,))), "standing"),
    (
        replace(RADIO, stick_limit_us=0),
        (*STANDING, radio(ON, sticks=(1500,)), radio(ON, sticks=(1900,))),
        "standing",
    ),
    # By mode: another mode of the pilot's is off; what a command or the autopilot caused is neither.
    (MODE, (mode("POSCTL"),), "switch_not_renewed"),
    (MODE, (mode("ALTCTL"),), "off"),
    (MODE, BY_MODE, "standing"),
    (MODE, (*BY_MODE, mode("ALTCTL")), "off"),
    (MODE, LANDED_BY_US, "used"),
    (MODE, (*LANDED_BY_US, mode("POSCTL")), "used"),
    (MODE, (*LANDED_BY_US, mode("POSCTL"), Withheld.TAKEN_OVER), "taken_over"),
    (MODE, (*LANDED_BY_US, Withheld.TAKEN_OVER, mode("POSCTL"), mode("POSCTL", armed=False)), "taken_over"),
    (MODE, (*LANDED_BY_US, Withheld.TAKEN_OVER, mode("POSCTL"), *BY_MODE), "standing"),
    (MODE, (*LANDED_BY_US, Withheld.OWN_HOLD, mode("HOLD"), mode("POSCTL")), "own_hold"),
    (MODE, (*LANDED_BY_US, Withheld.OWN_HOLD, mode("HOLD"), mode("ALTCTL"), mode("POSCTL")), "standing"),
    (MODE, (*LANDED_BY_US, Withheld.OWN_HOLD, mode("ALTCTL"), mode("HOLD"), mode("POSCTL")), "standing"),
    (MODE, (*LANDED_BY_US, mode("POSCTL"), mode("POSCTL", armed=False)), "used"),
    (MODE, (*BY_MODE, mode("RTL")), "mode_not_chosen"),
    (MODE, (*BY_MODE, mode("RTL"), mode("POSCTL")), "mode_not_chosen"),
    (MODE, (mode("ALTCTL"), mode("TAKEOFF"), mode("POSCTL")), "mode_not_chosen"),
    (MODE, (*BY_MODE, mode("HOLD", intended=False)), "mode_not_chosen"),
    (MODE, (*BY_MODE, mode("HOLD", intended=False), mode("POSCTL")), "mode_not_chosen"),
    (MODE, (mode("ALTCTL"), mode("POSCTL", intended=False)), "off"),
    (MODE, (mode("ALTCTL"), mode("ALTCTL", intended=False)), "off"),
    (MODE, (mode("ALTCTL"), mode("ALTCTL", intended=False), mode("POSCTL")), "mode_not_chosen"),
    (MODE, (*LANDED_BY_US, Withheld.TAKEN_OVER, mode("HOLD"), mode("POSCTL")), "standing"),
    (MODE, (*LANDED_BY_US, Withheld.OWN_HOLD, mode("ALTCTL"), mode("POSCTL")), "standing"),
    (MODE, (mode("ALTCTL", intended=False), mode("POSCTL")), "switch_not_renewed"),
    (Switch(modes=frozenset({"HOLD"})), (mode("POSCTL"), mode("MISSION"), mode("HOLD")), "off"),
    (Switch(modes=frozenset({"HOLD"})), (mode("POSCTL"), mode("HOLD")), "standing"),
    (MODE, (*BY_MODE, mode(None)), "mode_lost"),
    (MODE, (*BY_MODE, mode(None), mode("POSCTL")), "mode_lost"),
    # Both: either is off, both are on.
    (BOTH, (Seen(radio=OFF, mode="ALTCTL"), Seen(radio=ON, mode="ALTCTL")), "off"),
    (
        BOTH,
        (Seen(radio=OFF, mode="ALTCTL"), Seen(radio=ON, mode="ALTCTL"), radio(ON)),
        "standing",
    ),
    (BOTH, (radio(OFF), radio(ON)), "standing"),
    # By hand.
    (HAND, (), "off"),
    (HAND, (Seen(hand=ON),), "standing"),
    (HAND, (Seen(hand=ON), "use", Seen(hand=OFF), Seen(hand=ON)), "standing"),
    (HAND, (Seen(hand=ON), Seen(hand=ON, failsafe=True), Seen(hand=ON)), "failsafe"),
    (HAND, (Seen(hand=ON), Seen(hand=ON, failsafe=True, armed=False)), "standing"),
    (HAND, (Seen(hand=ON, sticks=(1500,)), Seen(hand=ON, sticks=(1900,))), "standing"),
    # What ends it ends only what stands.
    (RADIO, (radio(OFF), Withheld.TAKEN_OVER), "off"),
    (RADIO, (*STANDING, Withheld.REBOOTED), "rebooted"),
    (RADIO, (*STANDING, Withheld.REBOOTED, Withheld.TAKEN_OVER), "rebooted"),
]


@pytest.mark.parametrize(("switch", "steps", "expected"), TRANSITIONS)
def test_transition(switch: Switch, steps: tuple[Seen | Withheld | str, ...], expected: str) -> None:
    assert state(after(switch, *steps)) == expected


def test_whether_it_was_used_is_kept_until_the_switch_is_off() -> None:
    permission = after(RADIO, *STANDING, "use", Withheld.TAKEN_OVER)
    assert permission.used
    permission.step(radio(OFF))
    assert not permission.used


OBJECTIONS = [
    (HAND, (), Withheld.NOT_ENABLED),
    (RADIO, (), Withheld.SWITCH_NOT_RENEWED),
    (RADIO, (radio(OFF),), Withheld.SWITCH_OFF),
    (RADIO, STANDING, None),
    (RADIO, (*STANDING, "use"), Withheld.ALREADY_REQUESTED),
    (RADIO, (*STANDING, Withheld.TAKEN_OVER), Withheld.TAKEN_OVER),
]


@pytest.mark.parametrize(("switch", "steps", "code"), OBJECTIONS)
def test_what_the_permission_objects(switch, steps, code) -> None:
    found = after(switch, *steps).objection
    assert found == (None if code is None else Objection(code))


RULES = [
    ({"armed": False}, "vehicle not armed"),
    ({"armed": None}, "not known whether armed"),
    ({"landed": "on_ground"}, "vehicle not in the air"),
    ({"landed": "takeoff"}, "vehicle taking off"),
    ({"landed": "landing"}, "vehicle landing already"),
    ({"landed": "undefined"}, "not known whether in the air"),
    ({"landed": None}, "not known whether in the air"),
    ({"mode_allowed": False}, "flight mode not allowed"),
    ({"mode_allowed": None}, "flight mode unknown"),
    ({"failsafe": True, "ready": False}, "the autopilot is in a failsafe"),
    ({"ready": False}, "the autopilot is neither standing by nor active"),
    ({"radio_lost": True}, "the radio is lost"),
    ({"vehicle": "fixed_wing"}, "no multicopter or helicopter: fixed_wing"),
    ({"vehicle": "vtol"}, "the VTOL is not known to hover"),
    ({"stale": ("attitude", "frames")}, "stale inputs: attitude, frames"),
    ({"attitude_missing": True}, "the frames have no attitude"),
    ({"two_vehicles": True}, "two vehicles on the link, set vehicle.system_id"),
    ({"calibrated": False}, "the camera is not calibrated"),
    ({"command_busy": True}, "a command is under way"),
]


@pytest.mark.parametrize(("change", "words"), RULES)
def test_each_rule_of_the_gate_withholds_by_itself_and_says_so(change: dict, words: str) -> None:
    found = objections(after(RADIO, *STANDING), replace(GOOD, **change))
    assert [str(objection) for objection in found] == [words]


OPEN = [
    {},
    {"vehicle": "vtol_hovering"},
    {"vehicle": None},
    {"vehicle": "fixed_wing", "allowed_vehicles": frozenset({"fixed_wing"})},
    {"failsafe": None, "ready": None},
]


@pytest.mark.parametrize("change", OPEN)
def test_the_gate_is_open(change: dict) -> None:
    assert objections(after(RADIO, *STANDING), replace(GOOD, **change)) == ()


def test_every_rule_that_stands_against_it_is_reported() -> None:
    bad = Gate(None, None, None, stale=("attitude",), command_busy=True)
    assert len(objections(Permission(HAND), bad)) == 6


def test_every_code_has_its_words_and_they_differ() -> None:
    assert set(WORDS) == set(Withheld)
    assert len(set(WORDS.values())) == len(WORDS)
    assert all(len(words) <= 80 for words in WORDS.values())


# A model: random lives of a vehicle, a switch and a request wherever the gate is open.

MODES = ("POSCTL", "ALTCTL", "HOLD", "LAND", "RTL", "TAKEOFF", "MISSION")
ACTS = st.one_of(
    st.tuples(st.just("radio"), st.sampled_from([ON, OFF, UNCLEAR])),
    st.tuples(st.just("mode"), st.sampled_from(MODES)),
    st.tuples(st.just("failsafe"), st.booleans()),
    st.tuples(st.just("radio_lost"), st.booleans()),
    st.tuples(st.just("armed"), st.booleans()),
    st.tuples(st.just("end"), st.sampled_from([Withheld.TAKEN_OVER, Withheld.OWN_HOLD, Withheld.REBOOTED])),
    st.tuples(st.just("intended"), st.booleans()),
)


@dataclass
class Model:
    """What the invariants need to know, kept apart from the machine."""

    off_since_request: bool = True
    off_since_end: bool = False


@examples(150)
@given(st.sampled_from([RADIO, MODE, BOTH]), st.lists(ACTS, max_size=40))
def test_invariants_of_any_life(switch: Switch, acts: list[tuple[str, object]]) -> None:
    permission, seen, model = Permission(switch), Seen(radio=UNCLEAR), Model()
    before = permission.phase
    for name, value in acts:
        if name == "end":
            standing = permission.phase in (Phase.STANDING, Phase.USED)
            permission.end(value)
            if standing:
                model.off_since_end = False
        else:
            seen = replace(seen, **{name: value})
            permission.step(seen)
        chosen = seen.mode in ("ALTCTL", "HOLD", "MISSION") and not seen.failsafe and seen.intended
        radio_off = switch.radio and seen.radio is OFF and not seen.radio_lost
        if permission.phase is Phase.OFF and before is not Phase.OFF:
            assert radio_off or (switch.modes and chosen), "off is what the pilot turned off"
            model.off_since_request = model.off_since_end = True
        if seen.failsafe or seen.radio_lost:
            model.off_since_end = model.off_since_end and permission.phase is Phase.OFF
        on = (not switch.radio or seen.radio is ON) and (not switch.modes or seen.mode == "POSCTL")
        if permission.phase is Phase.STANDING:
            assert on
            assert not seen.failsafe
            assert not seen.radio_lost
        gate = replace(GOOD, armed=seen.armed, failsafe=seen.failsafe, radio_lost=seen.radio_lost)
        if not objections(permission, gate):
            assert seen.armed
            assert model.off_since_request, "at most one request a permission"
            assert model.off_since_end, "silence after a takeover, a failsafe, a lost radio"
            permission.use()
            model.off_since_request = False
        before = permission.phase
