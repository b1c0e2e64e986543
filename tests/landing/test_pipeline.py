"""The whole pipeline: pictures in, estimates out; rendered planes with known slopes, and a zoom if there is one."""

import dataclasses
import math
import os
from pathlib import Path

import image_sequences as sequences
import numpy as np
import pytest

from drivers.simulated.world.sequences import PlaneSequence, plane_sequence
from landing.errors import LandingError
from landing.observation import Observation
from landing.options import EstimatorOptions, Options
from landing.pipeline import SurfacePipeline
from landing.reasons import Code
from landing.rotations import matrix_from_euler
from landing.vision.camera import CameraModel, body_from_camera

ZOOM_VARIABLE = "LANDSLOPE_ZOOM_IMAGES"
MOVING = ("slope_x_deg", "inclination_deg", "roughness", "surface_pitch_deg", "downhill_bearing_deg")


@pytest.fixture(scope="module")
def slope() -> PlaneSequence:
    """Fifteen degrees, rising to the north, sideways to the east."""
    return plane_sequence("noise", 15.0, "y", "x", 24, fine=False)


@pytest.fixture(scope="module")
def camera(slope: PlaneSequence) -> CameraModel:
    return sequences.camera_of(slope)


@pytest.mark.parametrize(
    ("slope_deg", "axis", "motion"), [(0, "x", "x"), (30, "x", "y"), (45, "y", "x"), (60, "y", "y")]
)
def test_sideways(slope_deg: float, axis: str, motion: str):
    """``python tests/tools/image_sequences.py`` measures this over more textures."""
    made = plane_sequence("gravel", slope_deg, axis, motion, 24, fine=False)
    found = sequences.estimates(made.images, sequences.camera_of(made))
    error = np.abs(sequences.slope_errors_deg(made, found))[sequences.WARM_UP :]
    assert np.isfinite(error).all()
    assert np.median(error) < 0.6
    assert error.max() < 1.5


@pytest.mark.parametrize(("slope_deg", "axis"), [(0, "x"), (30, "y")])
def test_along_the_axis(slope_deg: float, axis: str):
    made = plane_sequence("noise", slope_deg, axis, "z", 60, tau=65.0, fine=False)
    found = sequences.estimates(made.images, sequences.camera_of(made))
    error = np.abs(sequences.slope_errors_deg(made, found))[sequences.WARM_UP :]
    assert np.isnan(error).mean() < 0.05
    assert np.nanmedian(error) < 0.4
    assert np.nanpercentile(error, 95) < 1.5
    contact = sequences.time_to_contact_errors(made.time_to_contact, found)[sequences.WARM_UP :]
    assert np.nanmedian(contact) < 0.01
    assert np.nanpercentile(contact, 95) < 0.05


def test_time_to_contact_over_a_zoom():
    folder = os.environ.get(ZOOM_VARIABLE)
    if not folder:
        pytest.skip(f"{ZOOM_VARIABLE} names no folder of zoom images")
    tau, found = sequences.zoom(Path(folder))
    error = sequences.time_to_contact_errors(tau, found)[tau >= 5]
    assert np.isnan(error).sum() <= 6
    median, p95 = np.nanpercentile(error, (50, 95))
    assert median < 0.005
    assert p95 < 0.015
    assert np.nanmax(error) < 0.03


def test_the_slope_is_where_it_is_in_the_world(slope: PlaneSequence, camera: CameraModel):
    last = sequences.estimates(slope.images, camera)[-1]
    assert last.status == "ok"
    assert (last.slope_x_deg, last.slope_y_deg) == pytest.approx(slope.slope_deg, abs=0.5)
    assert last.inclination_deg == pytest.approx(15, abs=0.5)
    # depth grows with y, to the south: the ground rises ahead and falls to the south
    assert last.downhill_bearing_deg == pytest.approx(180, abs=2)
    assert last.surface_pitch_deg == pytest.approx(15, abs=0.5)
    assert last.surface_roll_deg == pytest.approx(0, abs=0.5)
    assert not last.flat
    assert last.against_flat[0].code is Code.TOO_STEEP
    assert last.ventral_flow_x == pytest.approx(0.011 * sequences.RATE_HZ, rel=0.02)
    assert last.tracks is not None
    assert len(last.tracks.current_px) == len(last.tracks.inlier) == len(last.tracks.height)


def test_the_same_picture_under_another_attitude_is_another_surface(
    slope: PlaneSequence, camera: CameraModel
):
    """The pictures of a slope of 15 degrees are those of level ground under a vehicle pitched down by as much."""
    pitched = [matrix_from_euler(0, math.radians(-15), 0.3)] * len(slope.images)
    last = sequences.estimates(slope.images, camera, attitudes=pitched)[-1]
    assert last.slope_y_deg == pytest.approx(slope.slope_deg[1], abs=0.5)
    assert last.inclination_deg == pytest.approx(0, abs=0.6)
    assert last.pitch_deg == pytest.approx(-15)
    assert last.surface_pitch_deg == pytest.approx(0, abs=0.6)
    assert last.flat, last.against_flat


