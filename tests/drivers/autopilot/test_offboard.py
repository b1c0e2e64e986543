"""Setpoints through a real MAVSDK over a real socket to a simulated ArduCopter and PX4: what ends them, what is said.

Checked by the order of messages on the link and by the vehicle's own time; one frame may be under way at any moment.
"""

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from places import TOOLS
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.autopilot.autopilot import Autopilot
from drivers.autopilot.landing_target import LandingTarget
from drivers.commands import CONTROL_MODES
from drivers.mavlink.link import Link, LinkOptions
from drivers.samples import Sample, Velocity
from drivers.simulated.vehicle.autopilot import SimulatedAutopilot
from drivers.simulated.vehicle.firmware import Firmware
from drivers.simulated.vehicle.vehicle import Multirotor
from landing.decision.procedure_options import OUR_MODES

PATIENCE_S = 600.0
SET_MODE = mavlink.MAV_CMD_DO_SET_MODE
SPEED = (0.6, 0.0, 0.0)
LEASE_S = 30.0
"""No test that flies ends by the lease, on a busy machine either."""
SETPOINT_ID = mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED.to_bytes(3, "little")
CONTROL = {"ardupilot": "GUIDED", "px4": "OFFBOARD"}


def hovering(firmware: Firmware, mode: str, connection: str = "udpin:127.0.0.1:0") -> SimulatedAutopilot:
    vehicle = Multirotor()
    vehicle.place(0.0, 0.0, height=6.0)
    autopilot = SimulatedAutopilot(connection, vehicle)
    autopilot.controller.firmware = firmware
    autopilot.controller.start_airborne(mode)
    return autopilot


class Bench:
    """A vehicle, the link to it and MAVSDK; ``log`` is what went over the link, in order."""

    def __init__(self, firmware: Firmware, mode: str) -> None:
        self.vehicle = hovering(firmware, mode)
        self.controller = self.vehicle.controller
        self.targets = LandingTarget()
        self.log: list[str] = []
        self.on_samples: Callable[[list[Sample]], None] = lambda samples: None
        options = LinkOptions(
            f"udpout:127.0.0.1:{self.vehicle.port}",
            1,
            rates_hz={"CURRENT_MODE": 20.0, "LOCAL_POSITION_NED": 30.0, "ATTITUDE": 50.0},
        )
        self.link = Link(options, self._samples, on_frame=self._frame)
        saw = self.link.gate.saw

        def heard(sample: Sample) -> None:
            saw(sample)
            if self.link.gate.ended and "ended" not in self.log:
                self.log.append("ended")

        self.link.gate.saw = heard
        self.autopilot = Autopilot(self.link)
        self.vehicle.start()
        self.link.start()
        self.wait(lambda: self.autopilot.connect(0.5), "MAVSDK")
        self.offboard = self.autopilot.offboard

    def close(self) -> None:
        self.autopilot.close()
        self.link.close()
        self.vehicle.stop()

    def wait(self, condition: Callable[[], object], what: str, patience_s: float = PATIENCE_S) -> None:
        deadline = time.monotonic() + patience_s
        while not condition():
            assert time.monotonic() < deadline, f"no {what}: {self.controller.mode} {self.link.counters}"
            time.sleep(0.01)

    def later(self, seconds: float) -> None:
        """Wait for the vehicle's own time."""
        until_s = self.vehicle.time_s + seconds
        self.wait(lambda: self.vehicle.time_s >= until_s, "vehicle's time")

    def fly(self, given_in: str) -> None:
        assert self.offboard.start(given_in, 0.0, 2.0, LEASE_S).result == "ACCEPTED"
        assert self.offboard.velocity(SPEED)
        self.wait(lambda: self.vehicle.vehicle.velocity[0] > 0.4, "motion")
        self.log.clear()

    @property
    def mode_requests(self) -> int:
        return len([c for c in self.vehicle.commands if c.command == SET_MODE])

    def ended(self) -> None:
        """Nothing but what was under way left after the vehicle had said so, nor does anything later."""
        self.wait(lambda: "ended" in self.log, "end")
        asked = self.mode_requests
        self.later(0.4)
        after = self.log[self.log.index("ended") :]
        assert after.count("setpoint") <= 1, "one may be under way"
        received = len(self.vehicle.protocol.setpoints)
        assert not self.offboard.velocity(SPEED)
        self.offboard.stop()
        self.later(0.4)
        assert len(self.vehicle.protocol.setpoints) == received
        assert self.mode_requests == asked, "no word after a takeover"
        assert any(name.startswith("orders withheld") for name in self.link.counters), (
            "MAVSDK went on by itself"
        )

    def _samples(self, samples: list[Sample]) -> None:
        for sample in samples:
            self.targets.feed(sample)
        self.on_samples(samples)

    def _frame(self, arrival_us: int, frame: bytes) -> None:
        if frame[7:10] == SETPOINT_ID:
            self.log.append("setpoint")


