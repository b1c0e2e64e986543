"""The date: believed when something speaks for it, added to what leaves the program, never to an interval."""

import json
from pathlib import Path

import numpy as np
import pytest

import drivers.system.wall_clock as wall
from companion.clocks.date import Date
from companion.live.recording import FlightRecording
from companion.messages.messages import Event
from companion.settings.settings import CameraSettings, RecordSettings, Settings
from drivers.files.flight_folder import FlightFolder
from drivers.files.folder_clock import FILE, FolderClock, read_clock, set_right, write_clock
from drivers.samples import Frame, SystemTime
from drivers.system import host_clock
from drivers.system.wall_clock import WallClock, wall_clock

S = 1_000_000
PAST_US = host_clock.EARLIEST_UNIX_S * S
TRUE_US = 1_795_298_557 * S
YEARS_US = TRUE_US - PAST_US


def reported(date: Date) -> int:
    message = Event(event="x", frame=None, time_unix_us=PAST_US, severity="info", text="")
    return date.dated(message).time_unix_us


def test_a_clock_that_nothing_speaks_for_has_no_date():
    date = Date()
    assert date.wall(WallClock(YEARS_US, ""), 0) is None
    assert not date.known
    assert reported(date) == PAST_US


def test_the_network_sets_the_date_once_and_small_corrections_move_nothing():
    date = Date()
    event = date.wall(WallClock(YEARS_US, "network"), PAST_US)
    assert event is not None
    assert (event.event, event.details["source"]) == ("date_known", "network")
    assert event.details["offset_s"] == YEARS_US * 1e-6
    assert date.wall(WallClock(YEARS_US + 300_000, "network"), 1) is None
    assert reported(date) == TRUE_US
    corrected = date.wall(WallClock(YEARS_US - 3600 * S, "network"), 1)
    assert corrected is not None
    assert corrected.event == "date_corrected"
    assert reported(date) == TRUE_US - 3600 * S


def test_a_right_clock_stays_as_it_is():
    date = Date()
    event = date.wall(WallClock(1200, "hardware"), 0)
    assert event is not None
    assert date.known
    assert reported(date) == PAST_US


def test_the_autopilots_time_counts_after_three_that_agree_and_the_least_late_one_is_taken():
    date = Date()
    late_us = [40_000, 700_000, 15_000]
    events = [
        date.autopilot(SystemTime(PAST_US + k * S, TRUE_US + k * S - late)) for k, late in enumerate(late_us)
    ]
    assert events[:2] == [None, None]
    assert events[2].details == {"offset_s": (YEARS_US - 15_000) * 1e-6, "source": "autopilot"}


@pytest.mark.parametrize("unix_us", [0, 5 * S, -1, 10**17, 315_964_800 * S])
def test_a_time_that_no_autopilot_has_is_no_witness(unix_us):
    date = Date()
    for k in range(6):
        assert date.autopilot(SystemTime(PAST_US + k * S, unix_us + k)) is None
    assert not date.known


def test_times_that_disagree_are_no_witnesses_and_the_wall_clock_goes_before_them():
    date = Date()
    for k in range(6):
        date.autopilot(SystemTime(PAST_US + k * S, TRUE_US + k * k * 10 * S))
    assert not date.known
    date.wall(WallClock(0, "network"), 0)
    for k in range(6):
        date.autopilot(SystemTime(PAST_US + k * S, TRUE_US + k * S))
    assert reported(date) == PAST_US


def test_a_board_without_a_battery_has_a_date_when_its_clock_was_set_or_a_hardware_clock_agrees(
    tmp_path, monkeypatch
):
    """A Raspberry Pi starts with the time at which it was switched off (fake-hwclock, systemd-timesyncd)."""
    now_s = TRUE_US / S
    monkeypatch.setattr(wall, "DEVICE_TREE", tmp_path)
    monkeypatch.setattr(wall, "TIMESYNCD", tmp_path / "synchronized")
    monkeypatch.setattr(wall, "HARDWARE_CLOCKS", tmp_path / "rtc")
    monkeypatch.setattr(wall, "_kernel_synchronised", lambda: False)
    monkeypatch.setattr(wall.time, "time", lambda: now_s)
    monkeypatch.setattr(wall.time, "time_ns", lambda: TRUE_US * 1000)
    monkeypatch.setattr(host_clock, "now_us", lambda: TRUE_US)
    assert wall_clock() == WallClock(0, "")
    since = tmp_path / "rtc" / "rtc0" / "since_epoch"
    since.parent.mkdir(parents=True)
    since.write_text("900\n")  # a Raspberry Pi 5 without a battery
    assert wall_clock().source == ""
    since.write_text(f"{now_s - 1:.0f}\n")
    assert wall_clock().source == "hardware"
    since.unlink()
    monkeypatch.setattr(host_clock, "now_us", lambda: TRUE_US - 86_400 * S)
    assert wall_clock() == WallClock(86_400 * S, "set")
    (tmp_path / "synchronized").touch()
    assert wall_clock().source == "network"


