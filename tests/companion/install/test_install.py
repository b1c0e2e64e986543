"""The service's files: sound, tight, in their places, and the user's settings left alone."""

import json
import os
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest
from places import REPOSITORY

from companion.cli import main
from companion.errors import LandslopeError
from companion.install import install
from companion.install.install import InstallOptions, install_steps, uninstall_steps
from companion.install.shipped import shipped
from companion.settings.settings_file import load

UNIT = REPOSITORY / "systemd" / "landslope.service"
MOST_EXPOSED = "20"
"""systemd-analyze's exposure times ten: 2.0."""

analyze = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed"
)


@analyze
def test_the_unit_is_tight():
    done = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", f"--threshold={MOST_EXPOSED}", str(UNIT)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Overall exposure level" in done.stdout


@analyze
def test_the_unit_is_sound(tmp_path):
    """Verified with a command that exists, as the installed one does."""
    program = tmp_path / "bin" / "landslope"
    program.parent.mkdir()
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    unit = tmp_path / "landslope.service"
    unit.write_text(UNIT.read_text().replace("/opt/landslope", str(tmp_path)))
    done = subprocess.run(
        ["systemd-analyze", "verify", str(unit)], capture_output=True, text=True, check=False
    )
    said = [line for line in done.stderr.splitlines() if "landslope" in line]
    assert done.returncode == 0, done.stderr
    assert not said


def test_the_unit_is_fed_by_the_pipeline_and_restarts():
    text = UNIT.read_text()
    for line in (
        "Type=notify",
        "WatchdogSec=5",
        "Restart=always",
        "User=landslope",
        "RestartPreventExitStatus=2",
    ):
        assert f"\n{line}\n" in text


@pytest.mark.skipif(shutil.which("systemd-sysusers") is None, reason="systemd-sysusers is not installed")
def test_the_user_is_made(tmp_path):
    (tmp_path / "etc").mkdir()
    source = REPOSITORY / "systemd" / "landslope.sysusers.conf"
    subprocess.run(["systemd-sysusers", f"--root={tmp_path}", str(source)], check=True, capture_output=True)
    assert "/usr/sbin/nologin" in (tmp_path / "etc/passwd").read_text()
    groups = (tmp_path / "etc/group").read_text().splitlines()
    members = {line.split(":")[0]: line.split(":")[3] for line in groups}
    assert members["video"] == members["dialout"] == "landslope"


def test_the_settings_template_is_free_of_faults_and_asks_for_no_landing():
    settings = load(REPOSITORY / "systemd" / "landslope.toml").settings
    assert not settings.landing.enabled
    assert not settings.zenoh.scouting


def test_a_wheel_carries_all_the_files():
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())
    globs = project["tool"]["setuptools"]["data-files"]["share/landslope/systemd"]
    carried = {path for glob in globs for path in REPOSITORY.glob(glob)}
    assert carried == {path for path in (REPOSITORY / "systemd").iterdir() if path.is_file()}


def test_shipped_files_are_found_in_an_installation_without_the_repository(tmp_path, monkeypatch):
    folder = tmp_path / "share/landslope/systemd"
    folder.mkdir(parents=True)
    (folder / "landslope.toml").write_text("here")

    class File:
        def as_posix(self) -> str:
            return "../../../share/landslope/systemd/landslope.toml"

        def locate(self) -> Path:
            return folder / "landslope.toml"

    class Distribution:
        files = (File(),)

    monkeypatch.setattr(
        "companion.install.shipped.__file__", str(tmp_path / "site-packages/companion/install/shipped.py")
    )
    monkeypatch.setattr("companion.install.shipped.distribution", lambda name: Distribution())
    assert shipped("landslope.toml").read_text() == "here"
    with pytest.raises(LandslopeError, match="install landslope anew"):
        shipped("landslope.service")


def files(root: Path) -> dict[str, str]:
    """Texts of all files by their paths; of links where they lead."""
    return {
        str(path.relative_to(root)): str(path.readlink()) if path.is_symlink() else path.read_text()
        for path in root.rglob("*")
        if path.is_file() or path.is_symlink()
    }


def installed(root: Path, *arguments: str) -> int:
    return main(["install", "--root", str(root), "--no-enable", *arguments])


