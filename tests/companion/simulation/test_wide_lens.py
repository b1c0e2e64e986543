"""A drone that looks down with a fisheye lens: simulated, recorded, calibrated, replayed, landed."""

import math
from pathlib import Path

import numpy as np
import pytest

from companion.simulation.lockstep import LockstepOptions, fly
from companion.simulation.scenario import parse_scenario
from drivers.errors import DriverError
from drivers.files.camera_info import read_camera_info
from drivers.simulated.world.lens import Lens

WIDE = """
description = "over a steep ramp onto level ground, with a fisheye lens"
duration_s = 6
[camera]
width_px = 160
height_px = 120
rate_hz = 15
fov_deg = 105
lens = "equidistant"
distortion = [-0.02, 0.01, -0.004, 0.001]
[start]
north_m = -6.0
height_m = 2.0
[[surface]]
kind = "strip"
profile = [[-40, -14.56], [0, 0], [40, 0]]
material = "gravel"
[[leg]]
seconds = 5
forward_m_s = 0.5
height_m = 2.0
[expect]
landing = "none"
"""


@pytest.mark.parametrize("coefficients", [(0, 0, 0, 0), (-0.02, 0.01, -0.004, 0.001)])
def test_the_simulated_fisheye_has_an_exact_inverse(coefficients: tuple):
    plain = Lens.from_fov(160, 120, 110, equidistant=True)
    lens = Lens(160, 120, plain.matrix, np.array(coefficients, float), equidistant=True)
    x, y = lens.rays()
    u, v = np.meshgrid(np.arange(160.0), np.arange(120.0))
    pixels = np.column_stack((u.ravel(), v.ravel()))
    np.testing.assert_allclose(
        lens.project(np.column_stack((x.ravel(), y.ravel())).astype(float)), pixels, atol=1e-4
    )
    assert math.degrees(math.atan(float(x.max()))) > 50


def test_a_fisheye_that_looks_behind_itself_is_refused():
    with pytest.raises(DriverError, match="85 at most"):
        Lens.from_fov(160, 120, 160, equidistant=True).rays()


def test_slopes_through_a_fisheye_lens_are_right(tmp_path: Path):
    result = fly(
        parse_scenario("wide", WIDE, "wide.toml"), options=LockstepOptions(record=tmp_path / "flight")
    )
    assert result.folder is not None
    info = read_camera_info(result.folder / "camera.yaml")
    assert (info.distortion_model, info.distortion) == ("equidistant", (-0.02, 0.01, -0.004, 0.001))
    ramp = [e.inclination_deg for e in result.estimates if e.status == "ok" and e.frame < 75]
    assert len(ramp) > 15
    # the whole view is on the ramp of 20 degrees
    assert np.median(ramp) == pytest.approx(math.degrees(math.atan2(14.56, 40)), abs=1.0)
