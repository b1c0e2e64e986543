"""A real systemd in a container over the machine's own files, where that can be done: root, nspawn, overlay mounts."""

import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from places import REPOSITORY

PYTHON = f"bin/python{sys.version_info.major}.{sys.version_info.minor}"
PACKAGES = Path(sysconfig.get_path("purelib")).relative_to(sys.prefix)

WRAPPER = f"""#!/bin/sh
export PYTHONPATH=/opt/landslope-source:/opt/landslope-venv/{PACKAGES}
exec /opt/landslope-python/{PYTHON} -m companion.cli "$@"
"""

TESTER = """[Unit]
After=multi-user.target
[Service]
Type=oneshot
ExecStart=/bin/sh /opt/landslope-test/script
ExecStopPost=/bin/systemctl poweroff --force
TimeoutStartSec=90
"""


def possible() -> bool:
    """Whether this machine can boot systemd in a container."""
    tools = ("systemd-nspawn", "mount", "umount")
    if os.geteuid() != 0 or not all(map(shutil.which, tools)) or not Path("/lib/systemd/systemd").exists():
        return False
    return "overlay" in Path("/proc/filesystems").read_text()


@contextmanager
def overlay(directory: Path) -> Iterator[Path | None]:
    """A root directory that shows this machine's files and keeps all changes in memory; None: it cannot be mounted."""
    memory = directory / "memory"
    memory.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "tmpfs", str(memory)], check=False).returncode:
        yield None
        return
    upper, work, root = (memory / name for name in ("upper", "work", "root"))
    for path in (upper, work, root):
        path.mkdir()
    layers = f"lowerdir=/,upperdir={upper},workdir={work}"
    mounted = subprocess.run(["mount", "-t", "overlay", "overlay", "-o", layers, str(root)], check=False)
    try:
        yield root if mounted.returncode == 0 else None
    finally:
        if mounted.returncode == 0:
            subprocess.run(["umount", str(root)], check=False)
        subprocess.run(["umount", str(memory)], check=False)


def boot(root: Path, script: str, results: Path, timeout_s: float) -> str:
    """Boot, run ``script`` (its results go to /opt/landslope-test), power off; returns the console's text."""
    for path, text, mode in (
        ("opt/landslope/bin/landslope", WRAPPER, 0o755),
        ("etc/systemd/system/landslope-test.service", TESTER, 0o644),
    ):
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).write_text(text)
        (root / path).chmod(mode)
    (results / "script").write_text(script)
    wants = root / "etc/systemd/system/multi-user.target.wants"
    wants.mkdir(parents=True, exist_ok=True)
    command = [
        "systemd-nspawn",
        f"--directory={root}",
        "--register=no",
        "--keep-unit",
        "--quiet",
        "--private-network",
        "--console=pipe",
        f"--bind-ro={REPOSITORY}:/opt/landslope-source",
        f"--bind-ro={sys.prefix}:/opt/landslope-venv",
        f"--bind-ro={sys.base_prefix}:/opt/landslope-python",
        f"--bind={results}:/opt/landslope-test",
        "--boot",
        "--",
        "systemd.unit=landslope-test.service",
    ]
    with (results / "console.txt").open("w+") as console:
        try:
            subprocess.run(
                command,
                stdin=subprocess.DEVNULL,
                stdout=console,
                stderr=subprocess.STDOUT,
                timeout=timeout_s,
                check=False,
            )
        except subprocess.TimeoutExpired:
            console.write(f"no end within {timeout_s:g} s")
    return (results / "console.txt").read_text(errors="replace")