def test_installing_upgrading_and_taking_off(tmp_path, capsys):
    assert installed(tmp_path) == 0
    laid = files(tmp_path)
    assert sorted(laid) == [
        "etc/landslope/landslope.toml",
        "etc/landslope/zenoh.json5",
        "etc/systemd/system/landslope.service",
        "etc/sysusers.d/landslope.conf",
        "etc/udev/rules.d/70-landslope.rules",
        "usr/local/bin/landslope",
        "usr/local/share/bash-completion/completions/landslope",
        "usr/local/share/man/man1/landslope.1",
        "usr/local/share/zsh/site-functions/_landslope",
    ]
    assert laid["etc/systemd/system/landslope.service"] == UNIT.read_text()
    assert laid["usr/local/bin/landslope"] == "/opt/landslope/bin/landslope"
    settings = tmp_path / "etc/landslope/landslope.toml"
    settings.write_text("[vehicle]\nname = 'mine'\n")
    (tmp_path / "etc/systemd/system/landslope.service").write_text("[Unit]\n# an old one\n")
    capsys.readouterr()
    assert installed(tmp_path) == 0
    assert "keep /etc/landslope/landslope.toml" in capsys.readouterr().out
    upgraded = files(tmp_path)
    assert upgraded["etc/landslope/landslope.toml"] == "[vehicle]\nname = 'mine'\n"
    assert upgraded["etc/landslope/landslope.toml.example"] == laid["etc/landslope/landslope.toml"]
    assert upgraded["etc/systemd/system/landslope.service"] == UNIT.read_text()
    assert installed(tmp_path, "--uninstall") == 0
    assert all(name.startswith("etc/landslope/") for name in files(tmp_path))
    assert settings.exists()
    assert installed(tmp_path, "--uninstall", "--purge") == 0
    assert not files(tmp_path)


def test_another_prefix_stands_in_the_unit(tmp_path):
    assert installed(tmp_path, "--prefix", "/srv/landslope") == 0
    text = (tmp_path / "etc/systemd/system/landslope.service").read_text()
    assert "ExecStart=/srv/landslope/bin/landslope run" in text
    assert "/opt/landslope" not in text


@pytest.mark.skipif(shutil.which("systemctl") is None, reason="systemctl is not installed")
def test_an_image_starts_the_service_at_boot(tmp_path):
    for name in ("pyvenv.cfg", "bin/landslope"):  # the environment that an image brings
        (tmp_path / "opt/landslope" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "opt/landslope" / name).write_text("")
    assert main(["install", "--root", str(tmp_path)]) == 0
    link = tmp_path / "etc/systemd/system/multi-user.target.wants/landslope.service"
    assert link.is_symlink()
    assert main(["install", "--root", str(tmp_path), "--uninstall"]) == 0
    assert not link.is_symlink()


def test_an_image_without_an_environment_enables_nothing_that_cannot_start(tmp_path, capsys):
    assert main(["install", "--root", str(tmp_path)]) == 0
    assert not (tmp_path / "etc/systemd/system/multi-user.target.wants").exists()
    assert "not enabled: no environment" in capsys.readouterr().out


def test_purge_without_uninstall_does_nothing_and_says_so(tmp_path, capsys):
    assert main(["install", "--purge", "--root", str(tmp_path)]) == 2
    assert "--uninstall" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_in_a_chroot_units_are_enabled_and_nothing_is_asked_of_a_systemd_that_does_not_run(monkeypatch):
    monkeypatch.setattr(install, "systemd_runs", lambda: False)
    said = [step.text for step in install_steps(InstallOptions(package="landslope.whl"))]
    assert "run systemctl enable landslope.service" in said
    assert "run systemd-sysusers /etc/sysusers.d/landslope.conf" in said
    assert not any("daemon-reload" in text or "udevadm" in text or "try-restart" in text for text in said)
    said = [step.text for step in uninstall_steps(InstallOptions(), purge=True)]
    assert "run userdel landslope" in said
    assert any(text.startswith("remove the group landslope") for text in said)
    assert "run systemctl disable landslope.service" in said
    assert not any("daemon-reload" in text for text in said)


