"""As real autopilots behave, over sockets and a real MAVSDK: takeovers, failsafes, a lost radio, other vehicles."""

import queue
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.core.health import HealthMonitor
from companion.core.judge import Followed, Judge, LandRequest
from companion.live.commander import Commander
from companion.messages.messages import Decision, Event
from companion.settings.link_options import link_options
from companion.settings.settings import LandingSettings, MavlinkSettings, Settings, VehicleSettings
from drivers.mavlink.link import Link
from drivers.samples import Frame, Sample
from drivers.simulated.vehicle.autopilot import SimulatedAutopilot
from drivers.simulated.vehicle.firmware import Firmware
from drivers.simulated.vehicle.vehicle import Multirotor
from drivers.system.host_clock import now_us
from landing.estimate import SurfaceEstimate

LAND = mavlink.MAV_CMD_NAV_LAND
FLAT = SurfaceEstimate(
    0,
    0.0,
    "ok",
    "map",
    inclination_deg=1.0,
    inclination_std_deg=0.1,
    roughness=0.001,
    roughness_std=0.0001,
    coverage=1.0,
    flat=True,
)
STEEP = replace(FLAT, inclination_deg=30.0, flat=False)
SWITCH = 7
PATIENCE_S = 15.0
SILENCE_S = 2.0


class Flight:
    """Everything between the autopilot and the decision, with a surface that the test chooses."""

    def __init__(self, firmware: Firmware, mode: str, **landing: object) -> None:
        vehicle = Multirotor()
        vehicle.place(0.0, 0.0, height=30.0)
        self.autopilot = SimulatedAutopilot("udpin:127.0.0.1:0", vehicle)
        self.controller = self.autopilot.controller
        self.controller.firmware = firmware
        self.controller.start_airborne(mode)
        settings = Settings(
            vehicle=VehicleSettings(system_id=1),
            mavlink=MavlinkSettings(connection=f"udpout:127.0.0.1:{self.autopilot.port}"),
            landing=LandingSettings(**landing),
        )
        self.surface = STEEP
        self.codes: tuple[str, ...] = ()
        self.command = "none"
        self.events: list[str] = []
        self._samples: queue.SimpleQueue[Sample] = queue.SimpleQueue()
        self.link = Link(link_options(settings), lambda samples: [self._samples.put(s) for s in samples])
        self._commander = Commander(self.link, lambda samples: [self._samples.put(s) for s in samples])
        self._health = HealthMonitor(settings.health, True)
        self._judge = Judge(settings, self._health, by_pilot=True)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self.autopilot.start()
        self.link.start()
        self._commander.start()
        self._thread.start()
        self.wait(lambda: self._commander.connected and self.codes, "MAVSDK and a decision")

    def close(self) -> None:
        self._stop.set()
        self._thread.join(timeout=5)
        self._commander.close()
        self.link.close()
        self.autopilot.stop()

    def wait(self, condition: Callable[[], object], what: str) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline, f"no {what}: {self.codes} {self.command} {self.events}"
            time.sleep(0.02)

    @property
    def lands(self) -> int:
        return len([c for c in self.autopilot.commands if c.command == LAND])

    def silent(self) -> None:
        """No command to land in a while over the best of surfaces."""
        lands, self.surface = self.lands, FLAT
        time.sleep(SILENCE_S)
        assert self.lands == lands, self.events

    def _run(self) -> None:
        frame = 0
        while not self._stop.wait(0.03):
            now = now_us()
            frame += 1
            self._health.count(Frame(frame, now, now, None), now)
            out: list[object] = []
            while not self._samples.empty():
                sample = self._samples.get()
                self._health.count(sample, now)
                if isinstance(sample, Followed):
                    out += self._judge.follow(sample, now, now)
            out += self._judge.see(replace(self.surface, frame=frame, time_s=now * 1e-6), now, now)
            for each in out:
                if isinstance(each, LandRequest):
                    self._commander.request(each)
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
    time.sleep(1.5)
    with flight.autopilot.lock:
        flight.autopilot.protocol.handle(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 4, 1), 0.0)
    assert rate() == 4
    taken = time.monotonic()
    flight.wait(lambda: rate() > 90, "rate asked for again")
    assert time.monotonic() - taken < PATIENCE_S / 3
