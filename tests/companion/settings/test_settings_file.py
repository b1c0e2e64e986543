"""Settings: every field of every dataclass can be read, is bounded, and faults are reported all at once."""

import dataclasses
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from places import REPOSITORY

from companion import cli
from companion.errors import SettingsError
from companion.settings.settings import Settings
from companion.settings.settings_file import Entry, entries, load, value_of
from companion.settings.toml_text import written
from drivers.files.camera_info import CameraInfo, write_camera_info

ENTRIES = list(entries())
BOUNDED = [entry for entry in ENTRIES if entry.limits]
DOCUMENT = REPOSITORY / "docs" / "settings.md"


def test_defaults_are_the_dataclasses_and_lie_within_their_limits():
    loaded = load(None)
    assert loaded.settings == Settings()
    assert set(loaded.origins.values()) == {"default"}
    for entry in BOUNDED:
        for number in entry.default if isinstance(entry.default, tuple) else (entry.default,):
            assert isinstance(number, str) or entry.limits.low <= number <= entry.limits.high, entry.path


def test_every_setting_says_what_it_is_for():
    assert [entry.path for entry in ENTRIES if not entry.meaning] == []


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.path)
def test_every_setting_can_be_written_in_a_file_and_overridden(entry: Entry, tmp_path: Path):
    if entry.default is None:
        return
    section, _, key = entry.path.rpartition(".")
    file = tmp_path / "landslope.toml"
    file.write_text(f"\n[{section}]\n{key} = {written(entry.default)}\n")
    loaded = load(file)
    assert value_of(loaded.settings, entry.path) == entry.default
    assert loaded.origins[entry.path] == f"{file}:3"
    again = load(None, [f"{entry.path}={written(entry.default)}"])
    assert value_of(again.settings, entry.path) == entry.default
    assert again.origins[entry.path] == "--set"


@pytest.mark.parametrize("entry", BOUNDED, ids=lambda entry: entry.path)
def test_a_number_outside_its_limits_is_refused_with_the_limit(entry: Entry):
    for beyond in (entry.limits.low - 1, entry.limits.high + 1, math.inf, math.nan):
        if isinstance(entry.default, int) and not math.isfinite(beyond):
            continue
        text = str(round(beyond)) if isinstance(entry.default, int) else str(beyond)
        text = f"[{text}]" if isinstance(entry.default, tuple) else text
        with pytest.raises(SettingsError, match=re.escape(entry.path)) as fault:
            load(None, [f"{entry.path}={text}"])
        assert f"{entry.limits.high:g}" in str(fault.value) or "finite" in str(fault.value)


def test_all_faults_are_reported_each_with_path_place_and_remedy(tmp_path: Path):
    file = tmp_path / "bad.toml"
    file.write_text(
        '[camera]\nmount_yaw_deg = 200\ncalibraton = "x"\ntime_offset_s = "late"\n'
        '[vehicel]\nname = "x"\n[estimator]\nmethod = "mapp"\nuse_attitude = 1\nseed = 1.5\n'
        "[zenoh]\nconnect = 7\n[landing.enabled]\nx = 1\n"
    )
    with pytest.raises(SettingsError) as fault:
        load(file, ["estimator.sed=3", "nonsense"])
    lines = str(fault.value).splitlines()
    assert len(lines) == 11
    reported = dict(zip(range(11), lines, strict=True))
    assert reported[0] == f"{file}:2: camera.mount_yaw_deg = 200.0 is outside its limits -180 to 180 deg"
    assert reported[1] == f"{file}:3: there is no setting camera.calibraton; did you mean camera.calibration?"
    assert reported[2] == f'{file}:4: camera.time_offset_s must be a number, not "late"'
    assert "there is no section [vehicel]; did you mean vehicle?" in reported[3]
    assert "did you mean map?" in reported[4]
    assert "true or false" in reported[5]
    assert "an integer" in reported[6]
    assert "list of strings" in reported[7]
    assert "landing.enabled" in reported[8]
    assert "did you mean estimator.seed?" in reported[9]
    assert reported[10] == "--set nonsense: write section.key=value"


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"[camera\n", "is not TOML"),
        (b"\xff\xfe", "UTF-8"),
        (b"camera = 3\n", "camera is a section"),
        (b"[camera]\nmount_roll_deg = 1\nmount_roll_deg = 2\n", "is not TOML"),
    ],
)
def test_a_file_that_cannot_be_understood_is_one_clear_error(tmp_path: Path, content: bytes, says: str):
    file = tmp_path / "landslope.toml"
    file.write_bytes(content)
    with pytest.raises(SettingsError, match=says) as fault:
        load(file)
    assert str(file) in str(fault.value)


