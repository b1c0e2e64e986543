"""The look before a flight, at a simulated autopilot over a real socket and at cameras that work, and at faults."""

import itertools
import shutil
import socket
import time
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from bus_support import router
from camera_support import SITL_LOGS, MjpegServer, moving
from ports import free_endpoint, free_udp_port

from companion.cli import main
from companion.doctor.camera import CameraExamination, blur_of
from companion.doctor.doctor import examine
from companion.doctor.findings import DoctorOptions, Finding, exit_code
from companion.doctor.link import LinkExamination
from companion.doctor.system import disk_findings, settings_findings, zenoh_findings
from companion.live.kept_mask import KeptMask
from companion.settings.settings import Settings
from companion.settings.settings_file import LoadedSettings, load
from drivers.files.video_file import VideoFile
from drivers.simulated.vehicle.autopilot import SimulatedAutopilot

STAIRS = SITL_LOGS / "stairs_a"
OPTIONS = DoctorOptions()
PATIENCE_S = 600.0


def loaded(*overrides: str) -> LoadedSettings:
    return load(None, list(overrides))


def by_subject(findings) -> dict[str, Finding]:
    return {finding.subject: finding for finding in findings}


def eventually(condition: Callable[[], object]) -> None:
    """Wait until a condition holds."""
    until = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.02)


def watched(settings: Settings, frames: int = 12) -> dict[str, Finding]:
    """The camera's findings after some frames."""
    examination = CameraExamination(settings, OPTIONS)
    until = time.monotonic() + PATIENCE_S
    while len(examination._frames) < frames:
        assert time.monotonic() < until
        examination.look(0.1)
    findings = by_subject(examination.findings())
    examination.close()
    return findings


def listened(settings: Settings, messages: int = 0) -> dict[str, Finding]:
    """The link's findings after some messages."""
    examination = LinkExamination(settings, OPTIONS)
    link = examination._link
    if link is not None:
        eventually(lambda: link.is_open and link.counters["frames in"] >= messages)
    findings = by_subject(examination.findings())
    examination.close()
    return findings


def test_a_vehicle_ready_to_fly(tmp_path):
    with SimulatedAutopilot("tcp:127.0.0.1:0") as autopilot:
        findings = list(
            examine(
                loaded(
                    f"camera.source={STAIRS}",
                    f"camera.calibration={STAIRS / 'camera.yaml'}",
                    "camera.readout_s=0.0",
                    f"mavlink.connection=tcp:127.0.0.1:{autopilot.port}",
                    f"record.directory={tmp_path / 'flights'}",
                    "record.min_free_mb=1",
                    "record.max_flight_mb=1",
                ),
                seconds=5.0,
            )
        )
    seen = by_subject(findings)
    assert exit_code(findings) < 2, findings
    for subject in ("settings", "camera", "exposure", "sharpness", "calibration", "link", "disk", "zenoh"):
        assert seen[subject].level == "ok", seen[subject]
    assert "320 x 240" in seen["camera"].text
    assert "30.0 Hz" in seen["frame rate"].text
    assert "system 1" in seen["link"].text
    for subject in ("attitude", "gyro", "velocity", "landed state"):
        assert "Hz of" in seen[subject].text
    assert "round trips" in seen["timesync"].text
    assert seen["clock"].level == "ok", seen["clock"]


def test_nothing_there_is_a_failure_with_a_remedy_each(tmp_path, capsys):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # bound, never listening: connections are refused
        (tmp_path / "flights").write_text("a file")
        settings = tmp_path / "landslope.toml"
        settings.write_text(
            f"""
[camera]
source = "/dev/video77"
calibration = "nowhere.yaml"
[mavlink]
connection = "tcp:127.0.0.1:{taken.getsockname()[1]}"
[record]
directory = "{tmp_path}/flights/more"
[zenoh]
config = "{tmp_path}/none.json5"
"""
        )
        assert main(["doctor", "--config", str(settings), "--seconds", "3"]) == 2
    said = capsys.readouterr().out
    lines = said.splitlines()
    for start in ("settings", "camera", "link", "disk", "zenoh"):
        at = next(k for k, line in enumerate(lines) if line.startswith("failure") and start in line)
        assert lines[at + 1].strip().startswith("->")
    assert "/dev/video77: no such camera" in said


