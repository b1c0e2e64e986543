"""What 'landslope install' does, as a list of steps that can be shown before any of them is taken."""

import grp
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib.metadata import distribution, version
from pathlib import Path
from urllib.parse import unquote, urlparse

from companion.errors import LandslopeError
from companion.install.manual import DOCUMENTS
from companion.install.shipped import shipped

UNIT = "landslope.service"
DEFAULT_PREFIX = Path("/opt/landslope")
SYSTEM_FILES = {
    UNIT: Path("/etc/systemd/system") / UNIT,
    "landslope.sysusers.conf": Path("/etc/sysusers.d/landslope.conf"),
    "70-landslope.rules": Path("/etc/udev/rules.d/70-landslope.rules"),
}
"""Shipped file -> where the system looks for it; written anew by every installation."""

COMMAND = Path("/usr/local/bin/landslope")
"""The command on PATH: a link into the environment."""
SETTINGS_DIRECTORY = Path("/etc/landslope")
SETTINGS_FILES = ("landslope.toml", "zenoh.json5")
"""Written once; later only their examples beside them."""

STATE_DIRECTORY = Path("/var/lib/landslope")
DEBIAN_PACKAGE = Path("/var/lib/dpkg/info/landslope.list")
"""There while the Debian package is installed, whose files lie elsewhere."""
USER = "landslope"
"""Made by the sysusers file, with a group of the same name that goes with it."""
COMMAND_TIMEOUT_S = 1800


@dataclass(frozen=True, slots=True)
class Step:
    """One thing to be done, in words, and doing it."""

    text: str
    act: Callable[[], None]


@dataclass(frozen=True, slots=True)
class InstallOptions:
    """``root``: lay the files out below it and touch nothing else; None installs on this machine."""

    prefix: Path = DEFAULT_PREFIX
    root: Path | None = None
    package: str = ""
    system_site_packages: bool = False
    enable: bool = True
    documents: Mapping[Path, str] = field(default_factory=dict)
    """Texts by the paths they are written to: completions and the man page."""


def install_steps(options: InstallOptions) -> Iterator[Step]:
    """Put landslope on this machine, or a newer one over it; settings that are there stay as they are."""
    if options.root is None:
        yield from _environment(options)
    for name, target in SYSTEM_FILES.items():
        yield _write(shipped(name).read_text(encoding="utf-8"), target, options)
    yield _link(options)
    for target, text in options.documents.items():
        yield _write(text, target, options)
    for name in SETTINGS_FILES:
        text = shipped(name).read_text(encoding="utf-8")
        target = SETTINGS_DIRECTORY / name
        if _below(options.root, target).exists():
            yield Step(f"keep {target}", lambda: None)
            yield _write(text, target.with_name(name + ".example"), options)
        else:
            yield _write(text, target, options)
    if options.root is None:
        yield _command("systemd-sysusers", str(SYSTEM_FILES["landslope.sysusers.conf"]))
    if options.root is None and systemd_runs():
        yield _tolerated(_command("udevadm", "control", "--reload"))
        yield _tolerated(
            _command("udevadm", "trigger", "--subsystem-match=tty", "--subsystem-match=video4linux")
        )
        yield _command("systemctl", "daemon-reload")
        yield _command("systemctl", "try-restart", UNIT)
    elif options.root is None:
        yield Step(
            "systemd does not run here: the service starts at the next boot",
            lambda: None,
        )
    if options.enable and options.root is not None and not _is_ours(_below(options.root, options.prefix)):
        text = f"not enabled: no environment is at {options.prefix} below {options.root} yet; make it, then"
        yield Step(f"{text} 'systemctl --root={options.root} enable {UNIT}'", lambda: None)
    elif options.enable:
        where = [] if options.root is None else [f"--root={options.root}"]
        yield _command("systemctl", *where, "enable", UNIT)


def uninstall_steps(options: InstallOptions, purge: bool) -> Iterator[Step]:
    """Take landslope off again; settings and flights stay unless ``purge``."""
    if options.root is None:
        now = ("--now",) if systemd_runs() else ()
        yield _command("systemctl", "disable", *now, UNIT)
    elif _below(options.root, SYSTEM_FILES[UNIT]).exists():
        yield _command("systemctl", f"--root={options.root}", "disable", UNIT)
    for target in (*SYSTEM_FILES.values(), *DOCUMENTS):
        yield _remove(target, options)
    if _links_to(_below(options.root, COMMAND), options.prefix):
        yield _remove(COMMAND, options)
    if _is_ours(_below(options.root, options.prefix)):
        yield _remove(options.prefix, options)
    if purge:
        yield _remove(SETTINGS_DIRECTORY, options)
        yield _remove(STATE_DIRECTORY, options)
        if options.root is None:
            yield _tolerated(_command("userdel", USER), "the user stays")
            yield Step(f"remove the group {USER}, which users may have joined", _remove_group)
    if options.root is None and systemd_runs():
        yield _command("systemctl", "daemon-reload")
        yield _tolerated(_command("udevadm", "control", "--reload"))


def systemd_runs() -> bool:
    """Whether this machine was booted by systemd: not so in a chroot, where units are only enabled."""
    return Path("/run/systemd/system").is_dir()


