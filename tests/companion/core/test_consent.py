"""The permission from samples: radio channel, flight mode, joystick, failsafes, and what the vehicle is."""

import pytest

from companion.core.consent import STATUS_MAX_AGE_S, Consent
from companion.core.health import HealthMonitor
from companion.messages.conditions import Code, condition
from companion.settings.settings import HealthSettings, LandingSettings
from drivers.samples import (
    Attitude,
    CurrentMode,
    Frame,
    Heartbeat,
    LandedState,
    ManualControl,
    RcChannels,
    Sample,
    StatusText,
    SystemStatus,
)
from landing.decision.permission import Phase

CHANNEL = 8
LEVEL = (1500, 1500, 1500, 1500)
START_S = 1000.0


class Scene:
    """A consent with healthy inputs, fed at given seconds."""

    def __init__(self, by_pilot: bool = True, **landing: object) -> None:
        self.health = HealthMonitor(HealthSettings(), True)
        self.consent = Consent(LandingSettings(**landing), self.health, by_pilot=by_pilot)
        self.now_us = 0

    def feed(self, at_s: float, *samples: Sample) -> "Scene":
        self.now_us = round((START_S + at_s) * 1e6)
        for sample in samples:
            self.health.count(sample, self.now_us)
            self.consent.feed(sample, self.now_us)
        return self

    @property
    def enabled(self) -> bool:
        self.consent.step(self.now_us)
        return self.consent.permission.phase is Phase.STANDING

    def codes(self) -> list[str]:
        """What stands against a request, with camera, attitude and landed state all well."""
        for sample in (Frame(1, self.now_us, self.now_us, None), Attitude(self.now_us, self.now_us, 0, 0, 0)):
            self.health.count(sample, self.now_us)
        return [o.code.value for o in self.consent.objections(self.now_us, command_busy=False)]


def rc(switch_us: int, sticks: tuple[int, ...] = LEVEL) -> RcChannels:
    return RcChannels(0, (*sticks, 1000, 1000, 1000, switch_us))


def beat(mode: str = "GUIDED", status: int = 4, kind: str = "quadrotor") -> Heartbeat:
    return Heartbeat(0, True, mode, "ardupilot", status, kind)


def text(words: str) -> StatusText:
    return StatusText(0, 4, words)


RADIO = SystemStatus(0, True, True, True)
LOST = SystemStatus(0, True, True, False)
GONE = SystemStatus(0, False, False, False)
IN_AIR = LandedState(0, "in_air")


def radio(**settings: object) -> Scene:
    return Scene(enable_rc_channel=CHANNEL, **settings)


def flying(**settings: object) -> Scene:
    """Permitted by radio, in the air."""
    scene = radio(**settings).feed(0, beat(), IN_AIR, RADIO, rc(1000)).feed(0.1, rc(1900))
    assert scene.codes() == []
    return scene


def test_off_by_default_and_fixed_by_the_settings() -> None:
    assert not Scene().feed(0, beat()).enabled
    assert Scene(enabled=True).feed(0, beat()).enabled


def test_a_configured_switch_overrules_the_fixed_setting() -> None:
    assert not radio(enabled=True).feed(0, beat()).enabled


def test_given_by_hand_the_switch_of_the_settings_means_nothing() -> None:
    assert Scene(by_pilot=False, enabled=True, enable_rc_channel=CHANNEL).feed(0, beat()).enabled


def test_radio_switch_with_hysteresis() -> None:
    scene = radio()
    pulses = [
        (1000, False),
        (1699, False),
        (1701, True),
        (1650, True),
        (1599, False),
        (1650, False),
        (1900, True),
    ]
    found = [scene.feed(i * 0.1, rc(pulse)).enabled for i, (pulse, _) in enumerate(pulses)]
    assert found == [on for _, on in pulses]


def test_a_silent_radio_ends_the_permission_and_its_return_does_not_renew_it() -> None:
    scene = radio(enable_rc_max_age_s=1.0).feed(0, rc(1000)).feed(0.1, rc(1900))
    assert scene.feed(1.0, beat()).enabled
    assert not scene.feed(1.2, beat()).enabled
    assert not scene.feed(1.3, rc(1900)).enabled
    assert scene.feed(1.4, rc(1000)).feed(1.5, rc(1900)).enabled


@pytest.mark.parametrize("nothing", [rc(0), RcChannels(0, LEVEL)])
def test_a_receiver_without_a_pulse_is_no_switch(nothing: RcChannels) -> None:
    scene = radio().feed(0, rc(1000)).feed(0.1, rc(1900))
    assert not scene.feed(0.2, nothing).enabled
    assert not scene.feed(0.4, rc(1900)).enabled


