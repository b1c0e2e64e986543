"""Users' settings and internal settings: how many, where each is listed, and names of earlier versions."""

import re
import tomllib
from pathlib import Path

import pytest
from places import REPOSITORY

from companion import cli
from companion.doctor.system import settings_findings
from companion.errors import SettingsError
from companion.settings import settings_file
from companion.settings.marks import UserSettings
from companion.settings.moved import MOVED, Moved
from companion.settings.settings import Settings
from companion.settings.settings_file import entries, load

MAX_USERS_SETTINGS = 110
INTERNAL = [entry.path for entry in entries() if entry.internal]
USERS = [entry.path for entry in entries() if not entry.internal]
TEMPLATE = REPOSITORY / "systemd" / "landslope.toml"
DOCUMENT = REPOSITORY / "docs" / "settings.md"
FIRST_VERSION = Path(__file__).with_name("settings_0_1.toml")


def template_with_everything() -> str:
    """The template with each setting that is commented out put in force."""
    return re.sub(r"(?m)^# (\w+ = )", r"\1", TEMPLATE.read_text())


def test_there_are_few_enough_settings_for_users():
    assert 0 < len(USERS) <= MAX_USERS_SETTINGS


def test_every_mark_names_settings_of_its_section():
    for name, hint in Settings.__annotations__.items():
        for mark in getattr(hint, "__metadata__", ()):
            if isinstance(mark, UserSettings):
                missing = [key for key in mark.names if not hasattr(getattr(Settings(), name), key)]
                assert missing == [], name


def test_the_template_has_every_users_setting_with_its_default_and_no_internal_one(tmp_path: Path):
    tables = tomllib.loads(template_with_everything())
    assert sorted(f"{section}.{key}" for section, table in tables.items() for key in table) == sorted(USERS)
    kept_out = {"camera.source", "mavlink.connection", "record.directory"}
    (tmp_path / "landslope.toml").write_text(template_with_everything())
    loaded = load(tmp_path / "landslope.toml")
    for entry in entries():
        if not entry.internal and not entry.is_file and entry.path not in kept_out:
            assert settings_file.value_of(loaded.settings, entry.path) == entry.default, entry.path


def test_check_lists_internal_settings_only_when_set_or_asked_for(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["check", "--set", f"{INTERNAL[0]}=0.05"]) == 0
    few = tomllib.loads(capsys.readouterr().out)
    assert cli.main(["check", "--all"]) == 0
    everything = tomllib.loads(capsys.readouterr().out)
    names = [f"{section}.{key}" for section, table in few.items() for key in table]
    assert sorted(names) == sorted([*USERS, INTERNAL[0]])
    assert sum(map(len, everything.values())) == len(USERS) + len(INTERNAL)


def test_the_documentation_has_both_tables(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["check", "--table"]) == 0
    users = capsys.readouterr().out.strip()
    assert cli.main(["check", "--table", "--all"]) == 0
    both = capsys.readouterr().out.strip()
    for table in (users, both.removeprefix(users).strip()):
        assert table in DOCUMENT.read_text(), (
            "run 'landslope check --table --all' and put its tables into docs/settings.md"
        )


def test_a_file_with_all_settings_of_the_first_version_still_loads():
    loaded = load(FIRST_VERSION)
    assert loaded.settings.estimator.method == "map"


def test_no_moved_setting_hides_one_that_exists():
    assert set(MOVED).isdisjoint(USERS + INTERNAL)
    assert {moved.now for moved in MOVED.values() if moved.now} <= set(USERS + INTERNAL)


def test_an_old_name_sets_the_new_setting_and_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setitem(MOVED, "camera.offset_s", Moved("camera.time_offset_s"))
    monkeypatch.setitem(MOVED, "decision.luck", Moved(why="a landing needs none"))
    file = tmp_path / "landslope.toml"
    file.write_text("[camera]\noffset_s = 0.02\n[decision]\nluck = 1\n")
    loaded = load(file)
    assert loaded.settings.camera.time_offset_s == 0.02
    assert loaded.origins["camera.time_offset_s"] == f"{file}:2"
    assert loaded.notes == (
        f"{file}:2: camera.offset_s is now camera.time_offset_s",
        f"{file}:4: decision.luck has no effect any more: a landing needs none",
    )
    assert cli.main(["check", str(file)]) == 0
    assert "camera.offset_s is now camera.time_offset_s" in capsys.readouterr().err
    warnings = [finding for finding in settings_findings(loaded) if finding.level == "warning"]
    assert len(warnings) == 2
    assert load(None, ["camera.offset_s=0.03"]).settings.camera.time_offset_s == 0.03


def test_an_old_name_is_checked_against_the_new_limits(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(MOVED, "camera.offset_s", Moved("camera.time_offset_s"))
    with pytest.raises(SettingsError, match=r"camera\.time_offset_s = 2\.0 is outside its limits"):
        load(None, ["camera.offset_s=2.0"])


def test_flight_modes_are_read_in_any_spelling_and_checked(tmp_path: Path):
    file = tmp_path / "landslope.toml"
    file.write_text(
        '[landing]\nallowed_modes = ["Position", "alt hold", "HOLD"]\nenable_modes = ["Position"]\n'
    )
    landing = settings_file.load(file).settings.landing
    assert landing.allowed_modes == ("POSCTL", "ALT_HOLD", "HOLD")
    assert landing.enable_modes == ("POSCTL",)
    file.write_text('[landing]\nallowed_modes = ["POSCTLL"]\nenable_modes = ["LAND"]\n')
    with pytest.raises(SettingsError) as faults:
        settings_file.load(file)
    assert "did you mean 'POSCTL'" in str(faults.value) or "POSCTL" in str(faults.value)
    assert "enters by itself" in str(faults.value)


@pytest.mark.parametrize(
    ("overrides", "words", "level"),
    [
        ((), "requests nothing", "ok"),
        (("landing.enable_modes=['Position']",), "enabled by choosing mode POSCTL", "ok"),
        (("landing.enable_rc_channel=7",), "enabled by RC channel 7", "ok"),
        (("landing.enabled=true",), "enabled from the start", "ok"),
        (("landing.enable_modes=['ALTCTL']",), "none of these modes", "warning"),
    ],
)
def test_the_doctor_says_what_run_does(overrides: tuple[str, ...], words: str, level: str):
    (found,) = [f for f in settings_findings(load(None, overrides)) if f.subject == "landing"]
    assert words in found.text
    assert found.level == level
