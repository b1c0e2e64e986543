"""The package as a library: its public names, and the documented example on rendered images."""

import csv
import re
import subprocess
import sys
from pathlib import Path

import cv2
import pytest
from places import DOCS, REPOSITORY

import landing
from drivers.simulated.world.sequences import plane_sequence

EXAMPLE = DOCS / "examples" / "slope.py"
MAX_LINES = 25
RATE_HZ = 30.0


def test_the_public_names_are_there_and_documented():
    page = (DOCS / "library.md").read_text()
    for name in landing.__all__:
        assert getattr(landing, name).__name__ == name
        assert f"`{name}" in page
    with pytest.raises(AttributeError, match="Pipelines"):
        _ = landing.Pipelines


def test_importing_the_package_alone_loads_no_opencv():
    code = "import sys, landing.options; sys.exit('cv2' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=REPOSITORY, timeout=3600).returncode == 0


def test_the_documented_example_is_short_and_the_file():
    code = EXAMPLE.read_text()
    assert len(code.splitlines()) <= MAX_LINES
    assert f"```python\n{code}```" in (DOCS / "library.md").read_text()


def test_the_example_measures_slope_and_relief_of_rendered_images(tmp_path: Path):
    made = plane_sequence("gravel", 15.0, "y", "x", 24, fine=False)
    with (tmp_path / "attitudes.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(("time_s", "roll_deg", "pitch_deg", "yaw_deg"))
        for k, image in enumerate(made.images):
            cv2.imwrite(str(tmp_path / f"{k:04}.png"), image)
            rows.writerow((k / RATE_HZ, 0, 0, 0))
    focal_px = str(float(made.lens.matrix[0, 0]))
    words = [sys.executable, str(EXAMPLE), str(tmp_path), focal_px]
    result = subprocess.run(words, cwd=REPOSITORY, capture_output=True, text=True, timeout=3600, check=True)
    lines = result.stdout.splitlines()
    assert len(lines) == 24
    found = re.fullmatch(r"23 ok: inclination (\S+) deg \+- (\S+), relief (\S+) of the distance", lines[-1])
    assert found, lines[-1]
    inclination, sigma, relief = map(float, found.groups())
    assert inclination == pytest.approx(15.0, abs=0.7)
    assert 0 < sigma < 1
    assert relief < 0.009
