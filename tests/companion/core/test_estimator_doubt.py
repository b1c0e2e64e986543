"""What the autopilot's estimator says of itself, on its way into the errors that an estimate is made with."""

import math
import queue

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as M

from companion.core.core import observation_of
from companion.core.estimator_doubt import (
    ASSUMED_VELOCITY_STD,
    LOST_TILT_STD,
    UNAIDED_TILT_STD,
    EstimatorDoubt,
)
from companion.core.sync import Synchroniser
from companion.settings.link_options import link_options
from companion.settings.settings import Settings
from companion.settings.settings_file import load
from drivers.mavlink.link import Link
from drivers.mavlink.telemetry import TelemetryDecoder
from drivers.samples import Attitude, EstimatorReport, Frame, Velocity
from drivers.simulated.vehicle.autopilot import SimulatedAutopilot
from drivers.simulated.vehicle.firmware import Firmware

NAN6 = [math.nan] * 21
GOOD = M.EKF_ATTITUDE | M.EKF_VELOCITY_HORIZ | M.EKF_VELOCITY_VERT | M.EKF_POS_HORIZ_ABS


def report(message):
    """The one sample of a message that came as bytes from vehicle 1."""
    codec = M.MAVLink(None, 1, 1)
    parsed = codec.parse_char(message.pack(codec))
    (sample,) = TelemetryDecoder().decode(parsed, 1_000_000)
    return sample


def ekf(flags, velocity=0.1):
    return report(M.MAVLink_ekf_status_report_message(flags, velocity, 0, 0, 0, 0))


def odometry(velocity_variance, tilt_variance):
    pose, speed = list(NAN6), list(NAN6)
    speed[0], speed[6], speed[11] = 0.0, velocity_variance, 0.0
    pose[15], pose[18] = 0.0, tilt_variance
    return report(
        M.MAVLink_odometry_message(0, 1, 12, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0, 0, 0, 0, pose, speed, 0, 1)
    )


def doubt_of(*reports, age_s=0.0):
    doubt = EstimatorDoubt()
    for r in reports:
        doubt.feed(r, 1_000_000)
    return doubt.at(1_000_000 + round(age_s * 1e6))


def test_flags_of_both_autopilots_say_whether_the_velocity_is_known():
    assert ekf(GOOD).velocity_known
    assert ekf(GOOD).attitude_known
    held = M.EKF_ATTITUDE | M.EKF_VELOCITY_VERT | M.EKF_CONST_POS_MODE
    assert ekf(held).velocity_known is False
    assert ekf(held).attitude_known
    assert ekf(GOOD & ~M.EKF_VELOCITY_VERT).velocity_known is False
    assert ekf(GOOD | M.EKF_CONST_POS_MODE).velocity_known is False
    for rejected in (0.9, math.nan):
        assert ekf(GOOD, rejected).velocity_known is False
    px4 = report(M.MAVLink_estimator_status_message(0, GOOD, 0.2, 0, 0, 0, 0, 0, 0, 0))
    assert px4.velocity_known
    assert px4.attitude_known
    assert not report(M.MAVLink_estimator_status_message(0, 0, 0.2, 0, 0, 0, 0, 0, 0, 0)).attitude_known


@pytest.mark.parametrize("kind", ["ardupilot", "px4"])
def test_a_simulated_autopilot_without_gps_says_so_over_its_link(kind):
    with SimulatedAutopilot("tcp:127.0.0.1:0") as autopilot:
        autopilot.controller.firmware = Firmware(kind)
        settings = load(None, [f"mavlink.connection=tcp:127.0.0.1:{autopilot.port}"]).settings
        reports: queue.SimpleQueue[EstimatorReport] = queue.SimpleQueue()
        link = Link(
            link_options(settings),
            lambda samples: [reports.put(s) for s in samples if isinstance(s, EstimatorReport)],
        )
        link.start()
        try:
            while not reports.get(timeout=300).velocity_known:
                pass
            autopilot.controller.firmware.gps = False
            while reports.get(timeout=300).velocity_known is not False:
                pass
        finally:
            link.close()


def test_odometry_tells_standard_deviations_and_nan_tells_nothing():
    doubt = odometry(0.25, math.radians(0.5) ** 2)
    assert doubt.velocity_std == pytest.approx(0.5)
    assert doubt.tilt_std == pytest.approx(math.radians(0.5), rel=1e-5)
    assert doubt.velocity_known is None
    for nothing in (math.nan, -1.0, math.inf):
        assert (odometry(nothing, nothing).velocity_std, odometry(nothing, nothing).tilt_std) == (None, None)


def test_a_report_only_adds_doubt_and_one_that_stops_vouches_for_nothing():
    assert doubt_of() == doubt_of(ekf(GOOD)) == doubt_of(ekf(GOOD), odometry(0.0, 0.0))
    assert doubt_of(odometry(0.36, 0.0)).velocity_factor == pytest.approx(0.6 / ASSUMED_VELOCITY_STD)
    lost = doubt_of(ekf(GOOD & ~M.EKF_VELOCITY_HORIZ), odometry(0.0, 0.0))
    assert not lost.velocity_known
    assert lost.tilt_std == UNAIDED_TILT_STD
    assert doubt_of(ekf(M.EKF_VELOCITY_HORIZ | M.EKF_VELOCITY_VERT)).tilt_std == LOST_TILT_STD
    assert doubt_of(ekf(GOOD), age_s=5.0).velocity_known
    assert not doubt_of(ekf(GOOD), age_s=11.0).velocity_known


@pytest.mark.parametrize("known", [True, False])
def test_the_doubt_reaches_the_observation(known):
    sync = Synchroniser(Settings(), True)
    ready = []
    for k in range(400):
        us = 10_000 * k
        arrival = 1_000_000_000 + us
        samples = [Attitude(arrival, us + 1, 0.0, 0.0, 0.0), Velocity(arrival, us + 1, (0, 0, 0), (1, 0, 0))]
        if k % 50 == 0:
            samples.append(EstimatorReport(arrival, "EKF_STATUS_REPORT", known, True))
            samples.append(EstimatorReport(arrival, "ODOMETRY", velocity_std=0.5, tilt_std=0.003))
        if k % 10 == 0:
            samples.append(Frame(k, arrival, arrival, np.zeros((4, 4), np.uint8)))
        for sample in samples:
            ready += sync.feed(sample)[0]
    seen = observation_of(ready[-1])
    assert (seen.velocity_ned is not None) == known
    assert seen.velocity_factor == pytest.approx(2.5)
    assert seen.velocity_std == pytest.approx(0.5)
    assert seen.tilt_std_rad >= (0.003 if known else UNAIDED_TILT_STD)


def test_a_reboot_forgets_what_was_told():
    doubt = EstimatorDoubt()
    doubt.feed(ekf(0), 0)
    doubt.forget()
    assert doubt.at(0).velocity_known
