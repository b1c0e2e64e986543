"""From estimates to decisions and requests: one request a permission, none in doubt, silence reported."""

from dataclasses import replace
from itertools import pairwise

import pytest
from estimates import FLAT

from companion.core.decision_logic import DecisionLogic, LandRequest
from companion.core.health import Clocks, HealthMonitor
from companion.messages.messages import Decision, Event
from companion.settings.settings import HealthSettings, LandingSettings, Settings
from drivers.samples import (
    Attitude,
    CommandAnswer,
    Frame,
    Heartbeat,
    Imu,
    LandedState,
    Refusal,
    Velocity,
)

START_US = 1_000_000_000
STEEP = replace(FLAT, inclination_deg=30.0, flat=False)


class Scene:
    """The decision logic with healthy inputs, stepped frame by frame."""

    def __init__(self, **landing):
        settings = Settings(landing=LandingSettings(**{"enabled": True, **landing}))
        self.health = HealthMonitor(settings.health, True)
        self.logic = DecisionLogic(settings, self.health)
        self.now_us = START_US
        self.frame = 0
        self.mode, self.armed, self.landed = "GUIDED", True, "in_air"
        self.silent = set()

    def inputs(self):
        us = self.now_us
        samples = {
            "frames": Frame(self.frame, us, us, None),
            "attitude": Attitude(us, us, 0, 0, 0),
            "gyro": Imu(us, us, (0, 0, 0)),
            "velocity": Velocity(us, us, (0, 0, 0), (0, 0, 0)),
            "heartbeat": Heartbeat(us, self.armed, self.mode, "ardupilot", 4),
            "landed_state": LandedState(us, self.landed),
        }
        return [s for name, s in samples.items() if name not in self.silent]

    def run(self, seconds, estimate=FLAT):
        out = []
        for _ in range(round(seconds * 30)):
            self.now_us += 33_333
            for sample in self.inputs():
                self.health.count(sample, self.now_us)
                if isinstance(sample, Heartbeat | LandedState):
                    out += self.logic.follow(sample, self.now_us, self.now_us)
            self.frame += 1
            e = replace(estimate, frame=self.frame, time_s=self.now_us * 1e-6)
            out += self.logic.see(e, self.now_us, self.now_us)
        return out


def requests(out):
    return [o for o in out if isinstance(o, LandRequest)]


def events(out):
    return [o.event for o in out if isinstance(o, Event)]


def last(out):
    return [o for o in out if isinstance(o, Decision)][-1]


def test_a_flat_surface_is_requested_once_after_the_dwell():
    scene = Scene()
    out = scene.run(4)
    (request,) = requests(out)
    assert 0.8e6 <= request.time_unix_us - START_US < 1.0e6
    assert events(out).count("landing_requested") == 1
    assert last(out).requested
    assert last(out).command == "requested"


def test_a_steep_surface_is_never_requested():
    out = Scene().run(4, STEEP)
    assert requests(out) == []
    assert last(out).verdict == "unfit"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"armed": False}, "not armed"),
        ({"mode": "RTL"}, "mode not allowed"),
        ({"landed": "on_ground"}, "not in the air"),
        ({"landed": "landing"}, "landing already"),
        ({"landed": "undefined"}, "not known whether in the air"),
        ({"silent": {"heartbeat"}}, "heartbeat"),
        ({"silent": {"landed_state"}}, "landed_state"),
        ({"silent": {"attitude"}}, "attitude"),
    ],
)
def test_what_stands_against_a_request_is_said(change, words):
    scene = Scene()
    for name, value in change.items():
        setattr(scene, name, value)
    out = scene.run(4)
    assert requests(out) == []
    assert not last(out).permitted
    assert any(words in reason for reason in last(out).withheld), last(out).withheld


def test_an_input_that_stops_withdraws_the_permission():
    scene = Scene()
    scene.run(1, STEEP)
    scene.silent = {"heartbeat"}
    scene.run(4, STEEP)
    assert requests(scene.run(2, FLAT)) == []


def test_not_enabled_it_only_says_what_it_would_do():
    scene = Scene(enabled=False)
    out = scene.run(3)
    assert requests(out) == []
    assert last(out).verdict == "fit"
    assert last(out).withheld == ("landing is not enabled",)
    scene.logic.set_enabled(True, scene.now_us)
    assert len(requests(scene.run(1))) == 1


def test_a_frame_in_doubt_makes_no_request_while_the_verdict_lasts():
    doubtful = replace(FLAT, roughness=0.02, unsettled=True, flat=False)
    scene = Scene(enabled=False)
    scene.run(1.0)
    scene.logic.set_enabled(True, scene.now_us)
    out = scene.run(0.1, doubtful)
    assert last(out).verdict == "fit"
    assert not requests(out)
    assert len(requests(scene.run(0.1))) == 1


