"""The doctor beside a landslope that runs: its own health is shown, and camera and link are left to it."""

import os

import msgspec
import pytest

from companion.doctor import running as module
from companion.doctor.doctor import examine
from companion.doctor.running import running
from companion.doctor.system import disk_findings
from companion.messages.conditions import Code, condition
from companion.messages.messages import Health, InputHealth
from companion.settings.settings_file import load
from drivers.system.single_instance import SingleInstance, health_path
from drivers.system.state_file import StateFile

LOADED = load(
    None, ["vehicle.name=patient", "camera.source=/dev/none", "mavlink.connection=serial:/dev/none:1"]
)


def well(**changes: object) -> Health:
    fine = InputHealth(state="ok", count=300, refused=2, rate_hz=30.0, age_s=0.02)
    health = Health(
        time_unix_us=1_800_000_000_000_000,
        state="ok",
        problems=(),
        inputs={"frames": fine, "attitude": fine},
        counters={},
        clock_offset_s=1.0,
        clock_std_s=0.001,
        camera_late_s=None,
        camera_late_std_s=None,
        pipeline_ms=4.0,
        recording=True,
    )
    return msgspec.structs.replace(health, **changes)


@pytest.fixture
def service(monkeypatch, tmp_path):
    """A process that holds the lock of the vehicle, and its state file."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.delenv("RUNTIME_DIRECTORY", raising=False)
    with SingleInstance("patient") as instance, StateFile(health_path(instance.path)) as file:
        yield file


def lines(loaded=LOADED) -> dict[str, tuple[str, str]]:
    return {f.subject: (f.level, f.text) for f in examine(loaded, 3.0)}


def test_its_health_is_shown_and_nothing_is_taken_from_it(service):
    readout = condition(Code.READOUT_UNKNOWN)
    stale = condition(Code.VITAL_INPUT_STALE, "attitude", "1.2 s")
    service.write(msgspec.json.encode(well(conditions=(stale, readout))))
    found = lines()
    assert found["service"][0] == "ok"
    assert str(os.getpid()) in found["service"][1]
    assert found["frames"] == ("ok", "30.0 Hz, newest 0.02 s old, 300 taken, 2 refused")
    assert found["attitude"] == ("failure", "attitude: none for 1.2 s")
    assert found["readout unknown"][0] == "warning"
    assert found["recording"][1] == "a flight is being recorded"
    assert not found.keys() & {"camera", "link", "zenoh"}, "they are the service's"


def test_one_that_has_said_nothing_or_nothing_lately_is_no_service_that_is_well(service):
    assert lines()["service"][0] == "warning"
    service.write(msgspec.json.encode(well()))
    os.utime(service.path, (1.0, 1.0))
    level, text = lines()["service"]
    assert level == "failure"
    assert "s old" in text


@pytest.mark.parametrize(
    "raw", [b"", b"{", b'{"time_unix_us": "now"}', b"[" * 100_000, b" " * 400_000, b"\xff\xfe"]
)
def test_what_is_no_health_is_none(service, raw):
    service.write(raw)
    assert lines()["service"][0] == "warning"


def test_no_text_of_it_reaches_the_terminal_as_a_control_sequence(service):
    bad = InputHealth(state="\x1b[2Jgone", count=0, refused=0, rate_hz=None, age_s=None)
    service.write(msgspec.json.encode(well(inputs={"fra\x1bmes": bad})))
    assert not any("\x1b" in line for entry in lines().items() for line in (entry[0], *entry[1]))


def test_a_link_that_somebody_put_there_is_replaced_and_not_followed(service, tmp_path):
    victim = tmp_path / "victim"
    victim.write_text("mine")
    service.path.symlink_to(victim)
    service._temporary.symlink_to(victim)
    service.write(b"{}")
    assert victim.read_text() == "mine"
    assert service.path.read_bytes() == b"{}"
    service.close()
    assert not service.path.exists()
    service._temporary = tmp_path / "nowhere" / "file"
    service.write(b"{}")  # a directory that takes nothing costs nothing


def test_a_service_that_may_not_be_looked_at_is_left_alone(monkeypatch, tmp_path):
    def hidden(path, *_: object) -> int:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(module.os, "open", hidden)
    monkeypatch.setattr(module.os, "access", lambda *_: False)
    found = lines()
    assert found["service"][0] == "failure"
    assert not found.keys() & {"camera", "link"}
    monkeypatch.setattr(module.os, "access", lambda *_: True)
    assert running(LOADED.settings) is None, "a lock of somebody else among the temporary files"


def test_flights_of_the_service_are_no_fault_of_the_one_who_looks(monkeypatch, tmp_path):
    monkeypatch.setattr("os.access", lambda *_: False)
    settings = load(None, [f"record.directory={tmp_path}"]).settings
    (finding,) = disk_findings(settings)
    assert (finding.level, "chown" in finding.remedy) == ("failure", True)
    monkeypatch.setattr("pathlib.Path.owner", lambda self: "landslope")
    monkeypatch.setattr("os.geteuid", lambda: 4321)
    (finding,) = disk_findings(settings)
    assert (finding.level, finding.remedy) == ("warning", "look as the service's user: sudo -u landslope")
