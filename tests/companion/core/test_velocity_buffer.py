"""The velocity at an exposure: messages, and the accelerometer between them."""

import math
from functools import lru_cache

import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from companion.core.attitude import AttitudeBuffer
from companion.core.velocity import AGE_US, KEPT, VelocityBuffer
from companion.settings.settings import SyncSettings
from drivers.samples import GRAVITY, Attitude
from landing.rotations import matrix_from_euler

SYNC = SyncSettings()
LEVEL = (0.0, 0.0, 0.0)
LEANING = (0.1, -0.2, 2.0)


def jolted(t):
    """Velocity (3,) NED of a vehicle in gusts."""
    return np.array((0.3 * math.sin(2 * t), 0.05 * math.sin(15 * t), 0.04 * math.sin(20 * t)))


def acceleration(t, step=1e-4):
    return (jolted(t + step / 2) - jolted(t - step / 2)) / step


@lru_cache
def filtered(cutoff_hz, seconds=20.0, rate_hz=2000.0):
    """Accelerations (n, 3) behind the autopilot's low-pass filter, Butterworth's of second order; 0: none."""
    felt = np.array([acceleration(k / rate_hz) for k in range(round(seconds * rate_hz))])
    if not cutoff_hz:
        return felt
    w = math.tan(math.pi * cutoff_hz / rate_hz)
    scale = 1 / (1 + math.sqrt(2) * w + w * w)
    a1, a2 = 2 * (w * w - 1) * scale, (1 - math.sqrt(2) * w + w * w) * scale
    out = np.zeros_like(felt)
    out[:2] = felt[:2]
    for k in range(2, len(felt)):
        out[k] = w * w * scale * (felt[k] + 2 * felt[k - 1] + felt[k - 2]) - a1 * out[k - 1] - a2 * out[k - 2]
    return out


def delay_of(cutoff_hz):
    return math.sqrt(2) / (2 * math.pi * cutoff_hz) if cutoff_hz else 0.0


def flown(
    seconds=8.0,
    cutoff_hz=20.0,
    messages_hz=30.0,
    forces_hz=100.0,
    noise=(0.0, 0.0),
    bias=0.0,
    attitude=LEANING,
    velocity=jolted,
    settings=SYNC,
):
    """A buffer after a flight; ``noise`` of velocities (m/s) and forces (m/s^2), ``bias`` (m/s^2) of the forces."""
    rng = np.random.default_rng(1)
    attitudes = AttitudeBuffer(settings)
    buffer = VelocityBuffer(settings, attitudes)
    body_from_ned = matrix_from_euler(*attitude).T
    due = [(k / messages_hz, "velocity") for k in range(round(seconds * messages_hz))]
    if forces_hz:
        due += [(k / forces_hz + 0.003, "force") for k in range(round(seconds * forces_hz))]
    for t, kind in sorted(due):
        us = round(t * 1e6)
        attitudes.add_attitude(us, Attitude(us, us, *attitude))
        if kind == "velocity":
            buffer.add_velocity(us, tuple(velocity(t) + noise[0] * rng.normal(size=3)))
        else:
            felt = filtered(cutoff_hz)[round(max(0.0, t - 0.001) * 2000.0)]
            force = body_from_ned @ (felt - (0.0, 0.0, GRAVITY))
            buffer.add_force(us, tuple(force + bias + noise[1] * rng.normal(size=3)))
    return buffer


def errors(buffer, start=7.6, end=7.95):
    times = np.linspace(start, end, 60)
    return np.array([buffer.at(round(t * 1e6))[0] - jolted(t) for t in times])


def test_between_messages_the_accelerometer_carries_on():
    carried, straight = flown(messages_hz=15.0), flown(messages_hz=15.0, forces_hz=0)
    assert carried.carried
    assert not straight.carried
    assert np.abs(errors(carried)).max() < 1.5e-3
    assert np.abs(errors(straight)).max() > 5e-3
    # what it says of its own noise is about that
    assert carried.at(7_900_000)[2] < 0.3 * straight.at(7_900_000)[2]


@pytest.mark.parametrize("cutoff_hz", [0.0, 30.0, 20.0, 10.0])
def test_the_delay_of_the_filter_is_found(cutoff_hz: float):
    buffer = flown(cutoff_hz=cutoff_hz, noise=(0.002, 0.05))
    assert buffer.delay_s == pytest.approx(delay_of(cutoff_hz), abs=1.5e-3)


def test_the_filter_is_undone():
    """At 3 Hz a filter of 10 Hz cuts a tenth off and turns the rest by a quarter of a period: 4 cm/s."""
    buffer = flown(cutoff_hz=10.0)
    assert np.abs(errors(buffer)).max() < 3e-3


@pytest.mark.parametrize("attitude", [LEVEL, LEANING, (0.0, 0.0, math.pi)])
def test_a_bias_of_the_accelerometer_is_taken_out(attitude):
    assert np.abs(errors(flown(bias=0.15, attitude=attitude))).max() < 3e-3


