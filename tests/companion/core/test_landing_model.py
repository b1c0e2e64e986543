"""A model of random lives, from samples to requests: switch, mode, status, arming, acknowledgements."""

from dataclasses import replace

from estimates import FLAT
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from companion.core.command import NAV_LAND
from companion.core.decision_logic import DecisionLogic, LandRequest
from companion.core.health import HealthMonitor
from companion.messages.messages import Event
from companion.settings.settings import LandingSettings, Settings
from drivers.samples import Attitude, CommandAnswer, Frame, Heartbeat, LandedState, RcChannels, StatusText
from landing.options import DecisionOptions

SWITCH = 5
FAILSAFE = (5, 6, 8)
ACTS = st.one_of(
    st.tuples(st.just("radio"), st.sampled_from([1000, 1900, 0])),
    st.tuples(st.just("mode"), st.sampled_from(["POSCTL", "ALTCTL", "HOLD", "LAND", "RTL", "TAKEOFF"])),
    st.tuples(st.just("status"), st.sampled_from([4, 4, 4, 5, 6, 8])),
    st.tuples(st.just("armed"), st.booleans()),
    st.tuples(st.just("answer"), st.sampled_from(["ACCEPTED", "DENIED", "IN_PROGRESS", "NO_ANSWER"])),
    st.tuples(st.just("landed"), st.sampled_from(["in_air", "landing", "on_ground"])),
    st.tuples(st.just("hold"), st.none()),
    st.tuples(
        st.just("text"), st.sampled_from(["Radio Failsafe", "Radio Failsafe Cleared", "Pilot took over"])
    ),
)
WAYS = [{"enable_rc_channel": SWITCH}, {"enable_modes": ("POSCTL",)}]
MAKE_REQUESTS = [("landed", "in_air"), ("armed", True)]


class Life:
    """The decision logic over flat ground, with its inputs as the invariants need them."""

    def __init__(self, way: dict) -> None:
        chosen = Settings(landing=LandingSettings(**way), decision=DecisionOptions(dwell_s=0.0))
        self.health = HealthMonitor(chosen.health, True)
        self.logic = DecisionLogic(chosen, self.health, by_pilot=True)
        self.now_us = 1_000_000_000
        self.pulse, self.mode, self.status, self.armed = 1000, "ALTCTL", 4, True
        self.landed = "in_air"
        self.off_since_request = self.off_since_end = True
        self.by_radio = "enable_rc_channel" in way
        self.requests = 0

    def act(self, name: str, value: object) -> None:
        out: list[object] = []
        self.now_us += 100_000
        us = self.now_us
        if name == "hold":
            self.logic.hold()
        elif name == "answer":
            out += self.logic.follow(CommandAnswer(us, NAV_LAND, str(value)), us, us)
        elif name == "text":
            out += self.logic.follow(StatusText(us, 4, str(value)), us, us)
            if value != "Radio Failsafe Cleared":
                self.off_since_end = False
        else:
            setattr(self, {"radio": "pulse"}.get(name, name), value)
        samples = (
            Heartbeat(us, self.armed, self.mode, "px4", self.status),
            LandedState(us, self.landed),
            RcChannels(us, (1500, 1500, 1500, 1500, self.pulse)),
            Frame(0, us, us, None),
            Attitude(us, us, 0, 0, 0),
        )
        for sample in samples:
            self.health.count(sample, us)
            if not isinstance(sample, Frame | Attitude):
                out += self.logic.follow(sample, us, us)
        if self.status in FAILSAFE or (self.by_radio and self.pulse == 0):
            self.off_since_end = False
        elif self.pulse == 1000 if self.by_radio else self.mode in ("ALTCTL", "HOLD"):
            self.off_since_request = self.off_since_end = True
        if [o for o in out if isinstance(o, Event) and o.event in ("landing_taken_over", "landing_failsafe")]:
            # by mode the pilot's own choice of another mode is the takeover and the switch off at once
            self.off_since_end = not self.by_radio and self.mode in ("ALTCTL", "HOLD")
        for each in self.logic.see(replace(FLAT, time_s=us * 1e-6), us, us):
            if isinstance(each, LandRequest):
                self.check()

    def check(self) -> None:
        self.requests += 1
        assert self.status not in FAILSAFE, "none in a failsafe"
        assert self.armed
        assert self.landed == "in_air"
        assert self.mode not in ("LAND", "RTL", "TAKEOFF", "ALTCTL")
        assert self.off_since_request, "at most one request a permission"
        assert self.off_since_end, "silence after a takeover, a failsafe, a lost radio"
        self.off_since_request = False


@examples(150)
@given(st.sampled_from(WAYS), st.lists(ACTS, max_size=40))
def test_invariants_of_any_life(way: dict, acts: list[tuple[str, object]]) -> None:
    life = Life(way)
    for name, value in acts:
        life.act(name, value)


def test_a_life_without_faults_makes_its_request() -> None:
    """The invariants hold of something."""
    for way, on in zip(WAYS, [("radio", 1900), ("mode", "POSCTL")], strict=True):
        life = Life(way)
        for act in (*MAKE_REQUESTS, ("mode", "HOLD"), on):
            life.act(*act)
        assert life.requests == 1
