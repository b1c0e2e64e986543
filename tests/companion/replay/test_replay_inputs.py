"""What ``landslope replay`` takes: folders of flights, names that are not UTF-8, the recorded pilot's switch."""

import json
import os
import shutil
from collections.abc import Iterable
from pathlib import Path

import folder_edits
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from replay_support import landslope

from companion import cli
from companion.errors import LandslopeError
from companion.replay.source import PlainCamera, flights_in, open_source
from drivers.errors import DriverError
from drivers.files.video_file import ImageFolder, VideoFile

FAST = ("--set", "estimator.method=quadratic")
CHANNEL = 9


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return folder_edits.short_flight(tmp_path_factory.mktemp("inputs") / "short", seconds=3.0)


def test_a_folder_of_flights_is_its_flights(tmp_path: Path, capsys):
    flight = folder_edits.short_flight(tmp_path / "short", seconds=1.0)
    for name in ("second", "first"):
        (tmp_path / "flights" / name).mkdir(parents=True)
        for file in flight.iterdir():
            os.link(file, tmp_path / "flights" / name / file.name)
    (tmp_path / "flights" / "notes").mkdir()
    (tmp_path / "flights" / "readme.txt").write_text("two flights")
    out = tmp_path / "out"
    assert cli.main(["replay", str(tmp_path / "flights"), *FAST, "--out", f"{out}/"]) == 0
    printed = capsys.readouterr().out
    assert printed.index("first: 30 frames") < printed.index("second: 30 frames")
    assert sorted(file.name for file in out.iterdir()) == ["first.jsonl", "second.jsonl"]


def test_a_flight_and_a_folder_without_flights_stay_themselves(flight: Path, tmp_path: Path):
    assert flights_in(flight) == [flight]
    assert flights_in(tmp_path) == [tmp_path]
    assert flights_in(flight / "camera.mkv") == [flight / "camera.mkv"]


def test_a_folder_that_may_not_be_read_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def refuse(self: Path) -> Iterable[Path]:
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "iterdir", refuse)
    with pytest.raises(LandslopeError, match="Permission denied; check its rights"):
        flights_in(tmp_path)


def test_names_that_are_not_utf8_are_one_line(flight: Path, tmp_path: Path):
    folder = tmp_path / os.fsdecode(b"flight_\xfcber")
    video = tmp_path / os.fsdecode(b"film_\xe4.mkv")
    shutil.copytree(flight, folder)
    shutil.copy(flight / "camera.mkv", video)
    for words in (
        ["replay", folder],
        ["replay", video, "--fov-deg", 64],
        ["export", folder, "--mcap", tmp_path / "x"],
    ):
        done = landslope(*words)
        assert done.returncode == 2
        assert done.stderr.count("\n") == 1
        assert "is not UTF-8: rename it" in done.stderr


def test_names_that_are_not_utf8_never_reach_opencv(flight: Path, tmp_path: Path):
    video = tmp_path / os.fsdecode(b"film_\xe4.mkv")
    shutil.copy(flight / "camera.mkv", video)
    with pytest.raises(DriverError, match="not UTF-8"):
        VideoFile(video)
    (tmp_path / os.fsdecode(b"p\xe4.png")).write_bytes(b"x")
    with pytest.raises(DriverError, match="none of its 1 images"):
        ImageFolder(tmp_path)


def with_switch(folder: Path, on_from_s: float) -> None:
    """The pilot turns channel 9 on so many seconds into the recording."""

    def switched(messages: list[folder_edits.Message]) -> Iterable[folder_edits.Message]:
        first_us, due_us = messages[0][0], 0
        for stamp_us, message in messages:
            yield stamp_us, message
            if stamp_us < due_us:
                continue
            due_us = stamp_us + 200_000
            pulses = [1500] * 18
            pulses[CHANNEL - 1] = 1900 if stamp_us - first_us > on_from_s * 1e6 else 1100
            rc = mavlink.MAVLink_rc_channels_message(0, 18, *pulses, 255)
            rc.pack(mavlink.MAVLink(None, message.get_srcSystem(), message.get_srcComponent()))
            yield stamp_us, rc

    folder_edits.rewrite(
        folder, lambda messages: switched([m for m in messages if m[1].get_type() != "RC_CHANNELS"])
    )


@pytest.mark.parametrize("on_from_s", [1.0, 99.0])
def test_the_recorded_switch_enables_landing(flight: Path, tmp_path: Path, on_from_s: float):
    folder = tmp_path / "flight"
    shutil.copytree(flight, folder)
    with_switch(folder, on_from_s)
    events = tmp_path / "events.jsonl"
    words = ["--set", "decision.dwell_s=0.1", "--set", f"landing.enable_rc_channel={CHANNEL}"]
    assert cli.main(["replay", str(folder), *words, "--enable-from-rc", "--events", str(events)]) == 0
    requested = [
        e for e in map(json.loads, events.read_text().splitlines()) if e["event"] == "landing_requested"
    ]
    assert len(requested) == (1 if on_from_s < 3 else 0)


def test_a_switch_that_no_setting_names_is_one_line(flight: Path, capsys):
    assert cli.main(["replay", str(flight), "--enable-from-rc", "--set", "landing.enable_rc_channel=0"]) == 2
    assert "the settings name no switch" in capsys.readouterr().err
    assert cli.main(["replay", str(flight), "--enable-from-rc", "--enable-after", "1"]) == 2
    assert "give one of them" in capsys.readouterr().err


@pytest.mark.parametrize(("rate_hz", "cautions"), [(4, 1), (25, 0)])
def test_the_log_of_a_telemetry_radio_is_one_sentence(
    flight: Path, tmp_path: Path, rate_hz: int, cautions: int
):
    folder = tmp_path / "flight"
    shutil.copytree(flight, folder)

    def thinned(messages: list[folder_edits.Message]) -> Iterable[folder_edits.Message]:
        last_us: dict[str, int] = {}
        for stamp_us, message in messages:
            kind = message.get_type()
            if kind == "ATTITUDE_QUATERNION" or stamp_us - last_us.get(kind, 0) < 1e6 / rate_hz - 2000:
                continue
            last_us[kind] = stamp_us
            yield stamp_us, message

    folder_edits.rewrite(folder, thinned)
    found = open_source(folder, None, (), PlainCamera()).cautions
    assert len(found) == cautions
    assert all(
        words.startswith("attitude was recorded at 4 Hz") and "telemetry radio" in words for words in found
    )