def test_a_missing_file_and_a_directory_are_named(tmp_path: Path):
    with pytest.raises(SettingsError, match="no such settings file"):
        load(tmp_path / "absent.toml")
    with pytest.raises(SettingsError, match="cannot be read"):
        load(tmp_path)


def test_overrides_win_and_take_bare_words_and_lists(tmp_path: Path):
    file = tmp_path / "landslope.toml"
    file.write_text('[vehicle]\nname = "one"\nsystem_id = 7\n')
    loaded = load(file, ["vehicle.name=42", "zenoh.connect=tcp/a:1,tcp/b:2", "estimator.method=quadratic"])
    assert loaded.settings.vehicle.name == "42"
    assert loaded.settings.vehicle.system_id == 7
    assert loaded.settings.zenoh.connect == ("tcp/a:1", "tcp/b:2")
    assert loaded.settings.estimator.method == "quadratic"
    assert loaded.origins["vehicle.system_id"] == f"{file}:3"


def test_paths_in_a_file_are_relative_to_the_file(tmp_path: Path):
    file = tmp_path / "deep" / "landslope.toml"
    file.parent.mkdir()
    file.write_text('[camera]\ncalibration = "camera.yaml"\n')
    assert load(file).settings.camera.calibration == str(tmp_path / "deep" / "camera.yaml")
    assert load(None, ["camera.calibration=x.yaml"]).settings.camera.calibration == str(
        Path("x.yaml").absolute()
    )


@given(st.text(max_size=200))
@examples(200)
def test_no_text_makes_the_reader_fail_in_another_way_than_its_own(text: str):
    with pytest.raises(SettingsError):
        load(None, [text + "?"])


def test_check_prints_the_settings_in_force_and_they_can_be_read_back(tmp_path: Path, capsys):
    file = tmp_path / "landslope.toml"
    file.write_text("[decision]\nmax_inclination_deg = 7.5\n")
    assert cli.main(["check", str(file), "--set", "vehicle.name=kestrel"]) == 0
    printed = capsys.readouterr().out
    assert f"deg; steepest surface that is landed on; from {file}:2" in printed
    copy = tmp_path / "copy.toml"
    copy.write_text(printed)
    expected = load(file, ["vehicle.name=kestrel"]).settings
    assert load(copy).settings == expected
    assert dataclasses.asdict(expected)["decision"]["max_inclination_deg"] == 7.5


@pytest.mark.parametrize("command", [["check"], ["schema", "event"]], ids=["long", "short"])
def test_output_that_nobody_reads_is_no_error(command: list[str]):
    read, write = os.pipe()
    os.close(read)
    words = [sys.executable, "-m", "companion.cli", *command]
    result = subprocess.run(words, stdout=write, stderr=subprocess.PIPE, timeout=3600)
    os.close(write)
    assert result.stderr == b""


def test_check_ends_with_2_and_one_line_a_fault(tmp_path: Path, capsys):
    file = tmp_path / "landslope.toml"
    file.write_text('[decision]\ndwell_s = 99\n[camera]\ncalibration = "absent.yaml"\nmount_roll_deg = 999\n')
    assert cli.main(["check", str(file)]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 2
    file.write_text('[camera]\ncalibration = "absent.yaml"\n')
    assert cli.main(["check", str(file)]) == 2
    assert "there is no such file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("focal_px", "more", "words"),
    [
        (21.0, (), "camera.calibration: .*84 degrees off the axis"),
        (256.0, ("--set", "camera.width=640"), "640 x 240, and .* is for 320 x 240"),
    ],
)
def test_check_refuses_a_calibration_that_does_not_fit(
    tmp_path: Path, capsys, focal_px: float, more: tuple[str, ...], words: str
):
    path = tmp_path / "camera.yaml"
    matrix = (focal_px, 0.0, 159.5, 0.0, focal_px, 119.5, 0.0, 0.0, 1.0)
    write_camera_info(path, CameraInfo(320, 240, matrix, (0.0,) * 5))
    assert cli.main(["check", "--set", f"camera.calibration={path}", *more]) == 2
    said = capsys.readouterr().err
    assert re.search(words, said)
    assert said.count("\n") == 1
