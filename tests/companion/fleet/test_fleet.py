"""A fleet under a real embedded router: losses, certificates, and who may write what."""

import dataclasses
import json
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from fleet_support import Authority
from places import REPOSITORY

from companion.cli import main
from companion.errors import LandslopeError
from companion.fleet import fleet, fleet_router
from companion.messages.messages import encode, estimate_message
from drivers.bus import Bus, Delivery, Endpoints, Subscription, open_session
from drivers.errors import DriverError
from landing.estimate import SurfaceEstimate

SYSTEMD = REPOSITORY / "systemd"
EXAMPLE = REPOSITORY / "docs" / "examples" / "subscriber.py"
WAIT_S = 600.0


def eventually(true: Callable[[], bool]) -> bool:
    end = time.monotonic() + WAIT_S
    while time.monotonic() < end:
        if true():
            return True
        time.sleep(0.02)
    return False


def test_twenty_vehicles_at_30_hz_are_all_heard(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fleet", "measure", "--vehicles", "20", "--rate", "30", "--seconds", "2"]) == 0
    words = capsys.readouterr().out
    assert "vehicles heard   20 of 20" in words
    assert "messages sent    1200" in words
    assert "duplicated       0" in words
    # Publishers drop rather than block, so that a busy machine may lose some; half would be a fault.
    received = int(words.split("received")[1].split()[0])
    assert received > 600
    assert "latency          median" in words


def test_measuring_without_a_router_is_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fleet", "measure", "--router", fleet.free_endpoint(), "--seconds", "1"]) == 2
    assert "no session as client" in capsys.readouterr().err
    assert main(["fleet", "measure", "--vehicles", "0"]) == 2
    assert "vehicles is 0; it must be from 1 to 500" in capsys.readouterr().err


class SecureFleet:
    """A router with the shipped configuration, its paths and endpoint put in place of the examples'."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.authority = Authority(folder / "pki", "fleet authority")
        self.authority.issue("router", server=True)
        for name in ("vehicle1", "vehicle2", "vehicle3", "watcher1"):
            self.authority.issue(name)
        self.endpoint = fleet.free_endpoint().replace("tcp/", "tls/")
        text = (SYSTEMD / "zenoh-router.json5").read_text()
        text = text.replace("/etc/landslope/pki", str(folder / "pki"))
        config = folder / "router.json5"
        config.write_text(text.replace("tls/0.0.0.0:7447", self.endpoint))
        self.router = open_session(Endpoints(mode="router", config_file=str(config)))

    def endpoints(self, name: str, certificates: Path | None = None) -> Endpoints:
        text = (SYSTEMD / "zenoh-tls.json5").read_text().replace("vehicle1", name)
        text = text.replace("/etc/landslope/pki", str(certificates or self.folder / "pki"))
        config = self.folder / f"{name}.json5"
        config.write_text(text.replace("tls/router.example:7447", self.endpoint))
        return Endpoints(mode="client", config_file=str(config))


@pytest.fixture(scope="module")
def secure(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SecureFleet]:
    found = SecureFleet(tmp_path_factory.mktemp("fleet"))
    yield found
    found.router.close()


def received(watcher: Subscription, *expected: bytes, quiet_s: float = 0.7) -> list[Delivery]:
    """Everything that comes until the expected payloads are there and nothing has come for a while."""
    found: list[Delivery] = []
    end = time.monotonic() + WAIT_S
    while True:
        delivery = watcher.receive(quiet_s)
        if delivery is not None:
            found.append(delivery)
        elif {d.payload for d in found} >= set(expected) or time.monotonic() > end:
            return found


def test_a_vehicle_writes_only_its_own_keys_and_a_watcher_none(secure: SecureFleet) -> None:
    with ExitStack() as stack:
        watcher = stack.enter_context(Subscription(secure.endpoints("watcher1")))
        one = stack.enter_context(Bus("vehicle1", secure.endpoints("vehicle1")))
        two = stack.enter_context(Bus("vehicle2", secure.endpoints("vehicle2")))
        assert eventually(lambda: one.subscribed("estimate") and two.subscribed("estimate"))
        unlisted = stack.enter_context(Bus("vehicle3", secure.endpoints("vehicle3")))
        liar = stack.enter_context(Bus("vehicle1", secure.endpoints("vehicle2")))
        second_watcher = stack.enter_context(open_session(secure.endpoints("watcher1")))
        one.answer("configuration", b"honest")
        liar.answer("configuration", b"a lie")
        second_watcher.put("landslope/vehicle1/estimate", b"from a watcher")
        liar.put("estimate", b"from vehicle2 as vehicle1")
        unlisted.put("estimate", b"from a vehicle that is not listed")
        one.put("estimate", b"1")
        two.put("estimate", b"2")
        found = received(watcher, b"1", b"2")
        assert {(d.vehicle, d.payload) for d in found if d.alive is None} == {
            ("vehicle1", b"1"),
            ("vehicle2", b"2"),
        }
        assert sorted(d.vehicle for d in found if d.alive) == ["vehicle1", "vehicle2"]
        answers = [
            reply.ok.payload.to_bytes()
            for reply in second_watcher.get("landslope/*/configuration", timeout=WAIT_S)
            if reply.ok is not None
        ]
        assert answers == [b"honest"]
        one.close()
        assert eventually(lambda: any(d.alive is False for d in received(watcher, quiet_s=0.1)))


def test_a_vehicle_hears_no_other_vehicle(secure: SecureFleet) -> None:
    heard: list[bytes] = []
    with ExitStack() as stack:
        watcher = stack.enter_context(Subscription(secure.endpoints("watcher1")))
        nosy = stack.enter_context(open_session(secure.endpoints("vehicle2")))
        nosy.declare_subscriber("landslope/**", lambda sample: heard.append(sample.payload.to_bytes()))
        one = stack.enter_context(Bus("vehicle1", secure.endpoints("vehicle1")))
        assert eventually(lambda: one.subscribed("estimate"))
        one.put("estimate", b"1")
        assert [d.payload for d in received(watcher, b"1") if d.alive is None] == [b"1"]
    assert heard == []


def test_a_monitor_which_waits_for_its_router_as_a_peer_hears_the_fleet(secure: SecureFleet) -> None:
    peer = dataclasses.replace(secure.endpoints("watcher1"), mode="peer")
    with (
        Subscription(peer, topics=("estimate",)) as watcher,
        Bus("vehicle1", secure.endpoints("vehicle1")) as one,
    ):
        assert eventually(lambda: watcher.links() == 1)
        assert eventually(lambda: one.subscribed("estimate"))
        one.put("estimate", b"1")
        assert [d.payload for d in received(watcher, b"1") if d.alive is None] == [b"1"]


def test_wrong_clients_are_refused(secure: SecureFleet, tmp_path: Path) -> None:
    stranger = Authority(tmp_path / "pki", "another authority")
    stranger.issue("vehicle1")
    # Trusts the fleet's router, but shows a certificate that another authority signed.
    (tmp_path / "pki" / "ca.pem").write_bytes((secure.folder / "pki" / "ca.pem").read_bytes())
    with pytest.raises(DriverError, match="no session"):
        Bus("vehicle1", secure.endpoints("vehicle1", tmp_path / "pki"))
    anonymous = tmp_path / "anonymous.json5"
    anonymous.write_text(
        json.dumps(
            {
                "mode": "client",
                "connect": {"endpoints": [secure.endpoint]},
                "transport": {"link": {"tls": {"root_ca_certificate": str(secure.folder / "pki/ca.pem")}}},
            }
        )
    )
    with pytest.raises(DriverError, match="no session"):
        Bus("vehicle1", Endpoints(mode="client", config_file=str(anonymous)))
    with pytest.raises(DriverError, match="no session"):
        Bus("vehicle1", Endpoints(mode="client", connect=(secure.endpoint.replace("tls/", "tcp/"),)))


def test_a_router_with_another_authoritys_certificate_is_not_trusted(
    secure: SecureFleet, tmp_path: Path
) -> None:
    stranger = Authority(tmp_path / "pki", "another authority")
    for name in ("vehicle1.pem", "vehicle1.key"):
        (tmp_path / "pki" / name).write_bytes((secure.folder / "pki" / name).read_bytes())
    assert stranger.certificate.subject
    with pytest.raises(DriverError, match="no session"):
        Bus("vehicle1", secure.endpoints("vehicle1", tmp_path / "pki"))


def test_the_shipped_files_are_what_the_command_writes(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--vehicle", "vehicle1", "--vehicle", "vehicle2", "--watcher", "watcher1"]
    assert main(["fleet", "router", *words]) == 0
    assert capsys.readouterr().out == (SYSTEMD / "zenoh-router.json5").read_text()
    assert main(["fleet", "client", "vehicle1", "--connect", "tls/router.example:7447"]) == 0
    assert capsys.readouterr().out == (SYSTEMD / "zenoh-tls.json5").read_text()


@pytest.mark.parametrize("name", ["", "a/b", "*", "a b", "a$b", "é"])
def test_names_that_would_widen_the_access_are_refused(name: str) -> None:
    with pytest.raises(LandslopeError, match="cannot be a name"):
        fleet_router.access_control([name], [])


def test_a_name_twice_is_refused() -> None:
    with pytest.raises(LandslopeError, match="same name"):
        fleet_router.access_control(["one"], ["one"])


def test_a_served_router_carries_the_documented_subscriber() -> None:
    endpoint = fleet.free_endpoint()
    with ExitStack() as stack:
        router = start(stack, "-m", "companion.cli", "fleet", "serve", "--listen", endpoint)
        assert "is up" in line_of(router)
        bus = stack.enter_context(Bus("vehicle1", Endpoints(mode="client", connect=(endpoint,))))
        reader = start(stack, str(EXAMPLE), endpoint)
        assert eventually(lambda: bus.subscribed("estimate"))
        surface = SurfaceEstimate(frame=7, time_s=0.0, status="ok", method="map", inclination_deg=12.5)
        bus.put("estimate", encode(estimate_message(surface, 1, None, True)))
        assert line_of(reader).split() == ["landslope/vehicle1/estimate", "7", "ok", "12.5"]
        router.send_signal(signal.SIGTERM)
        assert router.wait(WAIT_S) == 0


def start(stack: ExitStack, *words: str) -> "subprocess.Popen[str]":
    process = stack.enter_context(
        subprocess.Popen([sys.executable, *words], stdout=subprocess.PIPE, text=True)
    )
    stack.callback(process.kill)
    return process


def line_of(process: "subprocess.Popen[str]") -> str:
    """Its next line; the test's own timeout is that the process is killed when it never comes."""
    assert process.stdout is not None
    timer = threading.Timer(WAIT_S, process.kill)
    timer.start()
    try:
        return process.stdout.readline()
    finally:
        timer.cancel()
