"""Attitude between messages: interpolation, the gyro in the gaps, reasons instead of extrapolation."""

import math

import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from companion.core.attitude import AttitudeBuffer, BodyAttitude
from companion.settings.settings import SyncSettings
from drivers.samples import Attitude
from landing.rotations import euler_from_matrix, exp_so3, log_so3, matrix_from_euler

NO_DELAY = SyncSettings(gyro_delay_s=0.0)


def swinging(t):
    """Attitude (roll, pitch, yaw) of a vehicle that swings at time t in seconds, up to 1.4 rad/s."""
    return 0.35 * math.sin(3.0 * t), 0.3 * math.sin(4.0 * t + 1), 0.5 * math.sin(1.0 * t + 2)


def rotation(t):
    return matrix_from_euler(*swinging(t))


def body_rate(t, step=1e-5):
    """Turn rate (3,) body FRD at time t."""
    return log_so3(rotation(t - step / 2).T @ rotation(t + step / 2)) / step


def filled(settings, attitude_hz, gyro_hz, seconds=2.0, bias=(0.0, 0.0, 0.0)):
    buffer = AttitudeBuffer(settings)
    times = [(k / attitude_hz, "attitude") for k in range(round(seconds * attitude_hz) + 1)]
    if gyro_hz:
        times += [(k / gyro_hz + 0.001, "gyro") for k in range(round(seconds * gyro_hz) + 1)]
    for t, kind in sorted(times):
        us = round(t * 1e6)
        if kind == "attitude":
            buffer.add_attitude(us, Attitude(us, us, *swinging(t), *body_rate(t)))
        else:
            buffer.add_rate(us, tuple(body_rate(t) + bias))
    return buffer


def errors(buffer, seconds=2.0, count=150):
    """Angles between estimate and truth in rad, at times spread over the flight."""
    found = []
    for k in range(count):
        us = round((0.2 + (seconds - 0.4) * k / count) * 1e6)
        estimate = buffer.at(us)
        assert isinstance(estimate, BodyAttitude)
        found.append(np.linalg.norm(log_so3(estimate.ned_from_body.T @ rotation(us * 1e-6))))
    return np.array(found)


def test_a_hundred_hertz_needs_no_gyro():
    assert errors(filled(NO_DELAY, 100, 0)).max() < 2e-4


def test_gyro_makes_ten_hertz_nearly_as_good_as_a_hundred():
    alone = errors(filled(NO_DELAY, 10, 0))
    helped = errors(filled(NO_DELAY, 10, 50))
    assert helped.max() < 1e-3
    assert helped.max() < alone.max() / 8


def test_the_closing_takes_a_gyro_bias_out():
    clean = errors(filled(NO_DELAY, 10, 100)).max()
    biased = errors(filled(NO_DELAY, 10, 100, bias=(0.05, -0.05, 0.03))).max()
    assert biased < clean + 2e-4


def test_the_gyros_delay_is_taken_out():
    late = 0.008
    buffer = AttitudeBuffer(SyncSettings(gyro_delay_s=late))
    wrong = AttitudeBuffer(NO_DELAY)
    for k in range(201):
        t = k / 100
        us = round(t * 1e6)
        for b in (buffer, wrong):
            if k % 10 == 0:
                b.add_attitude(us, Attitude(us, us, *swinging(t), *body_rate(t)))
            b.add_rate(us, tuple(body_rate(t - late)))
    assert errors(buffer).max() < errors(wrong).max() / 2


