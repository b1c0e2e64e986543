"""What ground stations see, and the watch over a landing: pure, messages in, MAVLink messages or words out."""

import math

import numpy as np
import pytest

from companion.core.landing_watch import LandingWatch
from companion.live.reporting import GroundReport
from companion.messages.conditions import Code, Condition, condition, state_of
from companion.messages.messages import Decision, Estimate, Event, Health, estimate_message
from companion.settings.settings import LandingSettings, MavlinkSettings
from drivers.samples import Imu
from landing.estimate import SurfaceEstimate
from landing.vision.camera import body_from_camera

DOWN = body_from_camera(0.0, 0.0, 0.0)


def report(**settings: object) -> GroundReport:
    return GroundReport(MavlinkSettings(**settings), DOWN)


def decision(verdict: str, *reasons: str, command: str = "none") -> Decision:
    return Decision(
        frame=1,
        time_unix_us=10**6,
        verdict=verdict,
        reasons=reasons,
        since_unix_us=0,
        permitted=True,
        withheld=(),
        requested=command != "none",
        command=command,
    )


def health(*conditions: Condition) -> Health:
    return Health(
        time_unix_us=0,
        state=state_of(conditions),
        problems=tuple(c.text for c in conditions),
        inputs={},
        counters={},
        clock_offset_s=None,
        clock_std_s=None,
        camera_late_s=None,
        camera_late_std_s=None,
        pipeline_ms=None,
        conditions=conditions,
    )


def estimate(at_s: float = 0.0, **values: object) -> Estimate:
    values = {"status": "ok", "method": "map"} | values
    return estimate_message(SurfaceEstimate(1, at_s, **values), round(at_s * 1e6), 5.0, True)


def texts(messages: list) -> list[str]:
    return [m.text for m in messages if m.get_type() == "STATUSTEXT"]


def said(ground: GroundReport, *messages: object) -> list[str]:
    return [text for message in messages for text in texts(ground.feed(message))]


def test_verdict_is_told_when_it_changes_and_only_then() -> None:
    told = said(
        report(),
        decision("unknown", "nothing seen yet"),
        decision("fit"),
        decision("fit"),
        decision("unfit", "too steep: 29.0 degrees, limit 10.0"),
        decision("unfit", "too steep: 28.0 degrees, limit 10.0"),
    )
    assert told == [
        "landslope: surface fit",
        "landslope: surface unfit: too steep: 29.0 degrees, limit 10.0"[:49] + "~",
    ]
    assert all(len(text) <= 50 for text in told)


def test_conditions_are_told_when_they_begin_and_when_they_end() -> None:
    lost = condition(Code.VITAL_INPUT_STALE, "frames", "2.0 s")
    gone = condition(Code.VITAL_INPUT_MISSING, "attitude")
    told = said(
        report(),
        health(),
        health(lost),
        health(condition(Code.VITAL_INPUT_STALE, "frames", "3.0 s")),
        health(lost, gone),
        health(gone),
        health(),
    )
    assert told == [
        "landslope: frames: none for 2.0 s",
        "landslope: attitude: none came",
        "landslope: over: frames: none for 2.0 s",
        "landslope: all well",
    ]


def test_command_is_told_once() -> None:
    event = Event(
        event="landing_refused",
        frame=1,
        time_unix_us=0,
        severity="warning",
        text="command to land: refused: denied",
    )
    assert said(report(), event) == ["landslope: land: refused: denied"]
    assert said(report(status_text=False), event) == []


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


def watched(estimate: Estimate, *, on_unfit: str = "report", command: str = "landing") -> list:
    watch = LandingWatch(LandingSettings(on_unfit=on_unfit))
    messages = (estimate, decision("fit", command=command), decision("unfit", "too rough", command=command))
    return [w for m in (*messages, messages[-1]) if (w := watch.feed(m)) is not None]


def test_unfit_surface_while_landing_is_told_once_and_held_only_when_asked() -> None:
    (said_once,) = watched(estimate(height_m=3.0))
    assert not said_once.hold
    assert "too rough" in said_once.event.text
    (held,) = watched(estimate(height_m=3.0), on_unfit="hold")
    assert held.hold


@pytest.mark.parametrize(
    ("values", "speaks"),
    [
        ({"height_m": 1.6}, True),
        ({"height_m": 1.4}, False),
        ({"time_to_contact_s": 3.1}, True),
        ({"time_to_contact_s": 2.9}, False),
        ({"time_to_contact_s": -5.0}, True),
        ({}, True),
    ],
)
def test_it_is_too_late_near_the_ground(values, speaks) -> None:
    assert bool(watched(estimate(**values), on_unfit="hold")) is speaks


@pytest.mark.parametrize("command", ["none", "landed", "refused: denied", "failed: no answer"])
def test_nothing_to_watch_without_a_landing(command) -> None:
    assert watched(estimate(height_m=5.0), command=command) == []
