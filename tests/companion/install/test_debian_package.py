"""The Debian package: built, installed, upgraded, removed and purged in a root of its own over this machine's files."""

import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import nspawn_support
import pytest
from places import REPOSITORY

PROJECT = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
VERSION = PROJECT["version"]
PACKAGE = f"landslope_{VERSION}_amd64.deb"
SYSTEMS_PYTHON = Path("/usr/bin/python3")

SCRIPT = """
cd /opt/landslope-test
note() { echo "$1 = '$2'" >> results.toml; }
mkdir -p /etc/systemd/system
echo '[Service]' > /etc/systemd/system/landslope.service
dpkg --force-depends -i PACKAGE 2> refused.txt; note beside_another "$?"
rm /etc/systemd/system/landslope.service
dpkg --force-depends -i PACKAGE; note install "$?"
note version "$(landslope --version)"
note user "$(id -Gn landslope)"
note enabled "$(systemctl is-enabled landslope)"
note unit_in_force "$(readlink -f /etc/systemd/system/multi-user.target.wants/landslope.service)"
echo '# mine' >> /etc/landslope/landslope.toml
mkdir -p /var/lib/landslope/flights
systemctl disable landslope
rm -r /opt/landslope/bin
dpkg --force-depends --force-confold -i PACKAGE; note upgrade "$?"
note version_after "$(landslope --version)"
note mine "$(tail -1 /etc/landslope/landslope.toml)"
note enabled_after "$(systemctl is-enabled landslope)"
usermod -aG landslope daemon
dpkg --remove landslope; note remove "$?"
note kept "$(ls -d /etc/landslope/landslope.toml /var/lib/landslope/flights /opt/landslope 2>/dev/null | tr '\\n' ' ')"
dpkg --purge landslope; note purge "$?"
note left "$(getent passwd landslope; getent group landslope; ls -d /etc/landslope /var/lib/landslope)"
""".replace("PACKAGE", PACKAGE)


