"""Check a settings file: what is wrong with it, or the settings in force and where each came from."""

import argparse
import sys
from pathlib import Path

from companion.errors import LandslopeError, SettingsError
from companion.settings.listing import in_force, markdown_table, missing_files
from companion.settings.settings import CameraSettings
from companion.settings.settings_file import load
from drivers.errors import DriverError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument(
        "file", nargs="?", type=Path, metavar="FILE", help="settings file (default: built-in settings)"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="SECTION.KEY=VALUE",
        dest="overrides",
        help="override a setting",
    )
    parser.add_argument("--all", action="store_true", help="list the internal settings too")
    parser.add_argument(
        "--table",
        action="store_true",
        help="print the users' settings as a table in Markdown; with --all the internal ones in a second table",
    )


def run(args: argparse.Namespace) -> int:
    """Print the settings in force (0), or one line for each fault (2)."""
    try:
        loaded = load(args.file, args.overrides)
        missing = list(missing_files(loaded))
        if missing:
            raise SettingsError("\n".join(missing))
        _check_calibration(loaded.settings.camera)
    except SettingsError as faults:
        print(faults, file=sys.stderr)
        return 2
    for note in loaded.notes:
        print(note, file=sys.stderr)
    if args.table:
        print("\n".join(markdown_table()))
        if args.all:
            print("\n" + "\n".join(markdown_table(internal=True)))
    else:
        print("\n".join(in_force(loaded, args.all)))
    return 0


def _check_calibration(camera: CameraSettings) -> None:
    """SettingsError for a calibration that no camera has, or of another size than the one asked for."""
    if not camera.calibration:
        return
    from companion.core.camera_model import model_of  # OpenCV, for those who have a calibration
    from drivers.files.camera_info import read_camera_info

    try:
        model = model_of(read_camera_info(Path(camera.calibration)), camera.calibration)
    except (LandslopeError, DriverError) as error:
        raise SettingsError(f"camera.calibration: {error}") from None
    wanted = (camera.width or model.width, camera.height or model.height)
    if wanted != (model.width, model.height):
        raise SettingsError(
            f"camera.width, camera.height: {wanted[0]} x {wanted[1]}, and {camera.calibration} is for "
            f"{model.width} x {model.height}: calibrate at the size that is flown"
        )
