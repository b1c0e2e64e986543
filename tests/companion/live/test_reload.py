"""SIGHUP: what can be taken over is, the rest is refused in one line, and the daemon never ends by it."""

import signal
import subprocess
import sys
import threading

from daemon_support import PATIENCE_S, DaemonBench, wait_for
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from ports import free_endpoint, free_udp_port

from companion.errors import SettingsError
from companion.live.reload import RELOADABLE, reloaded
from companion.settings.settings import Settings
from companion.settings.settings_file import entries, load, value_of


def test_limits_publishing_and_recording_are_taken_over_and_nothing_else():
    changes = ["decision.dwell_s=1.5", "record.when=always", "preview.rate_hz=2", "camera.rate_hz=25"]
    found = reloaded(Settings(), load(None, changes).settings)
    assert found.changed == ("decision.dwell_s", "record.when", "preview.rate_hz")
    assert found.refused == ("camera.rate_hz",)
    assert found.settings.decision.dwell_s == 1.5
    assert found.settings.camera == Settings().camera
    assert found.text.count("\n") == 0
    assert "a restart is needed for camera.rate_hz" in found.text


@examples(50)
@given(st.sampled_from([e for e in entries() if e.limits]), st.floats(0, 1))
def test_every_setting_is_taken_over_or_named(entry, part):
    value = entry.limits.low + part * (entry.limits.high - entry.limits.low)
    value = round(value) if entry.type is int else value
    wanted = load(None, [f"{entry.path}={value}"]).settings
    found = reloaded(Settings(), wanted)
    changed = value_of(wanted, entry.path) != entry.default
    may = entry.path.startswith(RELOADABLE)
    assert found.changed == ((entry.path,) if changed and may else ())
    assert found.refused == ((entry.path,) if changed and not may else ())
    assert value_of(found.settings, entry.path) == (value_of(wanted, entry.path) if may else entry.default)


def test_a_running_daemon_takes_settings_over_and_refuses_wrong_ones(tmp_path):
    with DaemonBench(tmp_path, (0.0, 3.0), settings=("landing.enabled=false",)) as bench:
        changes = ["decision.dwell_s=2.5", f"record.directory={tmp_path}", "record.when=always"]
        wanted = load(None, changes).settings
        present = bench.daemon.settings
        merged = reloaded(present, wanted).settings
        bench.daemon._load = lambda: merged
        bench.daemon.reload()
        wait_for(lambda: bench.events("settings_reloaded"), "word of the settings")
        (event,) = bench.events("settings_reloaded")
        assert event["severity"] == "info"
        assert "record.directory" in event["text"]
        wait_for(lambda: bench.events("recording_started"), "recording")

        def broken():
            raise SettingsError("landslope.toml:3: decision.dwell_s must be a number\nand more")

        bench.daemon._load = broken
        bench.daemon.reload()
        wait_for(lambda: bench.events("settings_refused"), "refusal")
        (event,) = bench.events("settings_refused")
        assert "dwell_s must be a number" in event["text"]
        assert "\n" not in event["text"]
        assert bench.daemon.settings.decision.dwell_s == merged.decision.dwell_s
        assert bench.daemon_thread.is_alive()
    assert threading.active_count() < 50


def test_sighup_does_not_end_the_process_at_any_moment(tmp_path):
    """Neither while it starts nor when it runs; afterwards it ends in good order."""
    config, flights = tmp_path / "landslope.toml", tmp_path / "flights"
    text = (
        f'[camera]\nsource = "/dev/video77"\n[mavlink]\nconnection = "udpin:127.0.0.1:{free_udp_port()}"\n'
        f'[zenoh]\nlisten = ["{free_endpoint()}"]\n'
        f'[record]\ndirectory = "{flights}"\nwhen = "always"\nmin_free_mb = 1\n'
    )
    config.write_text(text)
    log = tmp_path / "log"
    with log.open("wb") as stderr:
        process = subprocess.Popen(
            [sys.executable, "-m", "companion.cli", "run", "--config", str(config)], stderr=stderr
        )
    try:
        wait_for(lambda: "landslope runs" in log.read_text(), "start")
        wait_for(lambda: list(flights.glob("*/landslope.toml")), "recording with the first settings")
        config.write_text(text + "[decision]\ndwell_s = 1.75\n")
        process.send_signal(signal.SIGHUP)
        wait_for(lambda: "decision.dwell_s" in log.read_text(), "reload")
        wait_for(lambda: len(list(flights.glob("*/landslope.toml"))) == 2, "recording with the next ones")
        config.write_text(text + "[decision]\ndwell_s = 'long'\n")
        process.send_signal(signal.SIGHUP)
        wait_for(lambda: "settings_refused" in log.read_text(), "refusal")
        assert process.poll() is None
    finally:
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE_S) == 0
    flown = [path.read_text() for path in sorted(flights.glob("*/landslope.toml"))]
    assert ["dwell_s = 1.75" in text for text in flown] == [False, True], (
        "a flight is flown with one set of settings"
    )
    assert "Traceback" not in log.read_text()
