"""A password in a URL is for the camera alone: it is in no answer, event, log line, finding, error or recording."""

import json
import signal
import subprocess
import sys
import time

import pytest
from daemon_support import PATIENCE_S, wait_for
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from ports import free_endpoint, free_udp_port

from companion.cli import main
from companion.doctor.findings import Finding
from companion.live.recording import flight_papers
from companion.settings.listing import in_force
from companion.settings.settings_file import load
from drivers.bus import Endpoints, Subscription
from drivers.cameras import open_camera
from drivers.cameras.interface import ReaderLimits
from drivers.errors import DriverError
from drivers.events import DriverEvent
from drivers.secrets import masked

SECRET = "not-for-others"
SOURCE = f"rtsp://operator:{SECRET}@127.0.0.1:1/cam"

URLS = [
    SOURCE,
    f"http://operator:{SECRET}@127.0.0.1/x.mjpg",
    f"rtsp://op:a@b/{SECRET}@host:554/cam",  # an @ and a slash that nobody encoded
    f"rtsp://{SECRET}@host/cam",
    f"http://host/stream?user=a&password={SECRET}&size=2",
    f"http://host/stream?auth_token={SECRET}",
]


@pytest.mark.parametrize("url", URLS)
def test_urls_are_masked_wherever_a_text_leaves(url):
    assert SECRET not in masked(f"cannot open {url}: refused; see {url}")
    assert SECRET not in str(DriverError(f"{url}: no video there"))
    assert SECRET not in DriverEvent("camera_lost", "warning", f"{url}: gone", 0).text
    assert SECRET not in Finding("camera", "failure", url, f"is {url} right?").line(10)
    loaded = load(None, [f"camera.source={url}", f"zenoh.connect=tcp/1.2.3.4:1,{url}"])
    assert SECRET not in "\n".join(in_force(loaded))
    papers = flight_papers(loaded.settings).settings
    assert SECRET not in papers
    assert loaded.settings.camera.source == url, "the camera itself gets it whole"


@pytest.mark.parametrize(
    "text",
    ["/dev/video0", "rtsp://host:554/cam?x=1", "tcp/10.0.0.2:7447", "a@b and c://d", "udpin:0.0.0.0:1"],
)
def test_texts_without_secrets_stay_as_they_are(text):
    assert masked(text) == text


@examples(200)
@given(
    user=st.text("abc%:", max_size=5),
    password=st.text("Zz9/@:!%$&=#?.-", min_size=1, max_size=12).map(lambda p: "SeCrEt" + p),
)
def test_any_password_is_masked(user, password):
    assert "SeCrEt" not in masked(f"before rtsp://{user}:{password}@camera.local:554/live after")


def test_a_camera_that_does_not_answer_is_named_without_its_password():
    limits = ReaderLimits(open_timeout_s=1.0, read_timeout_s=1.0, first_retry_s=0.05)
    with open_camera(SOURCE, limits=limits) as camera:
        wait_for(lambda: camera.status().problem, "problem")
        assert SECRET not in camera.status().problem
        assert "rtsp://***@127.0.0.1:1/cam" in camera.status().problem
        assert all(SECRET not in event.text for event in camera.events())


def test_a_wrong_setting_beside_a_password_is_refused_without_it(capsys):
    assert main(["check", "--set", f"camera.rate_hz={SOURCE}"]) == 2
    assert SECRET not in "".join(capsys.readouterr())


def test_a_running_daemon_keeps_the_password_to_itself(tmp_path):
    endpoint = free_endpoint()
    config = tmp_path / "landslope.toml"
    flights = tmp_path / "flights"
    config.write_text(
        f'[camera]\nsource = "{SOURCE}"\nopen_timeout_s = 1\n'
        f'[mavlink]\nconnection = "udpin:127.0.0.1:{free_udp_port()}"\n'
        f'[zenoh]\nlisten = ["{endpoint}"]\n'
        f'[record]\ndirectory = "{flights}"\nwhen = "always"\nmin_free_mb = 1\n'
    )
    log = tmp_path / "log"
    with log.open("wb") as stderr:
        process = subprocess.Popen(
            [sys.executable, "-m", "companion.cli", "run", "--config", str(config)], stderr=stderr
        )
    heard = []
    try:
        with Subscription(_reached(endpoint), "*") as watcher:
            wait_for(lambda: "camera_lost" in log.read_text(), "word of the absent camera")
            configuration = watcher.ask("vehicle1", "configuration")
            while len(heard) < 3:
                delivery = watcher.receive(60)
                assert delivery is not None
                heard.append(delivery.payload.decode(errors="replace"))
            assert configuration is not None
        assert json.loads(configuration)["camera"]["source"] == "rtsp://***@127.0.0.1:1/cam"
        assert all(SECRET not in text for text in heard)
    finally:
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE_S) == 0
    assert "camera_lost" in log.read_text()
    assert SECRET not in log.read_text()
    recorded = [path for path in flights.rglob("*") if path.is_file()]
    assert any(path.name == "landslope.toml" for path in recorded)
    assert all(SECRET.encode() not in path.read_bytes() for path in recorded)


def _reached(endpoint: str) -> Endpoints:
    """The vehicle's own endpoint, once it listens."""
    until = time.monotonic() + 300
    while True:
        try:
            return _tried(Endpoints(mode="client", connect=(endpoint,)))
        except DriverError:
            assert time.monotonic() < until
            time.sleep(0.1)


def _tried(endpoints: Endpoints) -> Endpoints:
    Subscription(endpoints).close()
    return endpoints
