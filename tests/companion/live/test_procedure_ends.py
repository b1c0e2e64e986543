"""Everything that may end the landing procedure, over sockets and a real MAVSDK: no setpoint leaves after it.

The ground is made up (all of it landable, seen perfectly); decision, permission, procedure, steering, link and MAVSDK
are the real ones. Checked by the order of messages and by the vehicle's own time.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from estimates import FLAT
from live_rig import LiveRig
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.core.approach import Approach, Ordered
from companion.core.decision_logic import DecisionLogic, Followed, LandRequest
from companion.core.health import HealthMonitor
from companion.live.commander import Commander
from companion.live.steering import Steering
from companion.messages.messages import Decision, Event
from companion.settings.link_options import link_options
from companion.settings.settings import LandingSettings, Settings, VehicleSettings
from drivers.mavlink.link import Link
from drivers.samples import Frame, Sample, Velocity
from drivers.simulated.vehicle.firmware import Firmware
from drivers.simulated.vehicle.vehicle import Multirotor
from drivers.system.host_clock import now_us
from landing.decision.orders import OrderKind
from landing.ground.ground import Sight
from landing.ground.spots import LANDABLE, Disc, Spot
from landing.reasons import Status
from landing.vision.camera import CameraModel

SET_MODE, LAND = mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_NAV_LAND
SETPOINT = mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED.to_bytes(3, "little")
SWITCH = 7
CAMERA = CameraModel(
    320, 240, np.array([[200.0, 0, 160], [0, 200.0, 120], [0, 0, 1]]), np.zeros(5), np.eye(3)
)


class PerfectGround:
    """Level ground everywhere, a place 5 m north of where it began, and ``error_m`` of the place that it tells."""

    def __init__(self, vehicle: Multirotor) -> None:
        self._vehicle = vehicle
        self.error_m = self.error_up_m = 0.0

    @property
    def sight(self) -> Sight:
        n, e, d = self._vehicle.position
        place = n + self.error_m, e, d - self.error_up_m
        return Sight(place, self._vehicle.velocity, -d, 0.05, 0.0, -d, 0.1)

    def spots(self, drift_m: tuple[float, float] = (0.0, 0.0)) -> tuple[Spot, ...]:
        n, e, _ = self._vehicle.position
        return (Spot(5.0 - n, -e, 0.5, 0.5, 0.0, 3.0),)

    def clear_m(self, reach_m: float) -> float:
        return -self._vehicle.position[2]

    def at(self, north_m: float, east_m: float) -> Disc:
        return Disc(LANDABLE, (), 0.5, 0.1, 0.0, 1.0)


class Flight(LiveRig):
    """The daemon from the link to the orders, with frames and ground that the test chooses."""

    def __init__(self, firmware: Firmware, mode: str, **landing: object) -> None:
        super().__init__(firmware, mode, 5.0)
        named = {"LOITER": "POSCTL" if firmware.px4 else "LOITER"}.get(mode, mode)
        options = {
            "procedure": "offboard",
            "takeover_modes": (named,),
            "enable_rc_channel": SWITCH + 1,
        } | landing
        self.settings = Settings(
            vehicle=VehicleSettings(system_id=1, max_search_m=8.0),
            mavlink=self.mavlink,
            landing=LandingSettings(**options),
        )
        self.frames, self.status, self.flat = True, Status.OK, False
        self.ground_speed_m_s = 0.05
        self._frames_seen = 0
        self.ground = PerfectGround(self.vehicle)
        self.state, self.why, self.given_back = "", "", ""
        self.log: list[str] = []
        self.link = Link(link_options(self.settings), self.put, on_frame=self._frame)
        saw = self.link.gate.saw

        def heard(sample: Sample) -> None:
            saw(sample)
            if self.link.gate.ended:
                self._ended()

        self.link.gate.saw = heard
        on_target = self.settings.landing.procedure == "landing_target"
        self.commander = Commander(self.link, self.put, on_target=on_target)
        self._steering = Steering(self.settings, self.link, self.commander)
        self._health = HealthMonitor(self.settings.health, True)
        self.logic = DecisionLogic(
            self.settings,
            self._health,
            by_pilot=True,
            approach=lambda consent: Approach(self.settings, CAMERA, self.ground, consent),
        )
        self.start(lambda: self.state)

    def where(self) -> object:
        return self.state, self.why, self.controller.mode, self.events[-5:]

    def flying(self) -> None:
        """The pilot permits it; it takes over and is on its way."""
        self.autopilot.set_channel(SWITCH + 1, 1100)
        self.wait(lambda: "switch_off" in self.codes, "switch that is off")
        self.autopilot.set_channel(SWITCH + 1, 1900)
        self.wait(
            lambda: self.autopilot.vehicle.velocity[0] > 0.3 or self.autopilot.vehicle.velocity[1] > 0.3,
            "motion",
        )
        assert self.controller.mode == "GUIDED"
        self.log.clear()

    def over(self, why: str, *, holds: bool) -> None:
        """Given back for that reason: nothing but what was under way leaves, and hold is asked for or not."""
        asked = self.orders(SET_MODE)
        self.wait(lambda: self.given_back and "ended" in self.log, "end")
        until_s = self.autopilot.time_s + 0.8
        self.wait(lambda: self.autopilot.time_s > until_s, "vehicle's time")
        assert self.given_back == why
        assert self.log[self.log.index("ended") :].count("setpoint") <= 1, "one may be under way"
        assert self.orders(SET_MODE) - asked == (1 if holds else 0)
        assert self.orders(LAND) == 0
        assert "procedure_gave_back" in self.events
        if holds:
            assert self.controller.mode == "BRAKE"

    def _ended(self) -> None:
        if "ended" not in self.log:
            self.log.append("ended")

    def _frame(self, arrival_us: int, frame: bytes) -> None:
        if frame[7:10] == SETPOINT:
            self.log.append("setpoint")

    def step(self, samples: list[Sample]) -> None:
        now = now_us()
        out: list[object] = []
        self._steering.feed(samples)
        for sample in samples:
            self._health.count(sample, now)
            if isinstance(sample, Followed):
                out += self.logic.follow(sample, now, now)
            elif isinstance(sample, Velocity):
                self.logic.locate(sample.position_ned, now)
            out += self.logic.watch(now, now, now * 1e-6)
        if self.frames:
            self._frames_seen += 1
            self._health.count(Frame(self._frames_seen, now, now, None), now)
            seen = replace(
                FLAT,
                frame=self._frames_seen,
                time_s=now * 1e-6,
                status=self.status,
                flat=self.flat,
                ground_speed_m_s=self.ground_speed_m_s,
                ground_speed_std_m_s=0.05,
            )
            out += self.logic.see(seen, now, now, np.eye(3))
        for each in out:
            if isinstance(each, Ordered):
                self._steering.carry_out(each.order, each.time_unix_us)
                if each.order.kind in (OrderKind.NONE, OrderKind.STOP):
                    self._ended()
            elif isinstance(each, LandRequest):
                self.commander.request(each)
            elif isinstance(each, Event):
                self.events.append(each.event)
            elif isinstance(each, Decision):
                if getattr(each.procedure, "state", "") == "give_back":
                    self.given_back = self.given_back or each.procedure.code
                self.codes = each.withheld_codes
                self.state, self.why = (
                    getattr(each.procedure, "state", "none"),
                    getattr(each.procedure, "code", ""),
                )


@pytest.fixture
def fly() -> Iterator[Callable[..., Flight]]:
    flights: list[Flight] = []

    def make(kind: str = "ardupilot", mode: str = "LOITER", **landing: object) -> Flight:
        flights.append(Flight(Firmware(kind), mode, **landing))
        return flights[-1]

    yield make
    for flight in flights:
        flight.close()


@pytest.mark.parametrize("kind", ["ardupilot", "px4"])
def test_the_pilots_mode(fly, kind: str) -> None:
    flight = fly(kind)
    flight.flying()
    with flight.autopilot.lock:
        flight.autopilot.set_mode("LOITER")
    flight.over("mode_left", holds=False)
    assert flight.controller.mode == "LOITER"


def test_the_pilots_switch(fly) -> None:
    flight = fly()
    flight.flying()
    flight.autopilot.set_channel(SWITCH + 1, 1100)
    flight.over("permission_ended", holds=True)


def test_the_pilots_sticks(fly) -> None:
    flight = fly()
    flight.flying()
    flight.autopilot.set_channel(1, 1900)
    flight.over("permission_ended", holds=True)


def test_no_pictures(fly) -> None:
    flight = fly()
    flight.flying()
    flight.frames = False
    flight.over("permission_ended", holds=True)  # the frames are stale


def test_pictures_that_contradict_the_vehicle(fly) -> None:
    flight = fly()
    flight.flying()
    flight.status = Status.ROTATION_CONTRADICTS
    flight.over("contradicted", holds=True)


def test_a_failsafe(fly) -> None:
    flight = fly("px4")
    flight.flying()
    with flight.autopilot.lock:
        flight.controller.firmware.lose_ground_station(flight.controller)
    flight.over("mode_left", holds=False)


def test_the_fence(fly) -> None:
    flight = fly()
    flight.flying()
    flight.ground.error_m = 30.0
    flight.over("fence_distance", holds=True)


def test_the_fence_of_height(fly) -> None:
    flight = fly()
    flight.flying()
    flight.ground.error_up_m = 9.0
    flight.over("fence_height", holds=True)


def test_ground_that_moves(fly) -> None:
    flight = fly()
    flight.flying()
    flight.ground_speed_m_s = 1.0
    flight.over("ground_moves", holds=True)


def test_time(fly) -> None:
    flight = fly(max_time_s=4.0)
    flight.flying()
    flight.over("fence_time", holds=True)


def test_without_an_end_it_goes_to_the_place_and_hands_over(fly) -> None:
    flight = fly()
    flight.flying()
    flight.wait(lambda: flight.orders(LAND) == 1, "hand-over")
    flight.wait(lambda: flight.controller.mode == "LAND", "landing")
    n, e, _ = flight.autopilot.vehicle.position
    assert abs(n - 5.0) < 0.4
    assert abs(e) < 0.4
    received = len(flight.autopilot.protocol.setpoints)
    until_s = flight.autopilot.time_s + 0.5
    flight.wait(lambda: flight.autopilot.time_s > until_s, "vehicle's time")
    assert len(flight.autopilot.protocol.setpoints) <= received + 1
    speeds = [v for _, _, v in flight.autopilot.protocol.setpoints]
    limit = flight.settings.landing.max_speed_m_s
    assert max(np.hypot(n, e) for n, e, _ in speeds) <= limit + 1e-3
    assert max(abs(d) for *_, d in speeds) <= limit + 1e-3


def test_the_daemons_end_gives_back(fly) -> None:
    flight = fly()
    flight.flying()
    assert flight.commander.close()
    flight.wait(lambda: flight.controller.mode == "BRAKE", "hold")
    flight.log.clear()
    until_s = flight.autopilot.time_s + 0.5
    flight.wait(lambda: flight.autopilot.time_s > until_s, "vehicle's time")
    assert "setpoint" not in flight.log


@pytest.mark.parametrize(("kind", "mode"), [("ardupilot", "LAND"), ("px4", "PRECLAND")])
def test_a_landing_is_reported_where_to(fly, kind: str, mode: str) -> None:
    """Nothing but the landing is commanded, and it ends on the place 5 m north."""
    flight = fly(kind, procedure="landing_target")
    flight.controller.parameters.values.update(PLND_ENABLED=1.0, PLND_TYPE=1.0)
    flight.autopilot.set_channel(SWITCH + 1, 1100)
    flight.wait(lambda: "switch_off" in flight.codes, "switch that is off")
    flight.autopilot.set_channel(SWITCH + 1, 1900)
    flight.flat = True
    flight.wait(lambda: flight.controller.mode == mode, "landing")
    flight.wait(lambda: flight.autopilot.vehicle.on_ground, "touchdown")
    n, e, _ = flight.autopilot.vehicle.position
    assert abs(n - 5.0) < 0.3
    assert abs(e) < 0.3
    assert not flight.autopilot.protocol.setpoints
    flight.wait(lambda: "landing_landed" in flight.events, "word of it")
    assert "landing_taken_over" not in flight.events