def test_a_new_permission_allows_another_request_once_the_command_has_ended():
    scene = Scene()
    assert len(requests(scene.run(2))) == 1
    scene.logic.set_enabled(False, scene.now_us)
    scene.logic.set_enabled(True, scene.now_us)
    assert requests(scene.run(1)) == [], "a command is under way"
    answer = CommandAnswer(scene.now_us, 21, "DENIED")
    out = scene.logic.follow(answer, scene.now_us, scene.now_us)
    assert events(out) == ["landing_refused"]
    assert len(requests(scene.run(1))) == 1, "for the second permission, with the next frame"
    scene.logic.follow(answer, scene.now_us, scene.now_us)
    assert requests(scene.run(1)) == [], "already requested under this permission"


def test_the_command_is_followed_to_the_ground():
    scene = Scene()
    out = scene.run(2)
    out += scene.logic.follow(CommandAnswer(scene.now_us, 21, "ACCEPTED"), scene.now_us, scene.now_us)
    scene.mode = "LAND"
    out += scene.run(1)
    scene.landed = "on_ground"
    out += scene.run(1)
    reported = [e for e in events(out) if e.startswith("landing_")]
    assert reported == ["landing_requested", "landing_accepted", "landing_started", "landing_landed"]
    assert last(out).command == "landed"
    assert len(requests(out)) == 1


def test_after_a_reboot_nothing_is_known_of_the_vehicle():
    scene = Scene()
    scene.run(0.2)
    scene.logic.forget_autopilot(scene.now_us)
    scene.silent = {"heartbeat", "landed_state"}
    out = scene.run(1)
    assert requests(out) == []
    assert "not known whether armed" in last(out).withheld


def test_a_second_vehicle_on_the_link_withholds_the_permission():
    scene = Scene()
    scene.health.vehicles_clash = True
    out = scene.run(2)
    assert requests(out) == []
    assert any("two vehicles" in reason for reason in last(out).withheld)


def test_silence_of_the_camera_ends_the_verdict():
    scene = Scene(enabled=False)
    scene.run(2)
    scene.now_us += 2_000_000
    out = scene.logic.no_frames(scene.now_us, scene.now_us)
    assert events(out) == ["decision_changed"]
    assert (last(out).verdict, last(out).reasons) == ("unknown", ("no frames",))
    assert events(scene.logic.no_frames(scene.now_us + 1, scene.now_us + 1)) == []


def test_decisions_come_on_change_and_every_second():
    scene = Scene(enabled=False)
    out = scene.run(10)
    decisions = [o for o in out if isinstance(o, Decision)]
    assert 10 <= len(decisions) <= 12
    times = [d.time_unix_us for d in decisions]
    assert all(b - a <= 1_040_000 for a, b in pairwise(times))


# Health.


def test_health_counts_rates_ages_and_refusals():
    scene = Scene()
    scene.run(1)
    scene.health.message(scene.now_us, scene.now_us, Clocks(0.0, 0.001))
    scene.run(2)
    scene.health.count(Refusal(scene.now_us, "ATTITUDE", "not_finite"), scene.now_us)
    scene.health.count(Refusal(scene.now_us, "link", "garbage"), scene.now_us)
    health = scene.health.message(scene.now_us, scene.now_us, Clocks(1.5, 0.001))
    assert health.state == "ok"
    assert health.problems == ()
    assert health.inputs["attitude"].rate_hz == pytest.approx(30, abs=0.2)
    assert health.inputs["attitude"].refused == 1
    assert health.inputs["frames"].age_s == 0
    assert health.counters == {"refused attitude: not_finite": 1, "refused link: garbage": 1}
    assert health.clock_offset_s == 1.5


@pytest.mark.parametrize(
    ("name", "state"),
    [("frames", "failed"), ("attitude", "failed"), ("heartbeat", "degraded"), ("gyro", "degraded")],
)
def test_an_input_that_stopped_is_reported_in_words(name, state):
    scene = Scene()
    scene.run(1)
    scene.silent = {name}
    scene.run(4)
    health = scene.health.message(scene.now_us, scene.now_us, Clocks(0.0, 0.001))
    assert health.state == state
    assert any(p.startswith(f"{name}: none for 4.0 s") for p in health.problems), health.problems
    assert health.inputs[name].state == "stale"


def test_of_a_plain_video_only_frames_are_expected():
    health = HealthMonitor(HealthSettings(), False)
    health.count(Frame(0, START_US, START_US, None), START_US)
    message = health.message(START_US + 1, START_US + 1, Clocks())
    assert message.state == "ok"
    assert list(message.inputs) == ["frames"]
    assert "attitude" in health.stale(START_US), "but no landing is requested without an attitude"
