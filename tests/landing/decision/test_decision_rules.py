"""Every rule of the decision logic by itself: verdict, consent and procedure are given, the command is the real one."""

import math
from dataclasses import replace
from types import SimpleNamespace

import msgspec
import pytest
from estimates import FLAT

from companion.core.approach import Ordered
from companion.core.decision_logic import DecisionLogic, LandRequest
from companion.core.health import HealthMonitor
from companion.messages.events import event
from companion.messages.messages import Decision, Event, ProcedureState
from companion.settings.settings import LandingSettings, Settings
from drivers.samples import CommandAnswer, Heartbeat
from landing.decision.decision import Verdict
from landing.decision.orders import Order, OrderKind
from landing.decision.permission import Phase
from landing.decision.withheld import Objection, Withheld
from landing.reasons import Code, Reason

US = 1_000_000_000
FIT = Verdict("fit", (), 0.0, False)
STEEP = Verdict("unfit", (Reason(Code.TOO_ROUGH, value=0.1, limit=0.02),), 0.0, True)


class GivenPermission:
    """What the logic asks of a permission, and what it makes of it."""

    def __init__(self):
        self.phase, self.used, self.ended = Phase.STANDING, False, []

    def use(self):
        self.phase, self.used = Phase.USED, True

    def end(self, code):
        self.phase = Phase.LOCKED
        self.ended.append(code)


class GivenConsent:
    """A pilot who consents, until he is made to object."""

    def __init__(self):
        self.permission = GivenPermission()
        self.vehicle = SimpleNamespace(failsafe=False, pilot_took_over=False)
        self.radio_lost = False
        self.against_enabling = ""
        self.against = ()
        self.rebooted = False

    def set_enabled(self, enabled, now_us):
        self.permission.phase = Phase.STANDING if enabled else Phase.OFF

    def feed(self, sample, now_us):
        """Nothing of a sample matters here."""

    def reboot(self):
        self.rebooted = True

    def objections(self, now_us, *, command_busy):
        return (*self.against, *((Objection(Withheld.COMMAND_UNDER_WAY),) if command_busy else ()))


class GivenApproach:
    """A landing procedure that orders what it is given."""

    def __init__(self, kind="landing_target"):
        self.kind, self.state, self.orders, self.busy, self.located = kind, None, [], [], []

    def see(self, estimate, yaw, now_us, time_unix_us, *, busy):
        self.busy.append(busy)
        return list(self.orders)

    def watch(self, frame, now_us, time_unix_us, time_s):
        return list(self.orders)

    def locate(self, position_ned, now_us):
        self.located.append(position_ned)


def logic(by_pilot=False, approach=None, calibrated=True):
    settings = Settings(landing=LandingSettings(enabled=True))
    health = HealthMonitor(settings.health, True)
    health.calibrated = calibrated
    made = DecisionLogic(
        settings, health, by_pilot=by_pilot, approach=None if approach is None else lambda consent: approach
    )
    made._consent = GivenConsent()
    return made


def seen(made, verdict=FIT, flat=True, us=US):
    made._decider = SimpleNamespace(step=lambda estimate: verdict, ground=None)
    return made.see(replace(FLAT, frame=7, time_s=us * 1e-6, flat=flat), us, us)


def said(made, mode="GUIDED", us=US):
    return made.follow(Heartbeat(us, True, mode, "ardupilot", 4), us, us)


def names(out):
    return [o.event for o in out if isinstance(o, Event)]


def requests(out):
    return [o for o in out if isinstance(o, LandRequest)]


def decision(out):
    return [o for o in out if isinstance(o, Decision)][-1]


def ordered(kind):
    """An order of the procedure, of whose step nothing else matters here."""
    return Ordered(7, US, SimpleNamespace(order=Order(kind)))


def procedure(state):
    """What is published of a procedure in a state."""
    return ProcedureState(kind="landing_target", state=state, code="no_permission", text="", order="none")


