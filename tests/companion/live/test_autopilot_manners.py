"""As real autopilots behave, over sockets and a real MAVSDK: takeovers, failsafes, a lost radio, other vehicles."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import pytest
from estimates import FLAT
from live_rig import LiveRig
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.core.decision_logic import DecisionLogic, Followed, LandRequest
from companion.core.health import HealthMonitor
from companion.live.commander import Commander
from companion.messages.messages import Decision, Event
from companion.settings.link_options import link_options
from companion.settings.settings import LandingSettings, Settings, VehicleSettings
from drivers.mavlink.link import Link
from drivers.samples import Frame, Sample
from drivers.simulated.vehicle.firmware import Firmware
from drivers.system.host_clock import now_us

LAND = mavlink.MAV_CMD_NAV_LAND
STEEP = replace(FLAT, inclination_deg=30.0, flat=False)
SWITCH = 7
SILENCE_US = 2_000_000
"""On the rig's clock: twice as long as a verdict has to stand."""


class Flight(LiveRig):
    """Everything between the autopilot and the decision, with a surface that the test chooses."""

    def __init__(self, firmware: Firmware, mode: str, **landing: object) -> None:
        super().__init__(firmware, mode, 30.0)
        settings = Settings(
            vehicle=VehicleSettings(system_id=1),
            mavlink=self.mavlink,
            landing=LandingSettings(**landing),
        )
        self.surface = STEEP
        self.command = "none"
        self._frame = 0
        self.link = Link(link_options(settings), self.put)
        self.commander = Commander(self.link, self.put)
        self._health = HealthMonitor(settings.health, True)
        self.logic = DecisionLogic(settings, self._health, by_pilot=True)
        self.start(lambda: self.codes)

    def where(self) -> object:
        return self.codes, self.command, self.events

    @property
    def lands(self) -> int:
        return self.orders(LAND)

    def silent(self) -> None:
        """No command to land in a while over the best of surfaces."""
        lands, self.surface = self.lands, FLAT
        self.later(SILENCE_US)
        assert self.lands == lands, self.events

    def later(self, duration_us: int) -> None:
        """Let that much time of the rig's clock pass."""
        until_us = now_us() + duration_us
        self.wait(lambda: now_us() >= until_us, "time")

    def step(self, samples: list[Sample]) -> None:
        now = now_us()
        self._frame += 1
        self._health.count(Frame(self._frame, now, now, None), now)
        out: list[object] = []
        for sample in samples:
            self._health.count(sample, now)
            if isinstance(sample, Followed):
                out += self.logic.follow(sample, now, now)
        out += self.logic.see(replace(self.surface, frame=self._frame, time_s=now * 1e-6), now, now)
        for each in out:
            if isinstance(each, LandRequest):
                self.commander.request(each)
            elif isinstance(each, Event):
                self.events.append(each.event)
            elif isinstance(each, Decision):
                self.codes, self.command = each.withheld_codes or ("none",), each.command_code


@pytest.fixture
def fly() -> Iterator[Callable[..., Flight]]:
    flights: list[Flight] = []

    def make(firmware: Firmware, mode: str, **landing: object) -> Flight:
        flights.append(Flight(firmware, mode, **landing))
        return flights[-1]

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