def test_a_span_of_nothing_turns_it_off():
    off = flown(settings=SyncSettings(velocity_span_s=0.0))
    np.testing.assert_array_equal(errors(off), errors(flown(forces_hz=0)))


def test_noise_of_the_messages_is_averaged():
    buffer = flown(noise=(0.03, 0.0))
    assert buffer.carried
    found = errors(buffer)
    assert np.sqrt((found**2).mean()) < 0.6 * 0.03


def test_an_accelerometer_that_shakes_is_not_listened_to():
    """Vibration that the filter lets through: 3 m/s^2 makes 3 cm/s within a tenth of a second."""
    shaken = flown(noise=(0.0, 3.0))
    assert not shaken.carried
    np.testing.assert_array_equal(errors(shaken), errors(flown(forces_hz=0)))


def test_rare_messages_are_enough():
    """At 8 Hz a straight line knows nothing of what happens between."""
    buffer = flown(messages_hz=8.0)
    assert np.abs(errors(buffer)).max() < 6e-3
    assert buffer.at(7_930_000)[1] == 0.0
    assert flown(messages_hz=8.0, forces_hz=0).at(7_940_000)[1] > 0.05


def test_a_reset_of_the_autopilots_filter_is_not_spread_out():
    """The velocity steps by half a metre a second: before it the old one, after it the new one."""
    buffer = flown(velocity=lambda t: jolted(t) + (0.5 if t > 7.7 else 0.0))
    assert np.abs(errors(buffer, 7.75, 7.95) - 0.5).max() < 5e-3


def test_what_tells_of_an_exposure_is_waited_for_only_where_it_counts_and_comes():
    buffer = flown()
    last_us = 7_993_000
    assert buffer.complete(last_us - AGE_US)
    assert not buffer.complete(last_us - AGE_US + 1)
    assert flown(forces_hz=0).complete(last_us)
    # the attitudes go on and the accelerometer does not
    buffer._attitudes.add_attitude(8_050_000, Attitude(0, 0, *LEANING))
    assert buffer.complete(8_040_000)


def test_out_of_order_is_refused_and_a_reboot_forgets():
    buffer = flown(1.0)
    assert not buffer.add_velocity(900_000, LEVEL)
    assert not buffer.add_force(900_000, LEVEL)
    assert buffer.at(500_000) is not None
    buffer.clear()
    assert buffer.at(500_000) is None
    assert not buffer.carried
    assert buffer.add_velocity(1000, LEVEL)


def test_a_shaking_accelerometer_does_not_void_messages():
    """What it says of a step counts only where it tells the messages better than a line."""
    shaken = flown(noise=(0.0, 12.0), messages_hz=4.0)
    assert not shaken.carried
    assert len(shaken._samples) == 32


def test_a_force_without_an_attitude_tells_nothing():
    buffer = VelocityBuffer(SYNC, AttitudeBuffer(SYNC))
    assert buffer.add_force(1000, LEVEL)
    assert buffer.complete(1000)


def test_after_a_gap_the_accelerometer_begins_anew():
    """What was before the gap cannot be carried over it."""
    buffer = flown(noise=(1e-3, 0.0))
    body = matrix_from_euler(*LEANING).T @ (0.0, 0.0, -GRAVITY)
    buffer._attitudes.add_attitude(8_400_000, Attitude(0, 0, *LEANING))
    buffer.add_velocity(8_380_000, (1.0, 0.0, 0.0))
    for us in (8_385_000, 8_395_000):
        buffer.add_force(us, tuple(body))
    found = buffer.at(8_382_000)
    assert found is not None
    np.testing.assert_allclose(found[0], (1.0, 0.0, 0.0), atol=5e-3)


@examples(40)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(["velocity", "force", "attitude"]),
            st.integers(-20_000, 400_000),
            st.tuples(*[st.floats(-50, 50) | st.sampled_from([-3e38, 3e38])] * 3),
        ),
        max_size=80,
    )
)
def test_whatever_comes_the_answer_is_finite_or_none(samples):
    attitudes = AttitudeBuffer(SYNC)
    buffer = VelocityBuffer(SYNC, attitudes)
    now_us = 100_000
    for kind, step_us, values in samples:
        now_us += step_us
        if kind == "velocity":
            buffer.add_velocity(now_us, values)
        elif kind == "force":
            buffer.add_force(now_us, values)
        else:
            attitudes.add_attitude(
                now_us, Attitude(now_us, now_us, *(max(-1.0, min(1.0, v / 50)) for v in values))
            )
        found = buffer.at(now_us)
        if found is not None:
            assert np.isfinite(found[0]).all()
            assert 0 <= found[1] <= SYNC.velocity_max_age_s
            assert found[2] >= 0
        assert 0.0 <= buffer.delay_s <= 0.05


def test_memory_does_not_grow():
    buffer = flown(20.0)
    assert len(buffer._samples) <= KEPT
    assert len(buffer._times) <= KEPT