def test_radio_and_mode_must_agree() -> None:
    scene = radio(enable_modes=("GUIDED",)).feed(0, beat("LOITER"))
    assert not scene.feed(0.1, rc(1900)).enabled
    assert scene.feed(0.2, beat("GUIDED")).enabled
    assert not scene.feed(0.3, rc(1000)).enabled


def test_sticks_of_the_radio_end_the_permission_until_the_switch_was_off() -> None:
    scene = radio(stick_limit_us=300).feed(0, rc(1000)).feed(0.1, rc(1900))
    assert scene.feed(0.2, rc(1900, (1500, 1250, 1500, 1500))).enabled
    assert not scene.feed(0.3, rc(1900, (1500, 1200, 1500, 1500))).enabled
    assert "sticks" in scene.consent.against_enabling
    assert not scene.feed(0.4, rc(1900)).enabled
    assert scene.feed(0.5, rc(1000)).feed(0.6, rc(1900)).enabled


def test_a_joystick_moved_ends_the_permission_too() -> None:
    scene = Scene(enable_modes=("POSCTL",)).feed(0, beat("ALTCTL"), ManualControl(0, (0, 0, 500, None)))
    assert scene.feed(0.1, beat("POSCTL"), ManualControl(0, (0, 500, 500, None))).enabled
    assert scene.feed(0.2, ManualControl(0, (0, 0, 500, None))).enabled
    assert not scene.feed(0.3, ManualControl(0, (0, -700, 500, None))).enabled
    assert scene.codes()[0] == "sticks_moved"


@pytest.mark.parametrize(
    ("samples", "code"),
    [
        ((beat(status=5),), "failsafe"),
        ((beat(status=6),), "failsafe"),
        ((beat(status=8),), "failsafe"),
        ((text("Battery Failsafe"),), "failsafe"),
        ((text("Circle fence breached"),), "failsafe"),
        ((text("Circle, Polygon fences breached"),), "failsafe"),
        ((LOST,), "radio_lost"),
        ((GONE,), "radio_lost"),
        ((text("Radio Failsafe - Continuing Guided Mode"),), "radio_lost"),
        ((text("Manual control lost"),), "radio_lost"),
        ((text("Pilot took over using sticks"),), "taken_over"),
    ],
)
def test_what_ends_a_permission_and_does_not_renew_it_when_it_passes(samples, code) -> None:
    scene = flying().feed(0.2, *samples)
    assert not scene.enabled
    assert scene.codes()[0] in (code, "failsafe")  # a radio's failsafe is one
    calm = (beat(), RADIO, IN_AIR, rc(1900))
    scene.feed(0.3, text("Radio Failsafe Cleared"), text("Battery Failsafe Cleared"), *calm)
    scene.feed(0.35, text("Fence breach cleared"))
    scene.feed(0.4, text("Manual control regained"), *calm)
    assert not scene.enabled
    assert len(scene.codes()) == 1, scene.codes()
    assert scene.feed(0.5, rc(1000)).feed(0.6, rc(1900)).codes() == []


def test_a_text_that_was_lost_on_the_way_does_not_withhold_for_ever() -> None:
    scene = flying().feed(0.2, text("Radio Failsafe - RTL"), beat(), RADIO)
    assert "radio_lost_now" in scene.codes()
    scene.feed(3.0, beat(), RADIO, IN_AIR, rc(1000)).feed(3.1, rc(1900))
    assert scene.codes() == []


def test_a_receiver_that_was_never_there_is_not_lost() -> None:
    scene = Scene(enabled=True).feed(0, beat(), IN_AIR, GONE)
    assert scene.codes() == []


def test_system_status_that_stops_leaves_the_radio_unknown() -> None:
    scene = flying()
    for tenth in range(1, 70):
        scene.feed(tenth * 0.1, beat(), IN_AIR, rc(1900))
    assert scene.now_us * 1e-6 - START_S > STATUS_MAX_AGE_S
    assert scene.codes() == ["stale_inputs"]


@pytest.mark.parametrize("status", [0, 1, 2, 7])
def test_an_autopilot_that_boots_or_powers_off_lands_nobody(status: int) -> None:
    assert flying().feed(0.2, beat(status=status)).codes() == ["status_not_ready"]


@pytest.mark.parametrize(
    ("kind", "vtol", "codes"),
    [
        ("quadrotor", "undefined", []),
        ("helicopter", "undefined", []),
        ("fixed_wing", "undefined", ["vehicle_type"]),
        ("ground_rover", "undefined", ["vehicle_type"]),
        ("surface_boat", "undefined", ["vehicle_type"]),
        ("generic", "undefined", ["vehicle_type"]),
        ("vtol_quadrotor", "multicopter", []),
        ("vtol_quadrotor", "fixed_wing", ["vtol_not_hovering"]),
        ("vtol_tiltrotor", "transition", ["vtol_not_hovering"]),
        ("vtol_tiltrotor", "undefined", ["vtol_not_hovering"]),
    ],
)
def test_only_what_hovers_is_landed(kind: str, vtol: str, codes: list[str]) -> None:
    scene = flying().feed(0.2, beat(kind=kind), LandedState(0, "in_air", vtol))
    assert scene.codes() == codes