def test_a_request_uses_the_permission_and_says_why():
    made = logic()
    out = seen(made)
    assert [r.text for r in requests(out)] == ["the surface below is fit for landing"]
    assert [o.text for o in out if isinstance(o, Event)] == ["the surface below is fit for landing"]
    assert made._consent.permission.used
    assert decision(out).requested


@pytest.mark.parametrize(
    "change",
    [
        {"verdict": STEEP},
        {"flat": False},
        {"against": (Objection(Withheld.NOT_ARMED),)},
        {"approach": GivenApproach("offboard")},
        {"calibrated": False},
    ],
    ids=["unfit", "not_seen_flat", "objection", "offboard", "uncalibrated"],
)
def test_each_of_these_alone_keeps_it_from_a_request(change):
    change = dict(change)
    made = logic(approach=change.pop("approach", None), calibrated=change.pop("calibrated", True))
    made._consent.against = change.pop("against", ())
    assert requests(seen(made, **change)) == []


def test_a_procedure_of_targets_does_not_keep_it_from_a_request():
    assert len(requests(seen(logic(approach=GivenApproach("landing_target"))))) == 1


def test_a_changed_verdict_is_an_event_with_its_reasons_and_an_unchanged_one_none():
    made = logic()
    (changed,) = [o for o in seen(made, STEEP) if isinstance(o, Event)]
    assert changed.event == "decision_changed"
    assert changed.text.startswith("surface unfit: perhaps too rough: 0.1")
    assert names(seen(logic(), replace(STEEP, changed=False))) == []
    made._consent.against = (Objection(Withheld.NOT_ARMED),)
    (fit,) = [o for o in seen(made, replace(FIT, changed=True)) if isinstance(o, Event)]
    assert fit.text == "surface fit for landing"


def test_a_camera_without_calibration_is_never_fit_and_keeps_its_unfit():
    made = logic(calibrated=False)
    first, again = seen(made), seen(made)
    assert decision(first).verdict == "unknown"
    assert decision(first).reason_codes == ("uncalibrated",)
    assert (names(first), names(again)) == (["decision_changed"], [])
    assert decision(seen(made, STEEP)).verdict == "unfit"
    assert decision(seen(logic(), FIT)).verdict == "fit"


def test_taking_the_permission_back_forgets_how_a_command_ended_and_giving_it_does_not():
    made = logic()
    seen(made)
    made.follow(CommandAnswer(US, 21, "DENIED"), US, US)
    ended = made._command.code
    made.set_enabled(True, US)
    assert made._command.code == ended
    made.set_enabled(False, US)
    assert made._command.code.value == "none"


def test_a_pilot_who_takes_over_ends_the_command_and_one_who_does_not_leaves_it():
    made = logic()
    seen(made)
    said(made, "LAND")
    assert said(made, "LAND") == []
    made._consent.vehicle.pilot_took_over = True
    out = said(made, "LAND")
    assert names(out) == ["landing_taken_over"]
    assert out[0].text.startswith("command to land: taken over")
    assert made._consent.permission.ended == [Withheld.TAKEN_OVER]
    assert decision(out).command_code == "taken_over"


def test_a_command_that_ends_well_ends_no_permission():
    made = logic()
    seen(made)
    made.follow(CommandAnswer(US, 21, "ACCEPTED"), US, US)
    assert made._consent.permission.ended == []
    assert made._command.code.value == "accepted"


def test_a_permission_that_is_off_forgets_the_command():
    made = logic()
    seen(made)
    made.follow(CommandAnswer(US, 21, "DENIED"), US, US)
    said(made)
    assert made._command.code.value == "denied"
    made._consent.permission.phase = Phase.OFF
    said(made)
    assert made._command.code.value == "none"


def test_what_changes_nothing_publishes_nothing():
    assert said(logic()) == []