def test_a_flight_begun_in_the_past_gets_its_name_and_replays_with_its_true_times(tmp_path, monkeypatch):
    clock_us = PAST_US + 7 * S
    monkeypatch.setattr("drivers.files.recorder.now_us", lambda: clock_us)
    settings = Settings(
        camera=CameraSettings(rate_hz=30), record=RecordSettings(directory=str(tmp_path), when="always")
    )
    recording = FlightRecording(settings)
    recording.step(0)
    for k in range(4):
        at_us = clock_us + k * 33_333
        recording.samples([Frame(k, at_us, at_us, np.full((48, 64), 90 + k, np.uint8))])
    recording.set_date(YEARS_US, "autopilot")
    for k in range(4, 8):
        at_us = clock_us + k * 33_333
        recording.samples([Frame(k, at_us, at_us, np.full((48, 64), 90 + k, np.uint8))])
    recording.close()
    (folder,) = tmp_path.iterdir()
    assert folder.name == "20261121T220244Z", "the name of its true beginning"
    assert read_clock(folder) == FolderClock(clock_us, YEARS_US, "autopilot", read_clock(folder).process)
    frames = [s for s in FlightFolder(folder).samples() if isinstance(s, Frame)]
    assert [f.stamp_us for f in frames] == [clock_us + YEARS_US + k * 33_333 for k in range(8)]


def test_a_flight_begun_with_the_date_carries_it_in_every_file(tmp_path, monkeypatch):
    monkeypatch.setattr("drivers.files.recorder.now_us", lambda: PAST_US)
    record = RecordSettings(directory=str(tmp_path), when="always")
    recording = FlightRecording(Settings(record=record))
    recording.set_date(YEARS_US, "network")
    recording.step(0)
    recording.samples([Frame(0, PAST_US, PAST_US + 1, np.zeros((48, 64), np.uint8))])
    recording.mavlink(PAST_US + 2, b"\xfe\x00\x00\x01\x01\x00\x00\x00")
    recording.close()
    (folder,) = tmp_path.iterdir()
    row = (folder / "frames.csv").read_text().splitlines()[1]
    assert row == f"0,{TRUE_US},{TRUE_US + 1},0"
    assert (folder / "vehicle.tlog").read_bytes()[:8] == (TRUE_US + 2).to_bytes(8, "big")
    assert read_clock(folder).add_us == 0


def test_a_folder_that_the_power_took_before_its_renaming_is_renamed_the_next_time(tmp_path):
    left = tmp_path / "20260101T000007Z"
    left.mkdir()
    write_clock(left, FolderClock(PAST_US + 7 * S, YEARS_US, "network", "another"))
    busy = tmp_path / "20260101T000009Z"
    busy.mkdir()
    write_clock(busy, FolderClock(PAST_US + 9 * S, YEARS_US, "network", "another"))
    undated = tmp_path / "20260101T000010Z"
    undated.mkdir()
    write_clock(undated, FolderClock(PAST_US + 10 * S, None, "", "another"))
    (tmp_path / "20261121T220244Z").mkdir()
    assert set_right(tmp_path, {busy}) == [(left, tmp_path / "20261121T220244Z-2")]
    assert busy.is_dir()
    assert undated.is_dir()


@pytest.mark.parametrize(
    "text",
    ["", "{", "[]", "null", '{"begun_us": 1}', "[" * 5000, json.dumps({"begun_us": True, "add_us": 1})]
    + [
        json.dumps({"begun_us": 0, "add_us": add, "source": "", "process": ""})
        for add in (10**30, -5, 1.5, "x")
    ],
)
def test_a_clock_that_makes_no_sense_adds_nothing(tmp_path: Path, text):
    (tmp_path / FILE).write_text(text)
    assert read_clock(tmp_path) is None