def test_the_mount_is_taken_out(slope: PlaneSequence, camera: CameraModel):
    """A camera that leans back by 15 degrees on a level vehicle sees level ground as that slope."""
    mounted = CameraModel(
        camera.width, camera.height, camera.matrix, None, body_from_camera(0, math.radians(-15), 0)
    )
    last = sequences.estimates(slope.images, mounted)[-1]
    assert last.inclination_deg == pytest.approx(0, abs=0.6)


def test_without_the_attitude_used_the_camera_stands_for_level(slope: PlaneSequence, camera: CameraModel):
    options = Options(estimator=dataclasses.replace(EstimatorOptions(), use_attitude=False))
    pitched = [matrix_from_euler(0, math.radians(-15), 0.0)] * len(slope.images)
    last = sequences.estimates(slope.images, camera, options, pitched)[-1]
    assert last.inclination_deg == pytest.approx(15, abs=0.6)
    assert last.surface_pitch_deg == pytest.approx(15, abs=0.6)


def test_without_attitude_there_is_a_slope_in_the_camera_frame_only(
    slope: PlaneSequence, camera: CameraModel
):
    found = sequences.estimates(slope.images, camera, attitudes=[None] * len(slope.images))
    for e in found:
        assert math.isnan(e.inclination_deg)
        assert math.isnan(e.surface_pitch_deg)
        assert math.isnan(e.roll_deg)
        assert not e.flat


@pytest.mark.parametrize("method", ["map", "quadratic"])
def test_the_same_input_gives_the_same_output_twice(method: str, slope: PlaneSequence, camera: CameraModel):
    options = Options(estimator=dataclasses.replace(EstimatorOptions(), method=method))
    first = sequences.estimates(slope.images, camera, options)
    again = sequences.estimates(slope.images.copy(), camera, options)
    assert [repr(e) for e in first] == [repr(e) for e in again]
    assert {e.method for e in first} == {method}
    assert first[-1].status == "ok"


def test_a_camera_that_stands_still_knows_no_slope(slope: PlaneSequence, camera: CameraModel):
    rng = np.random.default_rng(1)
    still = [
        np.clip(np.rint(slope.images[0] + rng.normal(0, 2, slope.images[0].shape)), 0, 255).astype(np.uint8)
        for _ in range(20)
    ]
    for e in sequences.estimates(still, camera):
        assert e.status in ("starting", "motion_too_small", "slope_uncertain")
        assert not e.flat
        assert all(math.isnan(getattr(e, name)) for name in MOVING)


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_darkness_and_glare_have_a_reason_and_end(grey: int, slope: PlaneSequence, camera: CameraModel):
    plain = np.full(slope.images[0].shape, grey, np.uint8)
    images = [plain, plain, plain, *slope.images[:12], plain, plain, *slope.images[12:]]
    found = sequences.estimates(images, camera)
    for k in (0, 1, 2, 15, 16):
        assert found[k].status != "ok"
        assert math.isnan(found[k].slope_x_deg)
        assert not found[k].flat
    assert found[14].status == "ok"
    assert found[-1].status == "ok"
    assert found[-1].inclination_deg == pytest.approx(15, abs=1)


def test_noise_is_not_ground(camera: CameraModel):
    rng = np.random.default_rng(2)
    images = [rng.integers(0, 256, (camera.height, camera.width)).astype(np.uint8) for _ in range(12)]
    for e in sequences.estimates(images, camera):
        assert not e.flat
        assert e.status != "ok"


def test_another_size_and_a_time_that_falls_are_refused(camera: CameraModel):
    pipeline = SurfacePipeline(camera, Options())
    small = np.zeros((120, 160), np.uint8)
    with pytest.raises(LandingError, match="frame 3 is 160 x 120, the calibration is for 256 x 256"):
        pipeline.step(Observation(3, 0.0, small))
    image = np.zeros((256, 256), np.uint8)
    pipeline.step(Observation(0, 1.0, image))
    for time_s in (1.0, 0.5, math.nan):
        with pytest.raises(LandingError, match=r"not after 1\.0"):
            pipeline.step(Observation(1, time_s, image))


def test_height_comes_from_the_velocity(slope: PlaneSequence, camera: CameraModel):
    pipeline = SurfacePipeline(camera, Options())
    e = None
    for k, image in enumerate(slope.images):
        # 0.011 of the height in a frame, to the east
        velocity = np.array((0.0, 0.011 * slope.distance[k] * sequences.RATE_HZ, 0.0))
        e = pipeline.step(
            Observation(k, k / sequences.RATE_HZ, image, np.eye(3), 1e-5, velocity, velocity_std=0.02)
        )
    assert e is not None
    assert e.height_m == pytest.approx(slope.distance[-1], rel=0.03)
    assert abs(e.height_m - slope.distance[-1]) < 3 * e.height_std_m


def test_doubt_about_the_tilt_is_in_the_inclination(slope: PlaneSequence, camera: CameraModel):
    pipeline = SurfacePipeline(camera, Options())
    for k, image in enumerate(slope.images):
        estimate = pipeline.step(
            Observation(k, k / sequences.RATE_HZ, image, np.eye(3), 1e-5, tilt_std_rad=0.02 * (k % 2))
        )
        if k >= sequences.WARM_UP:
            assert (estimate.inclination_std_deg > np.degrees(0.019)) == (k % 2 == 1)
