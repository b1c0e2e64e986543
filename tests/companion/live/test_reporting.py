"""What ground stations see: pure, messages in, MAVLink messages out."""

import math

import numpy as np
import pytest

from companion.live.reporting import GroundReport
from companion.messages.messages import Estimate, estimate_message
from companion.settings.settings import MavlinkSettings
from drivers.samples import Imu
from landing.estimate import SurfaceEstimate
from landing.vision.camera import body_from_camera

DOWN = body_from_camera(0.0, 0.0, 0.0)


def report(**settings: object) -> GroundReport:
    return GroundReport(MavlinkSettings(**settings), DOWN)


def estimate(at_s: float = 0.0, **values: object) -> Estimate:
    values = {"status": "ok", "method": "map"} | values
    return estimate_message(SurfaceEstimate(1, at_s, **values), round(at_s * 1e6), 5.0, True)


def test_values_come_at_their_rate_and_unknown_ones_as_nan() -> None:
    ground = report(named_value_rate_hz=2.0)
    sent = [m for i in range(31) for m in ground.feed(estimate(i / 30, inclination_deg=3.0))]
    assert [m.name for m in sent[:3]] == ["ls_incl", "ls_ttc", "ls_rough"]
    assert len(sent) == 3 * 3
    assert sent[0].value == 3.0
    assert math.isnan(sent[1].value)
    assert report(named_value_rate_hz=0).feed(estimate()) == []


@pytest.mark.parametrize(
    ("velocity_body", "expected"),
    [((1.0, 0.0), (0.0, 0.5)), ((0.0, 1.0), (-0.5, 0.0))],  # forward: +y flow; right: -x flow
)
def test_optical_flow_has_mavlinks_signs_and_the_rotation_in_it(velocity_body, expected) -> None:
    ground = report(optical_flow=True, named_value_rate_hz=0.0)
    height = 2.0
    camera = DOWN.T @ np.array([*velocity_body, 0.0]) / height
    for rate in (0.1, 0.3):
        ground.gyro(Imu(0, 0, (rate, -rate, 9.0)))
    (flow,) = ground.feed(
        estimate(
            ventral_flow_x=camera[0],
            ventral_flow_y=camera[1],
            divergence=0.0,
            height_m=height,
            inlier_fraction=1.0,
        )
    )
    assert (flow.flow_rate_x, flow.flow_rate_y) == pytest.approx(
        (expected[0] + 0.2, expected[1] - 0.2), abs=1e-6
    )
    assert (flow.quality, flow.ground_distance) == (255, height)


def test_px4_gets_the_flow_integrated_since_the_last_estimate() -> None:
    ground = report(optical_flow=True, named_value_rate_hz=0.0)
    ground.autopilot = "px4"
    values = {"ventral_flow_x": 0.0, "ventral_flow_y": 0.5, "divergence": 0.0, "inlier_fraction": 1.0}
    assert ground.feed(estimate(1.0, **values)) == []
    ground.gyro(Imu(0, 0, (0.1, 0.2, 0.3)))
    (flow,) = ground.feed(estimate(1.1, **values))
    velocity = DOWN @ (0.0, 0.5, 0.0)
    assert flow.get_type() == "OPTICAL_FLOW_RAD"
    assert flow.integration_time_us == 100_000
    found = (flow.integrated_x, flow.integrated_y, flow.integrated_xgyro, flow.integrated_zgyro)
    assert found == pytest.approx((0.1 * (0.1 - velocity[1]), 0.1 * (0.2 + velocity[0]), 0.01, 0.03))
    assert flow.distance == -1.0
    assert ground.feed(estimate(2.0, **values)) == []