def test_beside_the_debian_package_it_refuses(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(install.os, "geteuid", lambda: 0)
    monkeypatch.setattr(install, "DEBIAN_PACKAGE", tmp_path / "landslope.list")
    (tmp_path / "landslope.list").touch()
    assert main(["install"]) == 2
    assert "upgrade it with 'apt install ./landslope_*.deb'" in capsys.readouterr().err


def test_the_next_step_is_a_command_that_is_found(tmp_path, capsys):
    assert main(["install", "--root", str(tmp_path), "--prefix", "/srv/landslope"]) == 0
    said = capsys.readouterr().out
    assert "/srv/landslope/bin/landslope doctor" in said
    assert "usermod -aG landslope" in said


def test_a_dry_run_says_everything_and_does_nothing(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(install, "systemd_runs", lambda: True)
    monkeypatch.setattr(subprocess, "run", lambda *args, **kwargs: pytest.fail("a command was run"))
    assert main(["install", "--dry-run", "--prefix", str(tmp_path / "opt")]) == 0
    said = capsys.readouterr().out
    for part in (
        "-m venv",
        "pip install --upgrade",
        "landslope.service",
        "daemon-reload",
        "enable",
        "sysusers",
    ):
        assert part in said
    assert main(["install", "--dry-run", "--uninstall", "--purge"]) == 0
    assert "remove /var/lib/landslope" in capsys.readouterr().out
    assert not list(tmp_path.iterdir())


def test_a_live_installation_runs_the_commands_in_order(tmp_path, monkeypatch):
    monkeypatch.setattr(install, "systemd_runs", lambda: True)
    ran = []
    monkeypatch.setattr(
        subprocess,
        "run",
        lambda words, **kwargs: ran.append(words) or subprocess.CompletedProcess(words, 0, "", ""),
    )
    monkeypatch.setattr(install, "SYSTEM_FILES", {name: tmp_path / name for name in install.SYSTEM_FILES})
    monkeypatch.setattr(install, "SETTINGS_DIRECTORY", tmp_path / "etc")
    monkeypatch.setattr(install, "COMMAND", tmp_path / "bin" / "landslope")
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:{os.environ['PATH']}")
    options = InstallOptions(prefix=tmp_path / "opt", package="landslope.whl")
    for step in install_steps(options):
        step.act()
    (tmp_path / "opt" / "bin").mkdir(parents=True)
    (tmp_path / "opt" / "bin" / "landslope").touch(0o755)
    assert install.command_on_path(options) == "landslope"
    programs = [words[0] if words[0].startswith("sys") else words[1:3] for words in ran]
    assert programs[:2] == [("-m", "venv"), ("-m", "pip")]
    assert ran[1][-1] == "landslope.whl"
    assert ran[-1] == ("systemctl", "enable", "landslope.service")
    assert ("systemctl", "try-restart", "landslope.service") in ran


def test_uninstalling_removes_no_directory_that_is_not_ours(tmp_path):
    (tmp_path / "opt/landslope").mkdir(parents=True)
    (tmp_path / "opt/landslope/thesis.tex").write_text("years of work")
    for step in uninstall_steps(InstallOptions(root=tmp_path), purge=True):
        step.act()
    assert (tmp_path / "opt/landslope/thesis.tex").exists()
    (tmp_path / "opt/landslope/bin").mkdir()
    (tmp_path / "opt/landslope/bin/landslope").touch()
    (tmp_path / "opt/landslope/pyvenv.cfg").touch()
    for step in uninstall_steps(InstallOptions(root=tmp_path), purge=False):
        step.act()
    assert not (tmp_path / "opt/landslope").exists()


def test_faults_are_said_in_one_line(tmp_path, monkeypatch, capsys):
    (tmp_path / "etc").write_text("a file where a directory should be")
    assert installed(tmp_path) == 2
    assert "cannot be written" in capsys.readouterr().err
    assert main(["install", "--root", str(tmp_path), "--prefix", "here"]) == 2
    assert "absolute path" in capsys.readouterr().err
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    assert main(["install"]) == 2
    assert "needs root" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("false",), "exit code 1"),
        (("sh", "-c", "echo broken >&2; exit 3"), "broken"),
        (("nowhere-cmd",), "not found"),
    ],
)
def test_a_command_that_fails_is_named(words, said):
    with pytest.raises(LandslopeError, match=said):
        install._command(*words).act()


@pytest.mark.parametrize(("there", "wanted"), [(True, "landslope.whl"), (False, None)])
def test_what_is_installed_is_what_this_landslope_came_from(tmp_path, monkeypatch, there, wanted):
    wheel = tmp_path / "landslope.whl"
    if there:
        wheel.touch()

    class Distribution:
        def read_text(self, name: str) -> str:
            assert name == "direct_url.json"
            return json.dumps({"url": wheel.as_uri()})

    monkeypatch.setattr(install, "__file__", str(tmp_path / "site-packages/companion/install/install.py"))
    monkeypatch.setattr(install, "distribution", lambda name: Distribution())
    if wanted:
        assert install._this_package() == str(tmp_path / wanted)
    else:
        with pytest.raises(LandslopeError, match="--package"):
            install._this_package()


def test_a_device_manager_that_does_not_run_is_passed_over(capsys):
    install._tolerated(install._command("sh", "-c", "echo no daemon >&2; exit 1")).act()
    assert "no daemon; it takes effect at the next boot" in capsys.readouterr().out