def test_settings_that_do_not_load_end_with_two(tmp_path, capsys):
    settings = tmp_path / "landslope.toml"
    settings.write_text("[camera]\nsauce = 1\n")
    assert main(["doctor", "--config", str(settings)]) == 2
    assert "sauce" in capsys.readouterr().err
    assert main(["doctor", "--seconds", "1"]) == 2


def test_what_is_masked_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    settings = loaded(f"camera.source={STAIRS}", f"camera.calibration={STAIRS / 'camera.yaml'}").settings
    assert "mask" not in watched(settings, 3)
    mask = np.zeros((240, 320), bool)
    mask[:, :32] = True
    KeptMask(settings.camera).save(mask, 0)
    seen = watched(settings, 3)["mask"]
    assert (seen.level, str(tmp_path) in seen.text, "10%" in seen.text) == ("ok", True, True)
    mask[:, :160] = True
    KeptMask(settings.camera).save(mask, 0)
    assert watched(settings, 3)["mask"].level == "warning"
    unlearnt = replace(settings, camera=replace(settings.camera, learn_mask=False))
    assert "mask" not in watched(unlearnt, 3)


def test_a_calibration_of_another_size_fails():
    with MjpegServer(moving(160, 120)) as server:
        source = (f"camera.source={server.url}", f"camera.calibration={STAIRS / 'camera.yaml'}")
        seen = watched(loaded(*source).settings)
    assert seen["calibration"].level == "failure"
    assert "320 x 240" in seen["calibration"].text


def test_a_readout_that_is_not_set_is_a_warning():
    with MjpegServer(moving(320, 240)) as server:
        source = (f"camera.source={server.url}", f"camera.calibration={STAIRS / 'camera.yaml'}")
        seen = watched(loaded(*source).settings)
    assert seen["calibration"].level == "warning"
    assert "readout not set" in seen["calibration"].text
    assert "docs/calibration.md" in seen["calibration"].remedy


def test_no_calibration_is_a_warning_and_a_slow_camera_too():
    with MjpegServer(moving(), rate_hz=8) as server:
        seen = watched(loaded(f"camera.source={server.url}", "camera.rate_hz=30").settings)
    assert seen["calibration"].level == "warning"
    assert "landslope calibrate" in seen["calibration"].remedy
    assert seen["frame rate"].level == "warning"
    assert "asked for 30 Hz" in seen["frame rate"].text


def noisy(base: np.ndarray):
    random = np.random.default_rng(1)
    while True:
        yield (base + random.normal(0, 1, base.shape)).clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    ("grey", "remedy"), [(0.0, "covered"), (255.0, "shorter"), (120.0, "nothing to be seen")]
)
def test_pictures_that_show_nothing_are_reported_apart(grey, remedy):
    with MjpegServer(noisy(np.full((120, 160), grey))) as server:
        seen = watched(loaded(f"camera.source={server.url}").settings)
    assert seen["exposure"].level == "warning"
    assert remedy in seen["exposure"].remedy


def test_a_camera_that_repeats_its_pictures_is_noticed():
    pictures = itertools.chain.from_iterable((picture, picture) for picture in moving())
    with MjpegServer(pictures) as server:
        seen = watched(loaded(f"camera.source={server.url}").settings)
    assert seen["frames"].level == "warning"
    assert "picture repeated" in seen["frames"].text


def test_blur_grows_with_the_blur():
    _, sharp = next(VideoFile(STAIRS / "camera.mkv").images())
    blurred = [blur_of(cv2.GaussianBlur(sharp, (0, 0), sigma)) for sigma in (0.5, 1, 1.5, 2, 3)]
    assert blurred == sorted(blurred)
    assert blur_of(sharp) < OPTIONS.max_blur < blurred[-1]
    assert blur_of(np.full((60, 80), 7, np.uint8)) == 1.0