def test_changes_of_the_pilots_permission_are_events_and_those_by_hand_none():
    for by_pilot in (True, False):
        made = logic(by_pilot)
        made._consent.against_enabling = "the switch is off"
        off = [*said(made), *said(made)]
        made._consent.against_enabling = ""
        on = [*said(made), *said(made)]
        assert names(off) == (["landing_disabled"] if by_pilot else [])
        assert names(on) == (["landing_enabled"] if by_pilot else [])
    assert names(said(logic(True))) == ["landing_enabled"]


def test_the_procedures_hand_over_is_a_request_and_its_other_orders_are_none():
    approach = GivenApproach("offboard")
    made = logic(approach=approach)
    approach.orders = [event("procedure_changed", 7, US), ordered(OrderKind.STOP)]
    out = seen(made, STEEP)
    assert requests(out) == []
    assert len([o for o in out if isinstance(o, Ordered)]) == 1
    approach.orders = [ordered(OrderKind.LAND)]
    out = seen(made, STEEP)
    assert [r.text for r in requests(out)] == ["the place below is fit for landing"]
    assert "landing_requested" in names(out)


def test_between_frames_the_procedure_is_watched_and_heard_only_when_it_orders():
    assert logic().watch(US, US, 1.0) == []
    approach = GivenApproach()
    made = logic(approach=approach)
    assert made.watch(US, US, 1.0) == []
    approach.orders = [ordered(OrderKind.STOP)]
    out = made.watch(US, US, 1.0)
    assert isinstance(out[0], Ordered)
    assert isinstance(out[-1], Decision)


def test_the_procedure_is_told_where_it_is_and_whether_the_autopilot_lands_at_our_request():
    logic().locate((0.0, 0.0, 0.0), US)
    approach = GivenApproach()
    made = logic(approach=approach)
    made.locate((1.0, 2.0, 3.0), US)
    assert approach.located == [(1.0, 2.0, 3.0)]
    seen(made)  # requests
    seen(made)
    assert approach.busy == [False, True]
    made._consent.permission.phase = Phase.STANDING
    seen(made)
    assert approach.busy[-1] is False, "of a permission that was given anew"
    made._consent.permission.phase = Phase.USED
    made.follow(CommandAnswer(US, 21, "DENIED"), US, US)
    seen(made, STEEP)
    assert approach.busy[-1] is False, "the command has ended"


def test_a_decision_is_published_on_change_once_a_second_and_when_asked_for():
    made = logic()
    made._consent.against = (Objection(Withheld.NOT_ARMED),)
    assert len(seen(made, STEEP)) == 2
    quiet = replace(STEEP, changed=False)
    assert seen(made, quiet, us=US + 100) == []
    assert made.decide(US + 200, US + 200, always=True) != []
    made._consent.against = (Objection(Withheld.NOT_IN_AIR),)
    assert decision(seen(made, quiet, us=US + 300)).withheld_codes == ("not_in_air",)
    assert seen(made, quiet, us=US + 1_000_000) == []
    assert len(seen(made, quiet, us=US + 1_000_300)) == 1


def test_a_decision_carries_the_procedure_where_there_is_one():
    approach = GivenApproach()
    made = logic(approach=approach)
    made._consent.against = (Objection(Withheld.NOT_ARMED),)
    assert decision(seen(made, STEEP)).procedure is msgspec.UNSET
    assert decision(seen(logic(), STEEP)).procedure is msgspec.UNSET
    approach.state = procedure("look")
    out = seen(made, replace(STEEP, changed=False), us=US + 1)
    assert decision(out).procedure.state == "look"
    assert seen(made, replace(STEEP, changed=False), us=US + 2) == []
    approach.state = procedure("go")
    assert decision(seen(made, replace(STEEP, changed=False), us=US + 3)).procedure.state == "go"


def test_no_frames_ends_a_verdict_once():
    made = logic()
    assert names(made.no_frames(US, US)) == []
    seen(made, STEEP)
    (ended,) = [o for o in made.no_frames(US, US + 5) if isinstance(o, Event)]
    assert ended.text == "surface unknown: no frames"
    assert made._since_us == US + 5
    assert math.isclose(made._verdict.since_s, STEEP.since_s)
