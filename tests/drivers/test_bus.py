"""The bus over real sockets: watchers and routers in other processes."""

import json
import os
import signal
import time
import typing
from pathlib import Path

import msgspec
import pytest
import zenoh
from bus_support import PATIENCE_S, Watcher, alive, router
from ports import free_endpoint

from companion.messages.messages import Decision, Estimate, Event
from drivers.bus import CONFIGURATION, DECISION, IMPORTANT_BATCHES, Bus, Endpoints, Subscription, open_session
from drivers.bus import _config as bus_config
from drivers.errors import DriverError

MESSAGES = {"estimate": Estimate, "decision": Decision, "event": Event}


def message(topic: str, **fields) -> bytes:
    """A message that follows the schema of its topic, with further fields."""
    filling = ((type(None), None), (tuple, []), (dict, {}), (bool, False), (int, 0), (str, ""))
    required = {
        field.name: next(value for kind, value in filling if kind in bare(field.type))
        for field in msgspec.structs.fields(MESSAGES[topic])
        if field.required
    }
    return json.dumps(required | fields).encode()


def bare(kind) -> tuple:
    """The types that an annotation allows."""
    kind = typing.get_args(kind)[0] if hasattr(kind, "__metadata__") else kind
    return (typing.get_origin(kind) or kind, *typing.get_args(kind))


def numbered(topic: str, number: int) -> bytes:
    return message(topic, number=number, padding="x" * 800)


def wait_until(condition) -> None:
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)


@pytest.mark.parametrize("through", ["peer to peer", "router as peer", "router as client"])
def test_a_watcher_in_another_process_gets_every_decision_and_event_of_a_burst(through: str):
    endpoint = free_endpoint()
    routed = through != "peer to peer"
    mode = "client" if through == "router as client" else "peer"
    with (
        router(endpoint) if routed else Watcher("--listen", endpoint) as first,
        Watcher("--connect", endpoint, "--set", "zenoh.mode=client") if routed else first as watcher,
    ):
        with Bus("kestrel", Endpoints(mode=mode, connect=(endpoint,)), retry=True) as bus:
            watcher.until(alive(True))
            wait_until(lambda: bus.subscribed("decision") and bus.subscribed("event"))
            for number in range(2000):
                bus.put("estimate", numbered("estimate", number))
                if number % 10 == 0:
                    bus.put("decision", numbered("decision", number))
                    bus.put("event", numbered("event", number))
            watcher.until(lambda seen: sum(m["topic"] == "event" for m in seen) >= 200)
            watcher.until(lambda seen: sum(m["topic"] == "decision" for m in seen) >= 200)
            for topic in ("decision", "event"):
                assert [m["number"] for m in watcher.of(topic)] == list(range(0, 2000, 10))
            estimates = [m["number"] for m in watcher.of("estimate")]
            assert estimates == sorted(set(estimates))
            assert all(m["vehicle"] == "kestrel" for m in watcher.seen)
            assert bus.unsent == 0
        watcher.until(alive(False))


def test_configuration_and_last_decision_are_answered_and_nothing_else():
    endpoint = free_endpoint()
    with (
        Bus("kestrel", Endpoints(listen=(endpoint,))) as bus,
        Subscription(Endpoints(connect=(endpoint,)), "kestrel") as watcher,
    ):
        bus.answer(CONFIGURATION, b'{"a": 1}')
        assert watcher.ask("kestrel", DECISION) is None
        bus.put(DECISION, b'{"verdict": "unknown"}')
        bus.put(DECISION, b'{"verdict": "fit"}')
        assert watcher.ask("kestrel", CONFIGURATION) == b'{"a": 1}'
        assert watcher.ask("kestrel", DECISION) == b'{"verdict": "fit"}'
        assert watcher.ask("kestrel", "health") is None


def test_the_vehicle_subscribes_to_nothing():
    endpoint = free_endpoint()
    with (
        Bus("kestrel", Endpoints(listen=(endpoint,))) as bus,
        open_session(Endpoints(connect=(endpoint,))) as other,
    ):
        wait_until(lambda: list(other.info.peers_zid()))
        for topic in (
            "estimate",
            "decision",
            "health",
            "event",
            "preview",
            "configuration",
            "alive",
            "command",
        ):
            publisher = other.declare_publisher(bus.key(topic))
            publisher.put(b"land")
            assert not publisher.matching_status.matching


def listening_sockets() -> set[str]:
    """Inodes of this process's own TCP sockets in the state LISTEN."""
    own = {
        link[8:-1]
        for fd in Path("/proc/self/fd").iterdir()
        if fd.is_symlink() and (link := os.readlink(fd)).startswith("socket:[")
    }
    lines = [
        line.split()
        for name in ("tcp", "tcp6")
        for line in Path("/proc/self/net", name).read_text().splitlines()
    ]
    return {words[9] for words in lines[1:] if words[3] == "0A"} & own