@pytest.fixture
def bench() -> Iterator[Callable[..., Bench]]:
    benches: list[Bench] = []

    def make(firmware: Firmware, mode: str) -> Bench:
        benches.append(Bench(firmware, mode))
        return benches[-1]

    yield make
    for each in benches:
        each.close()


@pytest.mark.parametrize(
    ("kind", "mode"), [("ardupilot", "GUIDED"), ("ardupilot", "LOITER"), ("px4", "BRAKE")]
)
def test_it_takes_over_flies_and_gives_back(bench, kind: str, mode: str) -> None:
    b = bench(Firmware(kind), mode)
    b.fly({"BRAKE": "HOLD"}.get(mode, mode))
    assert b.controller.mode == "GUIDED"
    assert b.offboard.stop().result == "ACCEPTED"
    b.wait(lambda: b.controller.mode == "BRAKE", "hold")
    received = len(b.vehicle.protocol.setpoints)
    b.later(0.5)
    assert len(b.vehicle.protocol.setpoints) == received
    assert abs(max(v[0] for _, _, v in b.vehicle.protocol.setpoints) - SPEED[0]) < 1e-6
    b.fly({"ardupilot": "BRAKE", "px4": "HOLD"}[kind])  # and once more


@pytest.mark.parametrize(("kind", "mode"), [("ardupilot", "LOITER"), ("px4", "LOITER")])
def test_the_pilots_mode_ends_it_within_a_fifth_of_a_second(
    bench, record_property, kind: str, mode: str
) -> None:
    b = bench(Firmware(kind), "GUIDED" if kind == "ardupilot" else "BRAKE")
    b.fly("GUIDED" if kind == "ardupilot" else "HOLD")
    with b.vehicle.lock:
        assert b.vehicle.set_mode(mode)
        changed_s = b.vehicle.time_s
    b.ended()
    late = [t - changed_s for t, _, _ in b.vehicle.protocol.setpoints if t > changed_s]
    record_property("last_setpoint_after_the_mode_change_s", round(max(late, default=0.0), 3))
    assert b.controller.mode == mode


def test_px4s_sticks_end_it(bench) -> None:
    b = bench(Firmware("px4"), "BRAKE")
    b.controller.parameters.values["COM_RC_OVERRIDE"] = 3
    b.fly("HOLD")
    b.vehicle.set_channel(2, 1900)
    b.ended()


def test_a_failsafe_ends_it(bench) -> None:
    b = bench(Firmware("px4"), "BRAKE")
    b.fly("HOLD")
    with b.vehicle.lock:
        b.controller.firmware.lose_ground_station(b.controller)
    b.ended()


def test_an_order_from_before_a_takeover_is_not_carried_out(bench) -> None:
    b = bench(Firmware(), "GUIDED")
    b.vehicle.set_mode("LOITER")
    b.wait(lambda: b.link.gate.mode == "LOITER", "mode")
    assert b.offboard.start("GUIDED", 0.0, 2.0, 5.0).result == "ENDED"
    assert b.autopilot.land("GUIDED").result == "ENDED"
    b.later(0.5)
    assert not b.vehicle.protocol.setpoints
    assert not b.mode_requests


def test_orders_that_stop_coming_stop_the_vehicle_though_mavsdk_goes_on(bench) -> None:
    """The pipeline hangs: the gate's lease lapses, and the autopilot's own time-out does the rest."""
    b = bench(Firmware(), "GUIDED")
    assert b.offboard.start("GUIDED", 0.0, 2.0, 1.0).result == "ACCEPTED"
    b.offboard.velocity(SPEED)
    b.wait(lambda: b.link.counters["orders withheld: order_too_old"], "lapse")
    b.wait(lambda: abs(b.vehicle.vehicle.velocity[0]) < 0.05, "standstill")
    assert b.controller.mode == "GUIDED"
    assert b.offboard.velocity(SPEED), "a fresh order goes on"


@pytest.mark.parametrize(
    ("firmware", "act", "mode"),
    [
        (Firmware(), None, "GUIDED"),
        (Firmware("px4"), 5, "BRAKE"),
        (Firmware("px4", radio="lost"), 0, "RTL"),
    ],
)
def test_the_daemons_death_is_the_autopilots_time_out(firmware: Firmware, act: int | None, mode: str) -> None:
    """A process that flies is killed: ArduCopter stands still after GUID_TIMEOUT, PX4 does what COM_OBL_RC_ACT says."""
    vehicle = hovering(firmware, "GUIDED" if act is None else "BRAKE")
    if act is not None:
        vehicle.controller.parameters.values["COM_OBL_RC_ACT"] = act
    with vehicle:
        with flying(vehicle, "GUIDED" if act is None else "HOLD") as daemon:
            os.kill(daemon.pid, signal.SIGKILL)
            daemon.wait()
        killed_s = vehicle.time_s
        while vehicle.time_s < killed_s + 0.5:
            time.sleep(0.01)
        received = len(vehicle.protocol.setpoints)
        vehicle.speed, vehicle._pace = 4.0, (time.monotonic(), vehicle.time_s)
        while vehicle.time_s < killed_s + (5.0 if act is None else 2.0):
            time.sleep(0.05)
        assert len(vehicle.protocol.setpoints) == received, "the system's buffers were empty soon"
        assert vehicle.controller.mode == mode
        if act in (None, 5):
            assert math.hypot(*vehicle.vehicle.velocity) < 0.2