def test_a_setting_widens_the_kinds_of_vehicles() -> None:
    scene = flying(vehicle_types=("GROUND_ROVER",))
    assert scene.feed(0.2, beat(kind="ground_rover")).codes() == []
    assert scene.feed(0.3, beat(kind="fixed_wing")).codes() == ["vehicle_type"]


def test_a_mode_that_the_autopilot_flies_instead_of_the_pilots_is_not_the_pilots_choice() -> None:
    scene = Scene(enable_modes=("HOLD",)).feed(0, beat("POSCTL"))
    assert not scene.feed(0.1, CurrentMode(0, "HOLD", "POSCTL"), beat("HOLD")).enabled
    assert not scene.feed(0.2, CurrentMode(0, "HOLD", "HOLD")).enabled
    scene.feed(0.3, CurrentMode(0, "POSCTL", "POSCTL"))
    assert scene.feed(0.4, CurrentMode(0, "HOLD", "")).enabled


def test_after_a_reboot_nothing_is_known_and_nothing_permitted() -> None:
    scene = flying()
    scene.consent.reboot()
    codes = scene.codes()
    assert codes[0] == "rebooted"
    assert {"armed_unknown", "in_air_unknown", "mode_unknown"} <= set(codes)
    scene.feed(0.2, beat(), IN_AIR, rc(1900))
    assert scene.codes() == ["rebooted"]


def test_frames_without_an_attitude_withhold_without_ending_the_permission() -> None:
    scene = flying()
    scene.health.attitude_missing = "attitude gap"
    assert scene.codes() == ["attitude_missing"]
    scene.health.attitude_missing = ""
    assert scene.codes() == []


def test_two_vehicles_withhold_without_ending_the_permission() -> None:
    scene = flying()
    scene.health.vehicles_clash = True
    assert scene.codes() == ["two_vehicles"]
    assert "two vehicles" in scene.consent.against_enabling
    scene.health.vehicles_clash = False
    assert scene.codes() == []


def test_a_reboot_ends_what_the_pilot_gave_and_not_what_was_given_by_hand() -> None:
    scene = Scene(by_pilot=False, enabled=True).feed(0, beat(), IN_AIR)
    scene.consent.reboot()
    assert scene.feed(0.1, beat(), IN_AIR).enabled


@pytest.mark.parametrize(
    ("scene", "samples", "lost"),
    [
        (flying(), (rc(1900),), False),
        (flying(), (LOST, rc(1900)), True),
        (radio().feed(-60, beat(), RADIO, rc(1900)), (beat(),), True),
        (Scene(enabled=True), (beat(),), False),
    ],
)
def test_the_radio_is_lost_by_status_or_by_silence_of_its_switch(
    scene: Scene, samples: tuple, lost: bool
) -> None:
    assert scene.feed(0.2, *samples).consent.radio_lost is lost


def test_without_a_switch_on_the_radio_its_status_may_stop() -> None:
    scene = Scene(enabled=True).feed(0, beat(), IN_AIR, RADIO)
    scene.feed(STATUS_MAX_AGE_S + 5, beat(), IN_AIR)
    assert scene.codes() == []


def test_a_landed_state_that_stopped_is_not_known() -> None:
    scene = flying()
    scene.feed(6.0, beat(), RADIO, rc(1900))
    assert "in_air_unknown" in scene.codes()


def test_without_heartbeats_neither_arming_nor_mode_is_known_and_the_modes_permission_ends() -> None:
    scene = Scene(enable_modes=("LOITER",), allowed_modes=("LOITER",))
    scene.feed(0, beat("GUIDED"), IN_AIR)
    assert scene.feed(0.1, beat("LOITER"), IN_AIR).enabled
    scene.feed(10.0, IN_AIR)
    codes = scene.codes()
    assert {"armed_unknown", "mode_unknown", "mode_lost"} <= set(codes)


@pytest.mark.parametrize(
    ("code", "words"), [(Code.UNCALIBRATED, "calibrat"), (Code.TWO_VEHICLES, "two vehicles")]
)
def test_what_stands_against_enabling_is_said(code: Code, words: str) -> None:
    scene = flying()
    assert scene.consent.against_enabling == ""
    scene.health.standing = (condition(code),)
    assert words in scene.consent.against_enabling


def test_the_switch_is_turned_by_hand_where_the_settings_name_none() -> None:
    scene = Scene(by_pilot=False).feed(0, beat())
    scene.consent.set_enabled(True, scene.now_us)
    assert scene.enabled
    scene.consent.set_enabled(False, scene.now_us)
    assert not scene.enabled
