"""How far an attitude wanders: nothing where the rates explain the turns, what was put in where they do not."""

import math

import numpy as np
import pytest

from companion.clocks.attitude_wander import AttitudeWander
from companion.clocks.rate_delay import FIRST_S
from companion.core.attitude import AttitudeBuffer
from companion.settings.settings import SyncSettings
from drivers.samples import Attitude

STEP_US = 10_000
DELAY_S = 0.0116


def flown(seconds, yaw=lambda t: 0.0, rate_delay_s=0.0, step_us=STEP_US, wander=None):
    """Attitudes of a vehicle that rolls and turns; ``yaw``, ``wander``: what the estimator corrects, rad."""
    for k in range(round(seconds * 1e6 / step_us)):
        t, late = k * step_us * 1e-6, k * step_us * 1e-6 - rate_delay_s
        more = (0.0, 0.0) if wander is None else wander[k]
        yield Attitude(
            k * step_us,
            k * step_us,
            0.1 * math.sin(3 * t) + more[0],
            more[1],
            0.2 * t + yaw(t),
            0.3 * math.cos(3 * late),
            0.2 * math.sin(0.1 * math.sin(3 * late)),
            0.2 * math.cos(0.1 * math.sin(3 * late)),
        )


def fed(attitudes, delay_s=0.0):
    wander = AttitudeWander()
    for a in attitudes:
        wander.feed(a.boot_us, a, delay_s)
    return wander.std


def test_turns_that_the_rates_explain_are_none():
    assert fed(flown(5)).tolist() == [0.0, 0.0, 0.0]
    assert fed(flown(5, rate_delay_s=DELAY_S), DELAY_S).tolist() == [0.0, 0.0, 0.0]


def test_a_heading_that_converges_is_a_doubt_of_yaw_alone():
    # 10 degrees/s for a second, as PX4's heading was seen to turn after takeoff while its gyro did not
    std = fed(flown(3, yaw=lambda t: math.radians(10) * min(max(t - 1.5, 0), 1)))
    turned_in_a_second = math.radians(10)
    assert 0.15 * turned_in_a_second < std[2] < turned_in_a_second
    assert std[:2].max() < 0.3 * std[2]
    forgotten = fed(flown(20, yaw=lambda t: math.radians(10) * min(max(t - 1.5, 0), 1)))
    assert forgotten[2] < 0.1 * std[2]


@pytest.mark.parametrize("walk", [0.004, 0.008])
def test_a_random_walk_is_found_by_its_size(walk):
    steps = np.random.default_rng(1).normal(0, walk * math.sqrt(STEP_US * 1e-6), (3000, 2))
    std = fed(flown(30, wander=np.cumsum(steps, axis=0)))
    assert std[:2] == pytest.approx([walk, walk], rel=0.5)


def test_a_slow_stream_a_gap_and_what_is_no_number_say_nothing():
    assert fed(flown(5, yaw=lambda t: t, step_us=50_000)).tolist() == [0.0, 0.0, 0.0]
    halves = list(flown(5, yaw=lambda t: 1.0 if t > 2.5 else 0.0))
    assert fed([a for a in halves if not 2_300_000 < a.boot_us < 2_700_000]).tolist() == [0.0, 0.0, 0.0]
    broken = list(flown(3))
    broken[100] = Attitude(1_000_000, 1_000_000, math.nan, 0, 0, 0, 0, 0)
    assert np.isfinite(fed(broken)).all()


def test_the_buffer_says_it_with_the_attitude():
    calm, turning = AttitudeBuffer(SyncSettings()), AttitudeBuffer(SyncSettings())
    turned = flown(3, lambda t: 0.2 * max(t - 2, 0), FIRST_S)
    for buffer, attitudes in ((calm, flown(3, rate_delay_s=FIRST_S)), (turning, turned)):
        for a in attitudes:
            buffer.add_attitude(a.boot_us, a)
    assert calm.at(2_905_000).wander is None
    assert turning.at(2_905_000).wander[2] > 0.03
