"""Settings files made to take long, to nest without end or to hold what no number is: one line, soon, no traceback."""

import os
import time

import pytest

from companion.cli import main
from companion.settings.settings_file import load
from companion.settings.toml_text import DEEPEST

HOSTILE = {
    "lists": "a = " + "[" * 5000 + "]" * 5000,
    "tables": "[" + ".".join("a" * 3000) + "]\nb = 1",
    "dotted keys": ".".join("a" * 2000) + " = 1",
    "digits": "[camera]\nrate_hz = " + "9" * 5000,
    "a large integer": "[camera]\nwidth = " + "9" * 4000,
    "an integer beyond floats": "[camera]\nrate_hz = 1" + "0" * 400,
    "a date": "[camera]\nrate_hz = 1979-05-27T07:32:00Z",
    "length": "a = '" + "x" * 2_000_000 + "'",
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_hostile_settings_file_is_refused_in_one_short_line(tmp_path, capsys, kind):
    file = tmp_path / "landslope.toml"
    file.write_text(HOSTILE[kind])
    started = time.process_time()
    assert main(["check", str(file)]) == 2
    assert time.process_time() - started < 10
    said = capsys.readouterr().err.strip()
    assert said.count("\n") == 0
    assert len(said) < 300 + len(str(file))


def test_a_hostile_override_is_refused_in_one_line(capsys):
    assert main(["check", "--set", "camera.rate_hz=" + "[" * 3000]) == 2
    assert len(capsys.readouterr().err) < 4000


def test_what_is_nested_within_reason_is_read():
    assert load(None, ["camera.rate_hz=25"]).settings.camera.rate_hz == 25
    assert DEEPEST > 5


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
@pytest.mark.parametrize("command", ["replay", "calibrate"])
def test_a_folder_that_may_not_be_read_is_named_in_one_line(tmp_path, capsys, command):
    closed = tmp_path / "closed"
    closed.mkdir(mode=0)
    words = [command, str(closed / "flight")]
    assert main(words) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "group 'landslope'" in said


def test_an_error_of_the_system_is_one_line_with_its_file(monkeypatch, capsys):
    def refused(args):
        raise PermissionError(13, "Permission denied", "/var/lib/landslope/flights")

    monkeypatch.setattr("companion.commands.check.run", refused)
    assert main(["check"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "/var/lib/landslope/flights: Permission denied" in said
    assert "usermod -aG landslope" in said