@given(st.floats(0, 1.99), st.sampled_from([10.0, 25.0, 100.0]), st.sampled_from([0.0, 50.0, 100.0]))
@examples(60)
def test_what_comes_out_is_a_rotation(t, attitude_hz, gyro_hz):
    estimate = filled(NO_DELAY, attitude_hz, gyro_hz).at(round(t * 1e6))
    assert isinstance(estimate, BodyAttitude)
    r = estimate.ned_from_body
    assert np.allclose(r @ r.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(r) == pytest.approx(1)
    assert 1e-4 < estimate.rotation_std < 0.02


def test_at_a_sample_it_is_the_sample():
    estimate = filled(NO_DELAY, 10, 50).at(700_000)
    assert isinstance(estimate, BodyAttitude)
    assert euler_from_matrix(estimate.ned_from_body) == pytest.approx(swinging(0.7))


def test_it_never_extrapolates():
    buffer = AttitudeBuffer(NO_DELAY)
    assert buffer.at(0) == "no_attitude"
    for k in range(10):
        buffer.add_attitude(1_000_000 + 10_000 * k, Attitude(0, 0, 0, 0, 0))
    assert buffer.at(999_999) == "attitude_too_late"
    assert buffer.at(1_090_001) == "attitude_not_yet"
    assert isinstance(buffer.at(1_090_000), BodyAttitude)


def test_a_gap_that_is_too_wide_is_a_reason():
    buffer = AttitudeBuffer(SyncSettings(attitude_max_gap_s=0.1))
    for us in (0, 100_000, 200_001):
        buffer.add_attitude(us, Attitude(us, us, 0, 0, 0))
    assert isinstance(buffer.at(50_000), BodyAttitude)
    assert buffer.at(150_000) == "attitude_gap"


def test_gyro_samples_that_leave_a_hole_are_not_integrated():
    """Between 0.1 and 0.2 s the gyro is silent: there the attitudes alone speak, and the doubt grows."""
    buffer, full = AttitudeBuffer(NO_DELAY), AttitudeBuffer(NO_DELAY)
    for k in range(41):
        t = k / 100
        us = round(t * 1e6)
        for b in (buffer, full):
            if k % 10 == 0:
                b.add_attitude(us, Attitude(us, us, *swinging(t), *body_rate(t)))
            if b is full or not 10 < k < 20:
                b.add_rate(us + 100, tuple(body_rate(t)))
    holed, whole = buffer.at(150_000), full.at(150_000)
    assert isinstance(holed, BodyAttitude)
    assert isinstance(whole, BodyAttitude)
    assert holed.rotation_std > 2 * whole.rotation_std


def test_samples_out_of_order_are_reported():
    buffer = AttitudeBuffer(NO_DELAY)
    assert buffer.add_attitude(1000, Attitude(0, 0, 0, 0, 0))
    assert not buffer.add_attitude(1000, Attitude(0, 0, 0, 0, 0))
    assert buffer.add_rate(1000, (0.0, 0.0, 0.0))
    assert not buffer.add_rate(900, (0.0, 0.0, 0.0))


def test_turning_through_north_goes_the_short_way():
    buffer = AttitudeBuffer(NO_DELAY)
    buffer.add_attitude(0, Attitude(0, 0, 0, 0, math.pi - 0.01))
    buffer.add_attitude(10_000, Attitude(0, 0, 0, 0, -math.pi + 0.01))
    estimate = buffer.at(5_000)
    assert isinstance(estimate, BodyAttitude)
    assert abs(euler_from_matrix(estimate.ned_from_body)[2]) == pytest.approx(math.pi)


def test_memory_stays_bounded_over_a_long_flight():
    buffer = AttitudeBuffer(NO_DELAY)
    for k in range(60_000):
        buffer.add_attitude(10_000 * k, Attitude(0, 0, 0, 0, 0))
        buffer.add_rate(10_000 * k, (0.0, 0.0, 0.0))
    assert len(buffer._times) < 1000
    assert len(buffer._gyro_times) < 1000
    assert buffer.at(10_000 * 50_000) == "attitude_too_late"


def test_clearing_forgets_everything():
    buffer = filled(NO_DELAY, 100, 100)
    buffer.clear()
    assert buffer.newest_us is None
    assert buffer.at(1_000_000) == "no_attitude"


def test_doubt_grows_with_swing_jitter_and_gap():
    calm = AttitudeBuffer(NO_DELAY)
    for k in range(200):
        calm.add_attitude(10_000 * k, Attitude(0, 0, 0, 0, 0))
    swung = filled(NO_DELAY, 100, 0)
    sparse = filled(NO_DELAY, 10, 0)
    std = [b.at(1_505_000, 0.001).rotation_std for b in (calm, swung, sparse)]
    assert std[0] == pytest.approx(NO_DELAY.attitude_noise_rad)
    assert std[0] < std[1] < std[2]
    assert swung.at(1_505_000, 0.004).rotation_std > 2 * swung.at(1_505_000, 0.0).rotation_std


def test_a_turn_makes_the_tilt_as_doubtful_as_its_moment():
    """Rolling by 0.4 rad/s, ten milliseconds are 4 mrad, shared by two axes; turning about the vertical is no tilt."""
    rolling, yawing = AttitudeBuffer(SyncSettings(attitude_delay_std_s=0.01)), AttitudeBuffer(SyncSettings())
    for k in range(400):
        t = k / 100
        rolling.add_attitude(10_000 * k, Attitude(0, 0, 0.4 * t, 0, 0, 0.4))
        yawing.add_attitude(10_000 * k, Attitude(0, 0, 0, 0, 0.4 * t, 0, 0, 0.4))
    assert rolling.at(3_005_000).tilt_std == pytest.approx(0.004 / math.sqrt(2), rel=1e-3)
    assert rolling.at(3_005_000, 0.01).tilt_std == pytest.approx(0.004, rel=1e-3)
    assert yawing.at(3_005_000).tilt_std == 0


def test_doubt_covers_the_error_without_a_gyro():
    buffer = filled(NO_DELAY, 10, 0)
    ratio = [
        np.linalg.norm(log_so3(estimate.ned_from_body.T @ rotation(us * 1e-6))) / estimate.rotation_std
        for us in range(300_000, 1_700_000, 13_000)
        if isinstance(estimate := buffer.at(us), BodyAttitude)
    ]
    assert np.quantile(ratio, 0.95) < 2


def test_exact_turn_at_constant_rate():
    """A constant turn is interpolated exactly, however wide the gap."""
    axis = np.array((0.3, -0.5, 0.8))
    buffer = AttitudeBuffer(NO_DELAY)
    for us in (0, 200_000):
        angles = euler_from_matrix(exp_so3(axis * us * 1e-6))
        buffer.add_attitude(us, Attitude(us, us, *angles, *axis))
    estimate = buffer.at(70_000)
    assert isinstance(estimate, BodyAttitude)
    assert np.allclose(estimate.ned_from_body, exp_so3(axis * 0.07), atol=1e-9)


@given(st.floats(0.05, 1.95), st.tuples(*[st.floats(-20, 20)] * 3))
def test_a_force_is_turned_into_the_worlds_axes(t: float, force):
    found = filled(NO_DELAY, 100, 0).to_ned(round(t * 1e6), force)
    assert found is not None
    np.testing.assert_allclose(found, rotation(t) @ force, atol=0.02)


def test_a_force_turns_through_north_the_short_way_and_has_no_attitude_before_the_first():
    buffer = AttitudeBuffer(NO_DELAY)
    assert buffer.to_ned(0, (1.0, 0.0, 0.0)) is None
    buffer.add_attitude(0, Attitude(0, 0, 0, 0, math.pi - 0.1))
    buffer.add_attitude(10_000, Attitude(0, 0, 0, 0, 0.1 - math.pi))
    assert buffer.to_ned(-1, (1.0, 0.0, 0.0)) is None
    assert buffer.to_ned(5_000, (1.0, 0.0, 0.0)) == pytest.approx((-1.0, 0.0, 0.0))
    # behind the newest it is the newest's
    assert buffer.to_ned(90_000, (1.0, 0.0, 0.0)) == pytest.approx((-math.cos(0.1), -math.sin(0.1), 0.0))


def filtered(delay_s, seconds=6.0, hz=100):
    """Attitudes whose angles are in time and whose rates are late, as behind an autopilot's low-pass filter."""
    buffer = AttitudeBuffer(NO_DELAY)
    for k in range(round(seconds * hz) + 1):
        us = round(k / hz * 1e6)
        buffer.add_attitude(us, Attitude(us, us, *swinging(k / hz), *body_rate(k / hz - delay_s)))
    return buffer


@pytest.mark.parametrize("delay_s", [0.0, 0.006, 0.011, 0.02])
def test_the_delay_of_the_rates_is_measured_and_taken_out(delay_s):
    buffer, off, left = filtered(delay_s), [], []
    for k in range(150):
        t = 0.2 + k / 30
        estimate = buffer.at(round(t * 1e6))
        assert isinstance(estimate, BodyAttitude)
        off.append(np.linalg.norm(body_rate(t - delay_s) - body_rate(t)))
        left.append(np.linalg.norm(estimate.turn_rate - body_rate(t)))
    assert buffer._delay.s == pytest.approx(delay_s, abs=0.001)
    assert np.median(left[30:]) < 0.02 + 0.1 * np.median(off)


def test_the_rate_between_attitudes_far_apart_is_the_gyros_without_its_bias():
    buffer = filled(NO_DELAY, 10, 200, bias=(0.05, -0.04, 0.03))
    left = []
    for k in range(60):
        t = 0.3 + k / 45
        estimate = buffer.at(round(t * 1e6))
        assert isinstance(estimate, BodyAttitude)
        left.append(np.linalg.norm(estimate.turn_rate - body_rate(t)))
    assert max(left) < 0.03
