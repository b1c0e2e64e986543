"""The zenoh settings that an installation lays down: others can listen to the vehicle and write nothing."""

import time

import zenoh
from places import REPOSITORY
from ports import free_tcp_port

from drivers.bus import Bus, Endpoints

TEMPLATE = REPOSITORY / "systemd" / "zenoh.json5"
PATIENCE_S = 600.0


def stranger(endpoint: str) -> zenoh.Session:
    """A session of somebody else, connected to the vehicle and nobody else."""
    config = zenoh.Config()
    config.insert_json5("connect/endpoints", f'["{endpoint}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)


def test_others_hear_the_vehicle_and_cannot_write_in_its_name():
    endpoint = f"tcp/127.0.0.1:{free_tcp_port()}"
    heard: list[bytes] = []
    injected: list[bytes] = []
    with Bus("vehicle1", Endpoints(listen=(endpoint,), config_file=str(TEMPLATE))) as bus:
        own = bus.session
        assert own is not None
        watch = own.declare_subscriber("landslope/**", lambda sample: injected.append(bytes(sample.payload)))
        with stranger(endpoint) as other:
            other.declare_subscriber("landslope/vehicle1/**", lambda s: heard.append(bytes(s.payload)))
            until = time.monotonic() + PATIENCE_S
            said = b'{"event":"from the vehicle"}'
            while said not in heard and time.monotonic() < until:  # it hears its own words as well
                bus.put("event", said)
                other.put("landslope/vehicle1/event", b"forged")
                time.sleep(0.1)
        watch.undeclare()
    assert said in heard
    assert b"forged" not in injected


def test_without_the_template_the_same_forgery_arrives():
    """What the test above would miss if the way were closed for another reason."""
    endpoint = f"tcp/127.0.0.1:{free_tcp_port()}"
    injected: list[bytes] = []
    with Bus("vehicle1", Endpoints(listen=(endpoint,))) as bus:
        own = bus.session
        assert own is not None
        watch = own.declare_subscriber("landslope/**", lambda sample: injected.append(bytes(sample.payload)))
        with stranger(endpoint) as other:
            until = time.monotonic() + PATIENCE_S
            while not injected and time.monotonic() < until:
                other.put("landslope/vehicle1/event", b"forged")
                time.sleep(0.1)
        watch.undeclare()
    assert b"forged" in injected