def wheel(folder: Path, name: str, version: str, files: dict[str, bytes], requires: list[str]) -> None:
    """A wheel of pure Python, without a network and without a build backend."""
    plain = name.replace("-", "_")
    about = f"{plain}-{version}.dist-info"
    needs = "".join(f"Requires-Dist: {line}\n" for line in requires)
    files = files | {
        f"{about}/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n{needs}".encode(),
        f"{about}/WHEEL": b"Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    record = "".join(f"{path},,\n" for path in (*files, f"{about}/RECORD"))
    with zipfile.ZipFile(folder / f"{plain}-{version}-py3-none-any.whl", "w") as archive:
        for path, data in {**files, f"{about}/RECORD": record.encode()}.items():
            archive.writestr(path, data)


@pytest.fixture(scope="module")
def package(tmp_path_factory) -> Path:
    """The package of this checkout's own code; the libraries it needs are empty wheels."""
    folder = tmp_path_factory.mktemp("debian")
    wheels = folder / "wheels"
    wheels.mkdir()
    for line in PROJECT["dependencies"]:
        wheel(wheels, line.split(">=")[0], "99", {}, [])
    code = {
        str(path.relative_to(REPOSITORY)): path.read_bytes()
        for package in ("companion", "drivers", "landing")
        for path in (REPOSITORY / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    scripts = "\n".join(f"{name} = {where}" for name, where in PROJECT["scripts"].items())
    code[f"landslope-{VERSION}.dist-info/entry_points.txt"] = f"[console_scripts]\n{scripts}\n".encode()
    for path in (REPOSITORY / "systemd").glob("*.*"):
        code[f"landslope-{VERSION}.data/data/share/landslope/systemd/{path.name}"] = path.read_bytes()
    wheel(wheels, "landslope", VERSION, code, PROJECT["dependencies"])
    subprocess.run(
        ["sh", str(REPOSITORY / "systemd/debian/build.sh"), "--wheels", str(wheels), str(folder)],
        check=True,
        capture_output=True,
        env={"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "PYTHON": sys.executable},
    )
    return folder / PACKAGE


def can_install() -> bool:
    """Whether this machine has dpkg, a Python of the system's that makes environments, and containers."""
    if not all(map(shutil.which, ("dpkg", "dpkg-deb"))) or not nspawn_support.possible():
        return False
    found = subprocess.run([SYSTEMS_PYTHON, "-c", "import ensurepip, venv"], check=False, capture_output=True)
    return SYSTEMS_PYTHON.exists() and found.returncode == 0


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("dpkg-deb") is None, reason="needs dpkg-deb")
def test_the_package_carries_everything_and_asks_for_a_python_it_has_wheels_for(package):
    control = subprocess.run(
        ["dpkg-deb", "--info", package], check=True, capture_output=True, text=True
    ).stdout
    assert f"Version: {VERSION}\n" in control
    assert "python3 (>= 3.11), python3 (<< 3.14~), python3-venv" in control
    listed = subprocess.run(["dpkg-deb", "-c", package], check=True, capture_output=True, text=True).stdout
    paths = {line.split()[5].removeprefix(".") for line in listed.splitlines()}
    assert paths >= {
        "/usr/lib/systemd/system/landslope.service",
        "/usr/lib/sysusers.d/landslope.conf",
        "/usr/lib/udev/rules.d/70-landslope.rules",
        "/usr/share/bash-completion/completions/landslope",
        "/usr/share/zsh/vendor-completions/_landslope",
        "/usr/share/man/man1/landslope.1.gz",
        "/usr/bin/landslope",
        "/etc/landslope/landslope.toml",
        f"/usr/share/landslope/wheels/landslope-{VERSION}-py3-none-any.whl",
    }
    assert all("root/root" in line for line in listed.splitlines())


@pytest.mark.slow
@pytest.mark.skipif(not can_install(), reason="needs root, dpkg, systemd-nspawn and overlay mounts")
def test_it_installs_with_one_command_and_purge_leaves_nothing(package, tmp_path):
    with nspawn_support.overlay(tmp_path) as root:
        if root is None:
            pytest.skip("overlay mounts are not allowed here")
        results = root / "opt/landslope-test"
        results.mkdir()
        shutil.copy(package, results)
        (results / "script").write_text(SCRIPT)
        done = subprocess.run(
            [
                "systemd-nspawn",
                f"--directory={root}",
                "--register=no",
                "--keep-unit",
                "--quiet",
                "--private-network",
                "--pipe",
                "/bin/sh",
                "/opt/landslope-test/script",
            ],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )
        said = done.stdout + done.stderr
        if not (results / "results.toml").exists():
            pytest.skip(f"nothing runs in a container here: {said[-300:]}")
        found = tomllib.loads((results / "results.toml").read_text())
        refused = (results / "refused.txt").read_text()
        shutil.rmtree(results)
        upper = root.parent / "upper"
        left = [
            str(path.relative_to(upper))
            for path in upper.rglob("*landslope*")
            if path.is_file() and not path.is_relative_to(upper / "var/log")
        ]
    assert (found["install"], found["version"]) == ("0", f"landslope {VERSION}"), said
    assert set(found["user"].split()) == {"landslope", "video", "dialout"}, said
    assert found["enabled"] == "enabled", said
    assert found["unit_in_force"] == "/usr/lib/systemd/system/landslope.service", said
    assert (found["upgrade"], found["mine"], found["enabled_after"]) == ("0", "# mine", "disabled"), said
    assert found["version_after"] == f"landslope {VERSION}", said
    assert (found["remove"], found["kept"].split()) == (
        "0",
        ["/etc/landslope/landslope.toml", "/var/lib/landslope/flights"],
    ), said
    assert (found["purge"], found["left"]) == ("0", ""), said
    assert left == [], said
    assert found["beside_another"] != "0"
    assert "landslope install --uninstall" in refused