def test_a_silent_link_and_an_absent_one_say_different_things():
    port = free_udp_port()
    settings = loaded(f"mavlink.connection=udpin:127.0.0.1:{port}").settings
    assert "silent" in listened(settings)["link"].text
    assert "not set" in listened(Settings())["link"].text


def test_another_vehicle_than_the_one_named():
    with SimulatedAutopilot("tcp:127.0.0.1:0") as autopilot:
        connection = f"mavlink.connection=tcp:127.0.0.1:{autopilot.port}"
        seen = listened(loaded(connection, "vehicle.system_id=9").settings, 200)
    assert seen["link"].level == "failure"
    assert "no heartbeat" in seen["link"].text
    assert "vehicle.system_id" in seen["link"].remedy


def test_a_link_that_loses_messages_shows_in_the_rates():
    with SimulatedAutopilot("tcp:127.0.0.1:0") as autopilot:
        settings = loaded(f"mavlink.connection=tcp:127.0.0.1:{autopilot.port}").settings
        examination = LinkExamination(settings, OPTIONS)
        eventually(examination._link.vehicle_found.is_set)
        autopilot.link.loss = 0.5
        lossy_from_s = autopilot.time_s
        eventually(lambda: autopilot.time_s > lossy_from_s + 3.5)
        seen = by_subject(examination.findings())
        examination.close()
    assert seen["link"].level == "ok"
    assert seen["attitude"].level == "warning"
    assert "baud rate" in seen["attitude"].remedy


@pytest.mark.parametrize(("free_mb", "level"), [(10, "failure"), (1000, "warning"), (100_000, "ok")])
def test_the_disk_is_measured_by_what_a_flight_may_take(tmp_path, monkeypatch, free_mb, level):
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr("shutil.disk_usage", lambda path: usage._replace(free=free_mb * 1_000_000))
    (finding,) = disk_findings(loaded(f"record.directory={tmp_path}").settings)
    assert finding.level == level


def test_no_recording_is_fine():
    (finding,) = disk_findings(Settings())
    assert finding.level == "ok"


def test_zenoh_without_the_router_named():
    port = free_udp_port()
    settings = loaded("zenoh.mode=client", f"zenoh.connect=tcp/127.0.0.1:{port}").settings
    (finding,) = zenoh_findings(settings)
    assert finding.level in ("warning", "failure")
    assert finding.remedy


@pytest.mark.parametrize(("mode", "level"), [("peer", "warning"), ("client", "ok")])
def test_a_peer_of_a_router_is_reported_to_be_its_client(mode, level):
    endpoint = free_endpoint()
    with router(endpoint):
        (finding,) = zenoh_findings(loaded(f"zenoh.mode={mode}", f"zenoh.connect={endpoint}").settings)
    assert finding.level == level
    assert ("client" in finding.remedy) == (mode == "peer")


def test_a_signing_key_that_everybody_reads(tmp_path):
    key = tmp_path / "mavlink.key"
    key.write_bytes(bytes(32))
    key.chmod(0o644)
    seen = by_subject(settings_findings(loaded(f"mavlink.signing_key={key}")))
    assert seen["signing key"].remedy.startswith("chmod 640")
    key.chmod(0o640)
    seen = by_subject(settings_findings(loaded(f"mavlink.signing_key={key}")))["signing key"]
    assert (seen.level, seen.remedy) == ("ok", "")
    assert f"from the file {key}" in seen.text
    seen = by_subject(settings_findings(loaded(f"mavlink.signing_key={bytes(32).hex()}")))["signing key"]
    assert "mavlink.signing_key itself" in seen.text


def test_exit_codes():
    ok, warning, failure = (Finding("x", level, "") for level in ("ok", "warning", "failure"))
    assert [exit_code(f) for f in ([], [ok], [ok, warning], [failure, ok, warning])] == [0, 0, 1, 2]