@contextmanager
def flying(vehicle: SimulatedAutopilot, given_in: str) -> Iterator[subprocess.Popen[bytes]]:
    """A process that has taken over and flies."""
    script = [
        sys.executable,
        str(TOOLS / "offboard_flight.py"),
        f"udpout:127.0.0.1:{vehicle.port}",
        given_in,
    ]
    daemon = subprocess.Popen(script)
    try:
        deadline = time.monotonic() + 2 * PATIENCE_S
        while vehicle.vehicle.velocity[0] < 0.4:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        assert vehicle.controller.mode == "GUIDED"
        yield daemon
    finally:
        daemon.kill()
        daemon.wait()


@pytest.mark.parametrize("firmware", [Firmware(), Firmware("px4")], ids=["ardupilot", "px4"])
def test_the_daemons_end_by_sigterm_gives_back_before_the_process_is_gone(firmware: Firmware) -> None:
    """The setpoints stop and hold is requested and answered; afterwards nothing comes, and the vehicle stands."""
    vehicle = hovering(firmware, "GUIDED" if not firmware.px4 else "BRAKE")
    with vehicle:
        with flying(vehicle, "GUIDED" if not firmware.px4 else "HOLD") as daemon:
            daemon.send_signal(signal.SIGTERM)
            assert daemon.wait(PATIENCE_S) == 0
            assert vehicle.controller.mode == "BRAKE", "hold was in force when the process ended"
        gone_s, received = vehicle.time_s, len(vehicle.protocol.setpoints)
        vehicle.speed, vehicle._pace = 4.0, (time.monotonic(), vehicle.time_s)
        while vehicle.time_s < gone_s + 3.0:
            time.sleep(0.05)
        assert len(vehicle.protocol.setpoints) <= received + 1, "one may have been under way"
        assert vehicle.controller.mode == "BRAKE"
        assert math.hypot(*vehicle.vehicle.velocity) < 0.2


@pytest.mark.parametrize("kind", ["ardupilot", "px4"])
def test_a_landing_is_led_to_its_target(bench, kind: str) -> None:
    """1.2 m aside: down on the place, in LAND on ArduCopter and in PRECLAND on PX4."""
    b = bench(Firmware(kind), "LOITER")
    b.controller.parameters.values.update(PLND_ENABLED=1.0, PLND_TYPE=1.0)
    place = (1.2, -0.4, 0.0)
    mode = {"ardupilot": "LAND", "px4": "PRECLAND"}[kind]

    def lead(samples: list[Sample]) -> None:
        """With every position that comes, as of the newest word: at the vehicle's pace, not at this machine's."""
        position, attitude = b.targets._position, b.targets._attitude
        if position is None or attitude is None or not any(isinstance(s, Velocity) for s in samples):
            return
        away = tuple(p - q for p, q in zip(place, position.position_ned, strict=True))
        now_us = max(position.arrival_us, attitude.arrival_us)
        message = b.targets.message(away, position.arrival_us, now_us)
        if message is not None:
            b.link.send(message)
            b.log.append("target")

    b.on_samples = lead
    b.wait(lambda: "target" in b.log, "vehicle's words")
    outcome = b.autopilot.land_on_target({"ardupilot": "LOITER", "px4": "POSCTL"}[kind])
    assert outcome.result == "ACCEPTED"
    b.wait(lambda: b.controller.mode == mode, "mode")
    b.wait(lambda: b.vehicle.vehicle.on_ground, "ground", 120.0)
    n, e, _ = b.vehicle.vehicle.position
    assert math.hypot(n - place[0], e - place[1]) < 0.15


def test_where_precision_landing_is_refused_it_lands_where_it_is(bench) -> None:
    b = bench(Firmware("px4", refused=("PRECLAND",)), "LOITER")
    assert b.autopilot.land_on_target("POSCTL").result == "ACCEPTED"
    b.wait(lambda: b.controller.mode == "LAND", "landing")


def test_drivers_and_procedure_mean_the_same_modes_by_following_setpoints() -> None:
    assert CONTROL_MODES == OUR_MODES
