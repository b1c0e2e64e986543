"""From the plane in the camera frame to the surface in the world: frames, signs, uncertainty."""

import math

import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from landing.plane.surface import slopes_in_body, surface, surface_in_ned
from landing.rotations import euler_from_matrix, matrix_from_euler
from landing.vision.camera import DOWN, body_from_camera

NO_ERROR = np.zeros((2, 2))
angle = st.floats(-0.5, 0.5)
heading = st.floats(-3.1, 3.1)


def ground(uphill_deg: float, inclination_deg: float) -> np.ndarray:
    """Normal (3,) in NED, pointing down, of ground that rises towards a bearing."""
    rise, bearing = math.tan(math.radians(inclination_deg)), math.radians(uphill_deg)
    return np.array((rise * math.cos(bearing), rise * math.sin(bearing), 1.0))


def seen(normal_ned: np.ndarray, ned_from_camera: np.ndarray) -> tuple[float, float]:
    """Slope tangents (a, b) that a camera sees of it."""
    n = ned_from_camera.T @ normal_ned
    return -n[0] / n[2], -n[1] / n[2]


def below(normal_ned: np.ndarray, ned_from_body: np.ndarray, mount: np.ndarray = DOWN):
    ned_from_camera = ned_from_body @ mount
    a, b = seen(normal_ned, ned_from_camera)
    roll, pitch, _ = euler_from_matrix(ned_from_body)
    return surface(a, b, NO_ERROR, ned_from_camera, mount, roll, pitch, 0.0)


@examples(60)
@given(angle, angle, heading)
def test_level_ground_is_level_from_any_attitude(roll: float, pitch: float, yaw: float):
    found = below(ground(0, 0), matrix_from_euler(roll, pitch, yaw))
    assert found.inclination_deg == pytest.approx(0, abs=1e-5)


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5])
def test_level_ground_under_a_pitched_or_rolled_vehicle(yaw: float):
    nose_up = matrix_from_euler(0, math.radians(10), yaw)
    a, b = seen(ground(0, 0), nose_up @ DOWN)
    assert (math.degrees(math.atan(a)), math.degrees(math.atan(b))) == pytest.approx((0, -10))
    right_down = matrix_from_euler(math.radians(10), 0, yaw)
    a, b = seen(ground(0, 0), right_down @ DOWN)
    assert (math.degrees(math.atan(a)), math.degrees(math.atan(b))) == pytest.approx((-10, 0))
    for attitude in (nose_up, right_down):
        found = below(ground(0, 0), attitude)
        assert (found.pitch_deg, found.roll_deg) == pytest.approx((0, 0), abs=1e-9)


@examples(60)
@given(angle, angle, heading, st.floats(0, 359), st.floats(1, 50))
def test_inclination_and_bearing_do_not_depend_on_the_vehicle(roll, pitch, yaw, uphill_deg, inclination_deg):
    attitude = matrix_from_euler(roll, pitch, yaw)
    normal = ground(uphill_deg, inclination_deg)
    if (attitude.T @ normal)[2] < 0.2:
        return
    found = below(normal, attitude)
    assert found.inclination_deg == pytest.approx(inclination_deg, abs=1e-6)
    off = (found.bearing_deg - uphill_deg) % 360
    assert off == pytest.approx(180, abs=1e-5)


def test_ground_that_rises_to_the_north_falls_to_the_south():
    found = below(ground(0, 15), np.eye(3))
    assert found.bearing_deg == pytest.approx(180)
    assert found.pitch_deg == pytest.approx(15), "ground that rises ahead has a positive pitch"
    assert found.roll_deg == pytest.approx(0)


def test_ground_that_rises_to_the_west_falls_to_the_right_of_a_vehicle_heading_north():
    found = below(ground(270, 15), np.eye(3))
    assert found.bearing_deg == pytest.approx(90)
    assert found.roll_deg == pytest.approx(15)
    assert found.pitch_deg == pytest.approx(0)
    turned = below(ground(270, 15), matrix_from_euler(0, 0, math.radians(270)))
    assert (turned.pitch_deg, turned.roll_deg) == pytest.approx((15, 0))


@pytest.mark.parametrize("mount_deg", [(0, 12, 0), (-8, 0, 0), (0, 0, 90), (5, -10, 30)])
def test_a_tilted_mount_is_taken_out(mount_deg: tuple[float, ...]):
    mount = body_from_camera(*np.radians(mount_deg))
    attitude = matrix_from_euler(0.05, -0.1, 0.7)
    found = below(ground(120, 20), attitude, mount)
    straight = below(ground(120, 20), attitude)
    assert found.inclination_deg == pytest.approx(20)
    assert found.bearing_deg == pytest.approx(300)
    assert found.pitch_deg == pytest.approx(straight.pitch_deg)
    assert found.roll_deg == pytest.approx(straight.roll_deg)


def test_slopes_in_the_body_have_the_depth_growing_ahead():
    along_x, along_y = slopes_in_body(0.2, -0.3, DOWN)
    assert (math.tan(along_x), math.tan(along_y)) == pytest.approx((0.3, 0.2))


@pytest.mark.parametrize("inclination_deg", [0.0, 2.0, 15.0, 40.0])
def test_the_stated_deviation_is_the_error_that_comes(inclination_deg: float):
    rng = np.random.default_rng(3)
    attitude = matrix_from_euler(0.05, -0.1, 0.7) @ DOWN
    a, b = seen(ground(30, inclination_deg), attitude)
    covariance = np.array(((3e-4, 1e-4), (1e-4, 2e-4)))
    errors, stated = [], []
    for da, db in rng.multivariate_normal((0, 0), covariance, 3000):
        found, std, _ = surface_in_ned(a + da, b + db, covariance, attitude, 0.0)
        errors.append(found - inclination_deg)
        stated.append(std)
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(np.sqrt(np.mean(np.square(stated))), rel=0.15)


def test_the_attitude_adds_to_the_deviation():
    _, without, _ = surface_in_ned(0.2, 0.0, np.eye(2) * 1e-4, DOWN, 0.0)
    _, with_, _ = surface_in_ned(0.2, 0.0, np.eye(2) * 1e-4, DOWN, math.radians(1))
    assert with_ > math.hypot(without, 0.99)


def test_without_attitude_all_is_unknown():
    found = surface(0.1, 0.1, NO_ERROR, None, DOWN, 0.0, 0.0, 0.0)
    assert math.isnan(found.inclination_deg)
    assert math.isnan(found.bearing_deg)
    assert math.isnan(found.pitch_deg)
    assert math.isnan(found.roll_deg)
