"""How a landing goes on and ends with real autopilots: aborts, reports, texts, settings; over sockets and MAVSDK."""

import time
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import msgspec
import numpy as np
import pytest
from estimates import FLAT
from live_rig import LAND, STEEP, Flight
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.core.landing_watch import LandingWatch
from companion.doctor.findings import DoctorOptions
from companion.doctor.link import LinkExamination
from companion.doctor.modes import mode_findings
from companion.doctor.system import settings_findings
from companion.live.reporting import GroundReport
from companion.messages.messages import Decision, Message, estimate_message
from companion.settings.settings_file import load
from drivers.autopilot.available_modes import ListedMode
from drivers.samples import EstimatorReport, Sample
from drivers.simulated.vehicle.autopilot import SimulatedAutopilot
from drivers.simulated.vehicle.autopilot_protocol import AutopilotProtocol
from drivers.simulated.vehicle.firmware import Firmware
from drivers.system.host_clock import now_us
from landing.estimate import SurfaceEstimate

SWITCH = 7
NOISE_US, CLEAR_US = 500_000, 250_000
"""Noise on good ground: unfit for less than a verdict has to stand, then fit for two steps of the rig or more."""
PERIOD_US = 5_000_000
TEXT_BYTES = 50


class Watched(Flight):
    """A flight whose landing is watched and reported of, as the daemon does it."""

    def __init__(self, firmware: Firmware, mode: str, **landing: object) -> None:
        self.noisy = False
        self.story: list[str] = []
        self.reports: list[EstimatorReport] = []
        self._watched: list[Message] = []
        super().__init__(firmware, mode, **landing)
        self._watch = LandingWatch(self.settings.landing, self.settings.decision.dwell_s)
        self._report = GroundReport(self.mavlink, np.eye(3))

    def seen(self, at_us: int) -> SurfaceEstimate:
        if self.noisy:
            return STEEP if at_us % (NOISE_US + CLEAR_US) < NOISE_US else FLAT
        return self.surface

    def published(self, message: Message) -> None:
        self._watched.append(message)
        if isinstance(message, Decision) and self.story[-1:] != [message.command_code]:
            self.story.append(message.command_code)
        for text in self._report.feed(message):
            self.link.send(text)

    def step(self, samples: list[Sample]) -> None:
        self.reports += [s for s in samples if isinstance(s, EstimatorReport)]
        super().step(samples)
        now = now_us()
        surface = self.seen(now)
        code = () if surface is FLAT else ("too_steep",)
        plain = estimate_message(surface, now, None, True)
        seen = msgspec.structs.replace(plain, against_flat=code, against_flat_codes=code)
        watched = [self._watch.feed(message) for message in [*self._watched, seen]]
        self._watched.clear()
        if any(w is not None and w.hold for w in watched):
            self.events.append("surface_unfit")
            self.logic.hold()
            self.commander.hold()


@pytest.fixture
def flights() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def fly(flights: ExitStack, firmware: Firmware, mode: str, **landing: object) -> Watched:
    flight = Watched(firmware, mode, **landing)
    flights.callback(flight.close)
    return flight


def landing(flight: Watched) -> None:
    """The permission is given and the landing begins."""
    flight.surface = FLAT
    flight.wait(lambda: flight.command == "landing", "landing")


@pytest.mark.parametrize(("kind", "mode"), [("ardupilot", "GUIDED"), ("px4", "LOITER")])
def test_noise_ends_no_landing_a_hazard_does_and_the_hold_is_our_own(
    flights: ExitStack, kind: str, mode: str
) -> None:
    flight = fly(flights, Firmware(kind), mode, enabled=True, on_unfit="hold")
    flight.start(lambda: flight.codes)
    landing(flight)
    flight.noisy = True
    flight.later(2 * (NOISE_US + CLEAR_US))
    assert "surface_unfit" not in flight.events
    assert flight.controller.mode == "LAND"
    flight.noisy, flight.surface = False, STEEP
    flight.wait(lambda: flight.command == "held", "own hold")
    assert flight.controller.mode == "BRAKE"  # PX4's HOLD
    assert "taken_over" not in flight.story
    flight.wait(lambda: "own_hold" in flight.codes, "the permission's end")
    flight.silent()


def test_px4_a_takeover_before_the_next_heartbeat_is_the_pilots(flights: ExitStack) -> None:
    flight = fly(flights, Firmware("px4"), "LOITER", enabled=True)
    flight.start(lambda: flight.codes)
    flight.surface = FLAT
    flight.wait(lambda: flight.command in ("accepted", "landing"), "acceptance")
    flight.autopilot.set_mode("ALT_HOLD")  # the HEARTBEAT comes once a second
    flight.wait(lambda: flight.command == "taken_over", "takeover")
    assert "no_mode_change" not in flight.story
    flight.silent()


