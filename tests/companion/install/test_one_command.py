"""One command installs: one environment, one download, and the command on PATH."""

import os
import subprocess
import sys

from places import REPOSITORY

from companion.cli import main
from companion.install.install import InstallOptions, install_steps


def test_another_landslope_on_the_path_stays(tmp_path, capsys):
    command = tmp_path / "usr/local/bin/landslope"
    command.parent.mkdir(parents=True)
    command.write_text("another one")
    assert main(["install", "--root", str(tmp_path), "--no-enable"]) == 0
    assert "keep /usr/local/bin/landslope, which is not this installation's" in capsys.readouterr().out
    assert main(["install", "--root", str(tmp_path), "--uninstall"]) == 0
    assert command.read_text() == "another one"


def test_one_command_makes_one_environment_and_installs_out_of_it(tmp_path):
    """The script with stand-ins for what it calls: what is called, in which order, and from where."""
    called = tmp_path / "called"
    fake = f'#!/bin/sh\necho "$(basename "$0") $*" >> {called}\n'
    make = '[ "$1" = -m ] && mkdir -p "$3/bin" && for n in python pip landslope; do cp "$0" "$3/bin/$n"; done; true\n'
    (tmp_path / "bin").mkdir()
    for name, text in (("python3", fake + make), ("id", "#!/bin/sh\necho 0\n")):
        (tmp_path / "bin" / name).write_text(text)
        (tmp_path / "bin" / name).chmod(0o755)
    script, prefix = REPOSITORY / "systemd" / "install.sh", tmp_path / "opt"
    path = f"{tmp_path / 'bin'}:{os.environ['PATH']}"
    for _ in range(2):
        subprocess.run(["sh", str(script), str(prefix)], check=True, env={"PATH": path})
    lines = [line for line in called.read_text().splitlines() if not line.startswith("python3 -c")]
    pip, install_it = f"pip install --quiet --upgrade {REPOSITORY}", f"landslope install --prefix {prefix}"
    assert lines == [f"python3 -m venv {prefix}", pip, install_it, pip, install_it]


def test_running_out_of_the_prefix_nothing_is_downloaded_again(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    said = [step.text for step in install_steps(InstallOptions(prefix=tmp_path))]
    assert not any("pip" in text or "venv" in text for text in said)
