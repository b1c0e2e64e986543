"""Look at everything before a flight: camera, exposure, link, rates, clocks, calibration, disk, zenoh.

Ends with 0 when all is well, 1 with warnings, 2 with failures.
"""

import argparse
import sys
from pathlib import Path

import cv2

from companion.doctor.doctor import examine
from companion.doctor.findings import exit_code
from companion.errors import LandslopeError, SettingsError
from companion.settings.settings_file import load

WIDTH = 12
SHORTEST_S = 3.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument("--config", type=Path, metavar="FILE", help="the settings, a landslope.toml")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="SECTION.KEY=VALUE",
        dest="overrides",
        help="override a setting",
    )
    parser.add_argument("--seconds", type=float, default=6.0, help="how long camera and link are watched (6)")


def run(args: argparse.Namespace) -> int:
    """Print one line a finding."""
    if args.seconds < SHORTEST_S:
        raise LandslopeError(
            f"--seconds {args.seconds:g} is too short to measure rates: at least {SHORTEST_S:g}"
        )
    cv2.setNumThreads(1)
    try:
        loaded = load(args.config, args.overrides)
    except SettingsError as faults:
        print(faults, file=sys.stderr)
        return 2
    findings = []
    for finding in examine(loaded, args.seconds):
        findings.append(finding)
        print(finding.line(WIDTH), flush=True)
    counts = [f"{sum(f.level == level for f in findings)} {level}" for level in ("ok", "warning", "failure")]
    print(", ".join(counts))
    return exit_code(findings)