@pytest.mark.skipif(not Path("/proc/self/net/tcp").exists(), reason="sockets are looked up in /proc")
def test_without_settings_the_vehicle_listens_nowhere():
    before = listening_sockets()
    with Bus("kestrel", Endpoints()) as bus:
        bus.put("estimate", b"{}")
        assert listening_sockets() == before
    with Bus("kestrel", Endpoints(listen=(free_endpoint(),))):
        assert len(listening_sockets() - before) == 1
    assert Endpoints().isolated


def test_a_router_that_comes_late_is_found_and_what_could_not_be_sent_is_counted():
    endpoint = free_endpoint()
    with pytest.raises(DriverError, match="zenoh"):
        Bus("kestrel", Endpoints(mode="client", connect=(endpoint,)))
    with Bus("kestrel", Endpoints(mode="client", connect=(endpoint,)), retry=True) as bus:
        bus.put("decision", b"{}")
        assert bus.unsent == 1
        with router(endpoint), Watcher("--connect", endpoint, "--set", "zenoh.mode=client") as watcher:
            watcher.until(alive(True))
            wait_until(lambda: bus.subscribed("decision"))
            bus.put("decision", message("decision", verdict="fit"))
            watcher.until(lambda seen: seen[-1].get("verdict") == "fit")


def stopped(pid: int) -> bool:
    """Whether a process is stopped by a signal (state T of proc(5))."""
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "T"


def test_a_subscriber_that_never_reads_does_not_hold_the_vehicle_up():
    endpoint = free_endpoint()
    with Watcher("--listen", endpoint) as watcher, Bus("kestrel", Endpoints(connect=(endpoint,))) as bus:
        watcher.until(alive(True))
        wait_until(lambda: bus.subscribed("estimate"))
        os.kill(watcher.process.pid, signal.SIGSTOP)
        try:
            for number in range(3000):
                bus.put("estimate", numbered("estimate", number))
            assert stopped(watcher.process.pid), "every put returned while nobody read"
        finally:
            os.kill(watcher.process.pid, signal.SIGCONT)


def test_a_watcher_that_falls_behind_counts_what_it_lost():
    endpoint = free_endpoint()
    with (
        Bus("kestrel", Endpoints(listen=(endpoint,))) as bus,
        Subscription(Endpoints(connect=(endpoint,)), "kestrel") as watcher,
    ):
        wait_until(lambda: bus.subscribed("event"))
        watcher._queue.maxsize = 10
        for number in range(100):
            bus.put("event", numbered("event", number))
        wait_until(lambda: watcher.dropped >= 80)
        assert watcher.receive(1.0) is not None


@pytest.mark.parametrize(
    ("vehicle", "endpoints", "says"),
    [
        ("a/b", Endpoints(), "cannot be part of a key"),
        ("", Endpoints(), "cannot be part of a key"),
        ("kestrel", Endpoints(listen=("nonsense",)), "zenoh"),
        ("kestrel", Endpoints(mode="king"), "zenoh"),
        ("kestrel", Endpoints(config_file="/absent.json5"), "no such zenoh configuration"),
    ],
)
def test_wrong_settings_are_one_clear_error(vehicle: str, endpoints: Endpoints, says: str):
    with pytest.raises(DriverError, match=says) as fault:
        Bus(vehicle, endpoints)
    assert "\n" not in str(fault.value)


def test_a_configuration_file_is_taken_and_a_broken_one_refused(tmp_path):
    file = tmp_path / "zenoh.json5"
    endpoint = free_endpoint()
    file.write_text(f'{{listen: {{endpoints: ["{endpoint}"]}}}}')
    with (
        Bus("kestrel", Endpoints(config_file=str(file))),
        Subscription(Endpoints(connect=(endpoint,)), "kestrel") as watcher,
    ):
        delivery = watcher.receive(PATIENCE_S)
        assert delivery is not None
        assert delivery.alive is True
    file.write_text("{listen:")
    with pytest.raises(DriverError, match="not accepted"):
        Bus("kestrel", Endpoints(config_file=str(file)))


def test_decisions_and_events_have_room_and_a_files_own_queues_stay(tmp_path):
    file = tmp_path / "zenoh.json5"
    file.write_text("{transport: {link: {tx: {queue: {size: {data: 8}}}}}}")
    for given, data in ((Endpoints(), 2), (Endpoints(config_file=str(file)), 8)):
        size = json.loads(bus_config(given).get_json("transport/link/tx/queue/size"))
        assert (size["interactive_high"], size["data"]) == (IMPORTANT_BATCHES, data)


def test_messages_are_json_and_may_be_dropped():
    endpoint = free_endpoint()
    with (
        Bus("kestrel", Endpoints(listen=(endpoint,))) as bus,
        open_session(Endpoints(connect=(endpoint,))) as other,
    ):
        subscriber = other.declare_subscriber("landslope/kestrel/*")
        wait_until(lambda: bus.subscribed("decision"))
        bus.put("decision", b"{}")
        sample = subscriber.recv()
        assert sample.encoding == zenoh.Encoding.APPLICATION_JSON
        assert sample.congestion_control == zenoh.CongestionControl.DROP
