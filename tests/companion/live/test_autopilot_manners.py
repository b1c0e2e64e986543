"""As real autopilots behave, over sockets and a real MAVSDK: takeovers, failsafes, a lost radio, other vehicles."""

from collections.abc import Callable, Iterator

import pytest
from estimates import FLAT
from live_rig import Flight
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.simulated.vehicle.firmware import Firmware
from drivers.system.host_clock import now_us

SWITCH = 7


@pytest.fixture
def fly() -> Iterator[Callable[..., Flight]]:
    flights: list[Flight] = []

    def make(firmware: Firmware, mode: str, **landing: object) -> Flight:
        flight = Flight(firmware, mode, **landing)
        flights.append(flight)
        flight.start(lambda: flight.codes)
        return flight

    yield make
    for flight in flights:
        flight.close()


def test_px4_a_takeover_by_sticks_into_the_enabling_mode_is_followed_by_silence(fly) -> None:
    flight = fly(Firmware("px4", radio="none"), "ALT_HOLD", enable_modes=("POSCTL",), stick_limit_us=0)
    flight.wait(lambda: flight.codes[0] == "switch_off", "mode that is off")
    flight.autopilot.set_mode("LOITER")  # POSCTL
    flight.wait(lambda: "landing_enabled" in flight.events, "permission")
    flight.surface = FLAT
    flight.wait(lambda: flight.command == "landing", "landing")
    flight.autopilot.set_channel(2, 1900)
    flight.wait(lambda: flight.command == "taken_over", "takeover")
    flight.silent()
    flight.autopilot.set_mode("ALT_HOLD")
    flight.wait(lambda: flight.codes[0] == "switch_off", "other mode of the pilot's")
    flight.autopilot.set_mode("LOITER")
    flight.wait(lambda: flight.lands == 2, "landing for the pilot's new choice")


def test_px4_in_a_failsafe_nothing_is_landed_and_its_return_comes(fly) -> None:
    flight = fly(Firmware("px4"), "LOITER", enable_rc_channel=SWITCH)
    with flight.autopilot.lock:
        flight.controller.firmware.lose_ground_station(flight.controller)
    flight.wait(lambda: "failsafe_now" in flight.codes, "failsafe")
    flight.autopilot.set_channel(SWITCH, 1900)
    flight.silent()
    flight.wait(lambda: flight.controller.mode == "RTL", "return")
    assert flight.lands == 0


def test_ardupilot_a_lost_radio_ends_the_permission_though_its_channels_go_on(fly) -> None:
    flight = fly(Firmware(), "GUIDED", enable_rc_channel=SWITCH)
    flight.wait(lambda: flight.codes[0] == "switch_off", "switch that is off")
    flight.autopilot.set_channel(SWITCH, 1900)
    flight.wait(lambda: "landing_enabled" in flight.events, "permission")
    with flight.autopilot.lock:
        flight.controller.firmware.lose_radio(flight.controller)
    flight.wait(lambda: "radio_lost_now" in flight.codes, "loss of the radio")
    flight.silent()


@pytest.mark.parametrize(("kind", "mode"), [("ardupilot", "GUIDED"), ("px4", "LOITER")])
def test_a_breached_fence_ends_the_permission_and_its_mode_given_back_does_not_renew_it(
    fly, kind: str, mode: str
) -> None:
    flight = fly(Firmware(kind), mode, enable_rc_channel=SWITCH)
    flight.wait(lambda: flight.codes[0] == "switch_off", "switch that is off")
    flight.autopilot.set_channel(SWITCH, 1900)
    flight.wait(lambda: "landing_enabled" in flight.events, "permission")
    with flight.autopilot.lock:
        flight.controller.firmware.breach_fence(flight.controller)
    flight.wait(lambda: flight.codes[0] == "failsafe", "the permission's end")
    with flight.autopilot.lock:
        flight.controller.firmware.critical = False
    flight.autopilot.set_mode(mode)
    flight.wait(lambda: flight.codes == ("failsafe",), "a vehicle that could land")
    flight.silent()


@pytest.mark.parametrize(
    ("vehicle_type", "vtol_state", "code"),
    [
        (mavlink.MAV_TYPE_FIXED_WING, 0, "vehicle_type"),
        (mavlink.MAV_TYPE_VTOL_QUADROTOR, mavlink.MAV_VTOL_STATE_FW, "vtol_not_hovering"),
    ],
)
def test_what_does_not_hover_is_not_landed(fly, vehicle_type: int, vtol_state: int, code: str) -> None:
    firmware = Firmware("px4", vehicle_type=vehicle_type, vtol_state=vtol_state)
    flight = fly(firmware, "LOITER", enabled=True)
    flight.wait(lambda: code in flight.codes, "objection")
    flight.silent()


def test_rates_that_a_ground_station_takes_away_come_back(fly) -> None:
    flight = fly(Firmware(), "GUIDED")
    rate = lambda: flight.autopilot.streams.rates_hz[mavlink.MAVLINK_MSG_ID_ATTITUDE]  # noqa: E731
    flight.wait(lambda: rate() > 90, "rate asked for")
    flight.later(1_500_000)
    with flight.autopilot.lock:
        flight.autopilot.protocol.handle(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 4, 1), 0.0)
    assert rate() == 4
    taken_us = now_us()
    flight.wait(lambda: rate() > 90, "rate asked for again")
    assert now_us() - taken_us < 5_000_000, "on the rig's clock"
