"""The pilot's switch: radio channel, flight mode, settings, sticks."""

from companion.core.enable import EnableSwitch
from companion.settings.settings import LandingSettings
from drivers.samples import Heartbeat, RcChannels

CHANNEL = 8


def rc(
    at_s: float, switch_us: int, sticks: tuple[int, int, int, int] = (1500, 1500, 1500, 1500)
) -> RcChannels:
    return RcChannels(int(at_s * 1e6), (*sticks, 1000, 1000, 1000, switch_us))


def beat(at_s: float, mode: str) -> Heartbeat:
    return Heartbeat(int(at_s * 1e6), True, mode, "ardupilot", 4)


def radio(**settings: object) -> EnableSwitch:
    return EnableSwitch(LandingSettings(enable_rc_channel=CHANNEL, **settings))


def test_off_by_default_and_fixed_by_the_settings() -> None:
    assert not EnableSwitch(LandingSettings()).feed(beat(0, "GUIDED"))
    assert EnableSwitch(LandingSettings(enabled=True)).feed(beat(0, "GUIDED"))


def test_a_configured_switch_overrules_the_fixed_setting() -> None:
    assert not radio(enabled=True).feed(beat(0, "GUIDED"))


def test_radio_switch_with_hysteresis() -> None:
    switch = radio()
    pulses = [
        (1000, False),
        (1699, False),
        (1701, True),
        (1650, True),
        (1599, False),
        (1650, False),
        (1900, True),
    ]
    assert [switch.feed(rc(i * 0.1, pulse)) for i, (pulse, _) in enumerate(pulses)] == [
        on for _, on in pulses
    ]


def test_a_switch_that_is_on_at_the_start_must_be_turned_off_first() -> None:
    switch = radio()
    assert not switch.feed(rc(0, 1900))
    assert "off first" in switch.reason
    assert not switch.feed(rc(0.1, 1000))
    assert switch.feed(rc(0.2, 1900))


def test_a_silent_radio_ends_the_permission_and_its_return_does_not_renew_it() -> None:
    switch = radio(enable_rc_max_age_s=1.0)
    switch.feed(rc(0, 1000))
    assert switch.feed(rc(0.1, 1900))
    assert switch.feed(beat(1.0, "GUIDED"))
    assert not switch.feed(beat(1.2, "GUIDED"))
    assert not switch.feed(rc(1.3, 1900))
    switch.feed(rc(1.4, 1000))
    assert switch.feed(rc(1.5, 1900))


def test_a_receiver_without_signal_is_no_switch() -> None:
    switch = radio()
    switch.feed(rc(0, 1000))
    assert switch.feed(rc(0.1, 1900))
    assert not switch.feed(rc(0.2, 0))
    assert not switch.feed(RcChannels(300_000, (1500,) * 4))
    assert not switch.feed(rc(0.4, 1900))


def test_sticks_end_the_permission_until_the_switch_was_off() -> None:
    switch = radio(stick_limit_us=300)
    switch.feed(rc(0, 1000, (1400, 1500, 1600, 1500)))
    assert switch.feed(rc(0.1, 1900, (1400, 1500, 1600, 1500)))
    assert switch.feed(rc(0.2, 1900, (1400, 1250, 1600, 1500)))
    assert not switch.feed(rc(0.3, 1900, (1400, 1200, 1600, 1500)))
    assert "sticks" in switch.reason
    assert not switch.feed(rc(0.4, 1900, (1400, 1500, 1600, 1500)))
    switch.feed(rc(0.5, 1000))
    assert switch.feed(rc(0.6, 1900))


def test_flight_mode_as_switch() -> None:
    switch = EnableSwitch(LandingSettings(enable_modes=("GUIDED",)))
    assert not switch.feed(beat(0, "GUIDED"))
    assert not switch.feed(beat(1, "LOITER"))
    assert switch.feed(beat(2, "GUIDED"))
    assert not switch.feed(beat(3, "LOITER"))


def test_radio_and_mode_must_agree() -> None:
    switch = radio(enable_modes=("GUIDED",))
    switch.feed(beat(0, "LOITER"))
    assert not switch.feed(rc(0.1, 1900))
    assert switch.feed(beat(0.2, "GUIDED"))
    assert not switch.feed(rc(0.3, 1000))
