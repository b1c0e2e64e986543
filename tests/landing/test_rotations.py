"""Rotations: aerospace angles, the exponential map, their inverses."""

import math

import cv2
import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from landing.rotations import euler_from_matrix, exp_so3, log_so3, matrix_from_euler, skew

half_turn = st.floats(-math.pi + 1e-6, math.pi - 1e-6)
quarter_turn = st.floats(-math.pi / 2 + 1e-4, math.pi / 2 - 1e-4)
component = st.floats(-1.7, 1.7)


@examples(100)
@given(half_turn, quarter_turn, half_turn)
def test_angles_come_back(roll: float, pitch: float, yaw: float):
    rotation = matrix_from_euler(roll, pitch, yaw)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1)
    np.testing.assert_allclose(euler_from_matrix(rotation), (roll, pitch, yaw), atol=1e-7)


def test_each_angle_turns_as_on_an_aircraft():
    quarter = math.pi / 2
    nose, right, down = np.eye(3)
    np.testing.assert_allclose(matrix_from_euler(0, 0, quarter) @ nose, (0, 1, 0), atol=1e-15)
    np.testing.assert_allclose(matrix_from_euler(0, quarter, 0) @ nose, (0, 0, -1), atol=1e-15)
    np.testing.assert_allclose(matrix_from_euler(quarter, 0, 0) @ right, (0, 0, 1), atol=1e-15)
    np.testing.assert_allclose(matrix_from_euler(quarter, 0, 0) @ down, (0, -1, 0), atol=1e-15)


@examples(100)
@given(component, component, component)
def test_rotation_vectors_come_back(x: float, y: float, z: float):
    vector = np.array((x, y, z))
    np.testing.assert_allclose(log_so3(exp_so3(vector)), vector, atol=1e-7)


@examples(50)
@given(component, component, component)
def test_the_exponential_is_rodrigues(x: float, y: float, z: float):
    vector = np.array((x, y, z))
    np.testing.assert_allclose(exp_so3(vector), cv2.Rodrigues(vector)[0], atol=1e-9)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, -1, 0), (0.6, 0, -0.8), (-0.48, 0.6, 0.64)])
def test_a_half_turn_is_found(axis: tuple[float, ...]):
    found = log_so3(exp_so3(np.array(axis) * math.pi))
    assert np.linalg.norm(found) == pytest.approx(math.pi)
    assert abs(found @ axis) == pytest.approx(math.pi, abs=1e-6)


def test_tiny_rotations_are_linear():
    vector = np.array((1e-9, -2e-9, 3e-9))
    np.testing.assert_allclose(exp_so3(vector), np.eye(3) + skew(vector), atol=1e-17)
    np.testing.assert_allclose(log_so3(exp_so3(vector)), vector, atol=1e-18)


def test_skew_is_the_cross_product():
    v, w = np.array((1.0, -2.0, 3.0)), np.array((0.5, 4.0, -1.0))
    np.testing.assert_allclose(skew(v) @ w, np.cross(v, w))
