"""The simulated multirotor's dynamics and flight modes."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import DriverError
from drivers.samples import GRAVITY
from drivers.simulated.vehicle import quaternion
from drivers.simulated.vehicle.flight_controller import FlightController
from drivers.simulated.vehicle.vehicle import AttitudeCommand, Multirotor, Wind
from landing.rotations import matrix_from_euler

DT = 1 / 200


def hover(vehicle: Multirotor, height: float = 5.0, mode: str = "GUIDED") -> FlightController:
    """A controller of a vehicle that hangs in the air."""
    vehicle.place(0.0, 0.0, height=height)
    controller = FlightController(vehicle)
    controller.start_airborne(mode)
    return controller


def fly(controller: FlightController, seconds: float) -> None:
    """Let time pass."""
    for _ in range(round(seconds / DT)):
        controller.vehicle.step(DT, controller.step(DT))


@given(st.floats(-3, 3), st.floats(-1.5, 1.5), st.floats(-3, 3))
def test_quaternions_agree_with_rotation_matrices(roll: float, pitch: float, yaw: float) -> None:
    q = quaternion.from_euler(roll, pitch, yaw)
    matrix = matrix_from_euler(roll, pitch, yaw)
    np.testing.assert_allclose(quaternion.to_matrix(q), matrix, atol=1e-12)
    np.testing.assert_allclose(quaternion.rotate(q, (1.0, -2.0, 3.0)), matrix @ (1.0, -2.0, 3.0), atol=1e-12)
    np.testing.assert_allclose(quaternion.to_euler(q), (roll, pitch, yaw), atol=1e-6)


@given(st.floats(-8, 8), st.floats(-8, 8), st.floats(-3, 3))
def test_thrust_points_where_it_was_asked(north: float, east: float, yaw: float) -> None:
    wanted = np.array([north, east, -GRAVITY])
    q = quaternion.from_thrust_and_yaw(tuple(wanted), yaw)
    np.testing.assert_allclose(
        quaternion.rotate(q, (0.0, 0.0, -1.0)), wanted / np.linalg.norm(wanted), atol=1e-9
    )
    assert math.remainder(quaternion.to_euler(q)[2] - yaw, 2 * math.pi) == pytest.approx(0, abs=1e-9)


def test_free_fall_and_drag() -> None:
    vehicle = Multirotor(wind=Wind(4.0, 0.0))
    vehicle.place(0.0, 0.0, height=1000.0)
    vehicle.thrust = 0.0
    for _ in range(round(10 / DT)):
        vehicle.step(DT, AttitudeCommand())
    drag = vehicle.airframe.drag
    assert vehicle.velocity[2] == pytest.approx(GRAVITY / drag * (1 - math.exp(-drag * 10)), rel=0.01)
    assert vehicle.velocity[0] == pytest.approx(4.0 * (1 - math.exp(-drag * 10)), rel=0.01)


def test_it_holds_its_place_in_gusts_by_leaning_into_the_wind() -> None:
    controller = hover(Multirotor(wind=Wind(5.0, -3.0, 1.0, shake_std=0.05), seed=3))
    fly(controller, 15)
    vehicle = controller.vehicle
    assert math.hypot(vehicle.position[0], vehicle.position[1]) < 1.0
    assert vehicle.position[2] == pytest.approx(-5, abs=0.2)
    assert vehicle.euler[1] > 0.1  # nose up, against a wind that blows north
    assert vehicle.euler[0] > 0.05  # right side down, against a wind that blows west


def test_forward_flight_begins_by_pitching_down_and_ends_by_pitching_up() -> None:
    controller = hover(Multirotor())
    pitches = []
    controller.fly((2.0, 0.0, 0.0))
    for _ in range(200):
        fly(controller, DT)
        pitches.append(controller.vehicle.euler[1])
    assert min(pitches) < math.radians(-8)
    controller.fly((0.0, 0.0, 0.0))
    for _ in range(200):
        fly(controller, DT)
        pitches.append(controller.vehicle.euler[1])
    assert max(pitches) > math.radians(8)


def test_landing_on_a_slope_takes_its_tilt() -> None:
    controller = hover(Multirotor(ground=lambda north, east: 0.2 * north - 0.1 * east))
    controller.set_mode("LAND")
    fly(controller, 14)
    vehicle = controller.vehicle
    touch = vehicle.touch_downs[0]
    assert math.tan(touch.ground_tilt_rad) == pytest.approx(math.hypot(0.2, 0.1), rel=1e-6)
    assert 0.3 < touch.velocity[2] < 0.7
    up = quaternion.rotate(vehicle.attitude, (0.0, 0.0, -1.0))
    normal = np.array([-0.2, 0.1, -1.0]) / math.sqrt(1.05)
    np.testing.assert_allclose(up, normal, atol=1e-6)
    assert not controller.armed


def test_return_to_launch_comes_home() -> None:
    controller = hover(Multirotor())
    controller.go_to((20.0, -10.0, -5.0))
    fly(controller, 15)
    assert controller.vehicle.position[0] == pytest.approx(20, abs=0.3)
    controller.set_mode("RTL")
    fly(controller, 70)
    assert controller.vehicle.on_ground
    assert math.hypot(*controller.vehicle.position[:2]) < 1.2


def test_sticks_fly_loiter_and_brake_stops() -> None:
    controller = hover(Multirotor(), mode="LOITER")
    controller.pulse_us[1] = 1300  # nose down: forward
    controller.pulse_us[2] = 1500
    fly(controller, 4)
    assert controller.vehicle.velocity[0] == pytest.approx(2.5, abs=0.2)
    controller.set_mode("BRAKE")
    fly(controller, 4)
    assert math.hypot(*controller.vehicle.velocity) < 0.1


@pytest.mark.parametrize("mode", ["STABILIZE", "ALT_HOLD"])
def test_centred_sticks_hover(mode: str) -> None:
    controller = hover(Multirotor(), mode=mode)
    controller.pulse_us[2] = 1500
    fly(controller, 5)
    assert controller.vehicle.position[2] == pytest.approx(-5, abs=0.5)


def test_the_same_seed_flies_the_same_way() -> None:
    def path(seed: int) -> tuple[float, ...]:
        controller = hover(Multirotor(wind=Wind(3, 0, 1.5, shake_std=0.1), seed=seed))
        controller.fly((1.0, 1.0, 0.0))
        fly(controller, 5)
        return (*controller.vehicle.position, *controller.vehicle.attitude)

    assert path(1) == path(1)
    assert path(1) != path(2)


def test_wrong_starts_and_modes_are_refused() -> None:
    vehicle = Multirotor()
    with pytest.raises(DriverError, match="start higher"):
        vehicle.place(0, 0, height=0.05)
    with pytest.raises(DriverError, match="no mode 'SPORT'"):
        FlightController(vehicle).set_mode("SPORT")
