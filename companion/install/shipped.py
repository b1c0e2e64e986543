"""The files of systemd/ that come with the package, from a wheel or from the repository."""

from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from companion.errors import LandslopeError

FOLDER = "share/landslope/systemd"
"""Where a wheel puts them, under the environment's prefix."""


def shipped(name: str) -> Path:
    """Path of one shipped file; LandslopeError when the installation lacks it."""
    beside = Path(__file__).parents[2] / "systemd" / name
    if beside.is_file():
        return beside
    try:
        for file in distribution("landslope").files or ():
            if file.as_posix().endswith(f"{FOLDER}/{name}"):
                path = Path(str(file.locate())).resolve()
                if path.is_file():
                    return path
    except PackageNotFoundError:
        pass
    raise LandslopeError(f"{name}: not among the installed files; install landslope anew with pip")
