"""MAV_CMD_NAV_LAND through a real MAVSDK over a real UDP socket, against every way an autopilot may answer."""

import time
from collections.abc import Callable, Iterator

import pytest
import vehicle_support as vs
from ports import free_udp_port
from vehicle_support import TestVehicle

from drivers.autopilot.autopilot import Autopilot
from drivers.mavlink.framing import FrameSplitter, WireFrame
from drivers.mavlink.link import Link, LinkOptions
from drivers.mavlink.signing import Signer
from drivers.samples import CommandAnswer, Sample

Setup = tuple[TestVehicle, Link, Autopilot, list[Sample]]


@pytest.fixture
def setup() -> Iterator[Callable[..., Setup]]:
    closers: list[Callable[[], None]] = []

    def make(answer: tuple[tuple[float, int], ...], key: bytes | None = None, **options: object) -> Setup:
        port = free_udp_port()
        samples: list[Sample] = []
        link = Link(
            LinkOptions(f"udpin:127.0.0.1:{port}", system_id=1, signing_key=key, **options), samples.extend
        )
        autopilot = Autopilot(link)
        vehicle = TestVehicle(port, answer, seal=Signer(key, link_id=2).sign if key else None)
        vehicle.__enter__()
        link.start()
        closers.extend((autopilot.close, link.close, lambda: vehicle.__exit__()))
        deadline = time.monotonic() + 300
        while not autopilot.connect(0.5) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert autopilot.connected
        return vehicle, link, autopilot, samples

    yield make
    for close in closers:
        close()


@pytest.mark.parametrize(
    ("answer", "result", "answers"),
    [
        (vs.ACCEPTED, "ACCEPTED", ("ACCEPTED",)),
        (vs.DENIED, "DENIED", ("DENIED",)),
        (vs.TEMPORARILY_REJECTED, "TEMPORARILY_REJECTED", ("TEMPORARILY_REJECTED",)),
        (vs.IN_PROGRESS_ACCEPTED, "ACCEPTED", ("IN_PROGRESS", "ACCEPTED")),
        (vs.IN_PROGRESS_SILENCE, "NO_ANSWER", ("IN_PROGRESS",)),
        (vs.SILENCE, "NO_ANSWER", ()),
    ],
)
def test_every_answer_and_silence_has_its_name(setup, answer, result, answers) -> None:
    vehicle, _, autopilot, samples = setup(answer)
    outcome = autopilot.land()
    assert (outcome.result, tuple(dict.fromkeys(outcome.answers))) == (result, answers)
    assert len(vehicle.land_commands()) <= (1 if answers and answers[0] != "IN_PROGRESS" else 4)

    def reported() -> tuple[str, ...]:
        return tuple(s.result for s in list(samples) if isinstance(s, CommandAnswer) and s.command == 21)

    deadline = time.monotonic() + 300
    while reported() != outcome.answers:
        assert time.monotonic() < deadline, (reported(), outcome.answers)
        time.sleep(0.01)


def test_mavsdk_on_a_signed_link_signs_too(setup) -> None:
    key = bytes(range(32))
    vehicle, _, autopilot, _ = setup(vs.ACCEPTED, key)
    assert autopilot.land().result == "ACCEPTED"
    splitter, checker = FrameSplitter(), Signer(key)
    frames = [f for raw in vehicle.received_raw for f in splitter.feed(raw) if isinstance(f, WireFrame)]
    assert all(checker.refusal(frame) is None for frame in frames)
    assert {0, 76, 111} <= {frame.message_id for frame in frames}, "heartbeat, command, time"


def test_mavsdks_own_request_for_a_rate_does_not_reach_the_autopilot(setup) -> None:
    """It asks for EXTENDED_SYS_STATE at 1 Hz at every start."""
    vehicle, link, _, _ = setup(vs.ACCEPTED, rates_hz={"EXTENDED_SYS_STATE": 5.0})
    deadline = time.monotonic() + 300
    while not link.counters["rate requests of MAVSDK answered"] and time.monotonic() < deadline:
        time.sleep(0.05)
    assert link.counters["rate requests of MAVSDK answered"] == 1, "answered, so it does not repeat it"
    asked = [c.param2 for _, c in vehicle.commands if c.command == 511 and c.param1 == 245]
    assert set(asked) == {200_000.0}