def command_on_path(options: InstallOptions) -> str:
    """What a user types to call the landslope that is installed: its name alone where the link to it is on PATH."""
    linked = options.root is None and shutil.which("landslope") == str(COMMAND)
    linked = linked and _links_to(COMMAND, options.prefix)
    return "landslope" if linked else str(options.prefix / "bin" / "landslope")


def check_rights(options: InstallOptions) -> None:
    """LandslopeError unless this machine may be changed, or another directory is meant."""
    if options.root is None and os.geteuid() != 0:
        raise LandslopeError(
            "installing on this machine needs root: use sudo; --dry-run shows what would be done"
        )
    if options.root is None and DEBIAN_PACKAGE.exists():
        raise LandslopeError(
            "landslope is installed here as a Debian package: upgrade it with 'apt install ./landslope_*.deb', "
            "take it off with 'apt remove landslope' or 'apt purge landslope'"
        )
    if not options.prefix.is_absolute():
        raise LandslopeError(f"--prefix {options.prefix}: give an absolute path, as {DEFAULT_PREFIX}")


def _environment(options: InstallOptions) -> Iterator[Step]:
    """The virtual environment at the prefix; nothing when landslope runs out of that very one."""
    python = options.prefix / "bin" / "python"
    if Path(sys.prefix) == options.prefix:
        yield Step(f"keep the environment {options.prefix}, this landslope runs out of it", lambda: None)
        return
    arguments = ["--system-site-packages"] if options.system_site_packages else []
    if not python.exists():
        yield _command(sys.executable, "-m", "venv", *arguments, str(options.prefix))
    package = options.package or _this_package()
    yield _command(str(python), "-m", "pip", "install", "--upgrade", package)


def _this_package() -> str:
    """The argument of pip: the wheel or checkout that this landslope came from, else this version from an index."""
    checkout = Path(__file__).parents[2]
    if (checkout / "pyproject.toml").is_file():
        return str(checkout)
    origin = distribution("landslope").read_text("direct_url.json")  # PEP 610
    address = urlparse(json.loads(origin).get("url", "")) if origin else None
    if address is not None and address.scheme == "file":
        path = Path(unquote(address.path))
        if not path.exists():
            raise LandslopeError(
                f"{path}, which landslope was installed from, is gone: name a wheel with --package"
            )
        return str(path)
    return f"landslope=={version('landslope')}"


def _write(text: str, target: Path, options: InstallOptions) -> Step:
    text = text.replace(str(DEFAULT_PREFIX), str(options.prefix))

    def act() -> None:
        path = _below(options.root, target)
        temporary = path.with_name(path.name + ".tmp")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            temporary.write_text(text, encoding="utf-8")
            temporary.chmod(0o644)
            temporary.replace(path)
        except OSError as error:
            raise LandslopeError(f"{path}: cannot be written: {error.strerror}") from error

    return Step(f"write {target}", act)


def _link(options: InstallOptions) -> Step:
    path = _below(options.root, COMMAND)
    if (path.exists() or path.is_symlink()) and not _links_to(path, options.prefix):
        return Step(f"keep {COMMAND}, which is not this installation's", lambda: None)

    def act() -> None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.unlink(missing_ok=True)
            path.symlink_to(options.prefix / "bin" / "landslope")
        except OSError as error:
            raise LandslopeError(f"{path}: cannot be linked: {error.strerror}") from error

    return Step(f"link {COMMAND}", act)


def _links_to(path: Path, prefix: Path) -> bool:
    return path.is_symlink() and path.readlink() == prefix / "bin" / "landslope"


def _remove(target: Path, options: InstallOptions) -> Step:
    def act() -> None:
        path = _below(options.root, target)
        try:
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)
        except OSError as error:
            raise LandslopeError(f"{path}: cannot be removed: {error.strerror}") from error

    return Step(f"remove {target}", act)


def _command(*words: str) -> Step:
    def act() -> None:
        try:
            done = subprocess.run(
                words, capture_output=True, text=True, timeout=COMMAND_TIMEOUT_S, check=False
            )
        except FileNotFoundError as error:
            raise LandslopeError(
                f"{words[0]}: not found; landslope install is for systems with systemd"
            ) from error
        except subprocess.TimeoutExpired as error:
            raise LandslopeError(f"'{' '.join(words)}' took longer than {COMMAND_TIMEOUT_S} s") from error
        if done.returncode:
            said = (done.stderr or done.stdout).strip().splitlines()
            reason = said[-1] if said else f"exit code {done.returncode}"
            raise LandslopeError(f"'{' '.join(words)}' failed: {reason}")

    return Step(f"run {' '.join(words)}", act)


def _tolerated(step: Step, otherwise: str = "it takes effect at the next boot") -> Step:
    """The same step; a failure is reported with its consequence, and the next step follows."""

    def act() -> None:
        try:
            step.act()
        except LandslopeError as error:
            print(f"  {error}; {otherwise}", flush=True)

    return Step(step.text, act)


def _remove_group() -> None:
    """userdel leaves the user's group where others have joined it."""
    try:
        grp.getgrnam(USER)
    except KeyError:
        return
    _tolerated(_command("groupdel", USER), "the group stays").act()


def _is_ours(prefix: Path) -> bool:
    """Whether a prefix is an environment made for landslope, and may be removed whole."""
    return (prefix / "pyvenv.cfg").is_file() and (prefix / "bin" / "landslope").exists()


def _below(root: Path | None, path: Path) -> Path:
    return path if root is None else root / path.relative_to("/")