def test_a_verdict_that_flickers_is_one_short_text_in_five_seconds(
    flights: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    flight = fly(flights, Firmware(), "GUIDED", enable_rc_channel=SWITCH)
    texts: list[tuple[int, Any]] = []
    handle = AutopilotProtocol.handle

    def listening(self: AutopilotProtocol, message: Any, *more: Any) -> Any:
        if message.get_type() == "STATUSTEXT":
            texts.append((now_us(), message))
        return handle(self, message, *more)

    monkeypatch.setattr(AutopilotProtocol, "handle", listening)
    flight.start(lambda: flight.codes)
    began_us = now_us()
    for k in range(5):  # a verdict needs 0.8 s to stand
        flight.surface = STEEP if k % 2 else FLAT
        flight.later(1_400_000)
    flight.wait(lambda: texts, "text")
    verdicts = [at_us for at_us, m in texts if m.id == 0 and ("fit" in m.text or "unknown" in m.text)]
    assert verdicts
    assert len(verdicts) <= 1 + (now_us() - began_us) // PERIOD_US
    assert all(len(m.text.encode()) <= TEXT_BYTES for _, m in texts)
    chunks: dict[int, list[int]] = {}
    for _, m in texts:
        if m.id:
            chunks.setdefault(m.id, []).append(m.chunk_seq)
    assert all(numbers == list(range(len(numbers))) for numbers in chunks.values())


def test_doctor_says_of_modes_and_switch_what_run_does(flights: ExitStack) -> None:
    """A ground station's names of PX4's modes, and a switch on a radio that is not there."""
    words = ["landing.enable_modes=Altitude", "landing.allowed_modes=['Position','Altitude']"]
    settings = load(None, words).settings.landing
    (ways,) = [f for f in settings_findings(load(None, words)) if f.subject == "landing"]
    assert ways.level == "ok"
    assert "ALTCTL" in ways.text
    listed = (ListedMode("POSCTL", "", True), ListedMode("ALTCTL", "", True))
    assert [f.level for f in mode_findings(settings, listed)] == ["ok"]
    flight = fly(
        flights,
        Firmware("px4"),
        "LOITER",
        enable_modes=settings.enable_modes,
        allowed_modes=settings.allowed_modes,
    )
    flight.start(lambda: flight.codes)
    flight.wait(lambda: flight.codes[0] == "switch_off", "mode that is off")
    flight.autopilot.set_mode("ALT_HOLD")
    landing(flight)
    assert flight.orders(LAND) == 1


def test_doctor_says_that_nothing_is_requested_without_a_radio(flights: ExitStack) -> None:
    firmware = Firmware("px4", radio="none")
    with SimulatedAutopilot("tcp:127.0.0.1:0") as autopilot:
        autopilot.controller.firmware = firmware
        words = [f"mavlink.connection=tcp:127.0.0.1:{autopilot.port}", f"landing.enable_rc_channel={SWITCH}"]
        examination = LinkExamination(load(None, words).settings, DoctorOptions())
        deadline = time.monotonic() + 300
        found: list[str] = []
        while not found and time.monotonic() < deadline:
            examination.look()
            time.sleep(0.5)
            found = [f.level for f in examination.findings() if f.subject == "radio"]
        examination.close()
    assert found == ["failure"]
    flight = fly(flights, Firmware("px4", radio="none"), "LOITER", enable_rc_channel=SWITCH)
    flight.start(lambda: flight.codes)
    assert flight.codes[0] == "switch_not_renewed"
    flight.silent()


def test_without_gps_the_autopilots_doubt_comes_over_the_link(flights: ExitStack) -> None:
    flight = fly(flights, Firmware(), "GUIDED")
    flight.start(lambda: flight.codes)
    flight.wait(lambda: any(r.velocity_known for r in flight.reports), "estimator that is well")
    with flight.autopilot.lock:
        flight.controller.firmware = Firmware(gps=False)
    flight.reports.clear()
    flight.wait(lambda: any(r.velocity_known is False for r in flight.reports), "doubt of the velocity")
    assert mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT in flight.autopilot.streams.rates_hz


def test_before_its_origin_ardupilots_velocity_is_missing_and_no_rate_is_too_low(flights: ExitStack) -> None:
    flight = fly(flights, Firmware(origin=False), "GUIDED")
    faults: list[str] = []
    flight.link._on_event = lambda event: faults.append(event.event)
    flight.start(lambda: flight.codes)
    asked = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED
    flight.wait(lambda: flight.autopilot.streams.rates_hz.get(asked, 0) > 20, "request for the velocity")
    flight.later(5_000_000)
    assert "rate_too_low" not in faults
    assert not flight.link.slow
    with flight.autopilot.lock:
        flight.controller.firmware.origin = True
    flight.wait(lambda: flight.link.rates.rates_hz.get("LOCAL_POSITION_NED", 0) > 20, "velocities")
