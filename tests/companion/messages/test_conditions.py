"""What is wrong stays in the state until it is gone, and no landing is offered beside what forbids one."""

import dataclasses

import numpy as np
import pytest
from estimates import FLAT
from monitor_support import decision
from places import REPOSITORY

from companion.core.decision_logic import DecisionLogic, LandRequest
from companion.core.health import Clocks, HealthMonitor
from companion.live.live_pipeline import LivePipeline
from companion.messages.conditions import (
    KINDS,
    Code,
    Condition,
    condition,
    gravest_first,
    state_of,
)
from companion.messages.messages import Decision, Event, Health
from companion.monitor import words
from companion.settings.settings import (
    CameraSettings,
    LandingSettings,
    MavlinkSettings,
    RecordSettings,
    Settings,
)
from drivers.refusals import RefusalCode
from drivers.samples import Attitude, Frame, Heartbeat, Imu, LandedState, RcChannels, Refusal, Velocity

S = 1_000_000


def decided(*, calibrated: bool = True, standing: tuple[Condition, ...] = ()) -> tuple[list, HealthMonitor]:
    """Three seconds over flat ground with every input well and landing enabled."""
    settings = Settings(landing=LandingSettings(enabled=True))
    health = HealthMonitor(settings.health, True)
    health.calibrated, health.standing = calibrated, standing
    logic = DecisionLogic(settings, health)
    out: list = []
    for k in range(90):
        us = S + k * S // 30
        samples = (
            Frame(k, us, us, np.zeros((2, 2), np.uint8)),
            Attitude(us, us, 0.0, 0.0, 0.0),
            Imu(us, us, np.zeros(3)),
            Velocity(us, us, np.zeros(3), np.zeros(3)),
            Heartbeat(us, True, "GUIDED", "ardupilot", 4, "quadrotor"),
            LandedState(us, "in_air"),
        )
        for sample in samples:
            health.count(sample, us)
            if isinstance(sample, Heartbeat | LandedState):
                out += logic.follow(sample, us, us)
        out += logic.see(dataclasses.replace(FLAT, frame=k, time_s=us * 1e-6), us, us)
    return out, health


def last(out: list, kind: type):
    return [o for o in out if isinstance(o, kind)][-1]


def test_the_same_flight_without_any_condition_is_requested():
    out, health = decided()
    assert last(out, LandRequest)
    assert health.conditions(4 * S, settled=True) == ()


def test_an_uncalibrated_camera_is_never_fit_and_its_landing_is_withheld_for_that_reason():
    out, health = decided(calibrated=False)
    decisions = [o for o in out if isinstance(o, Decision)]
    assert {d.verdict for d in decisions} == {"unknown"}
    assert decisions[-1].reasons == ("the camera is not calibrated",)
    assert decisions[-1].withheld[0] == "the camera is not calibrated"
    assert "landing is not enabled" not in decisions[-1].withheld
    assert not [o for o in out if isinstance(o, LandRequest)]
    changes = [o for o in out if isinstance(o, Event) and o.event == "decision_changed"]
    assert len(changes) <= 2, "said once, not at every frame"
    message = health.message(4 * S, 4 * S, Clocks(0.0, 0.001))
    assert [c.code for c in message.conditions] == ["uncalibrated"]
    assert (message.state, message.problems) == ("degraded", ("the camera is not calibrated",))


@pytest.mark.parametrize("code", list(Code))
def test_every_condition_that_forbids_withholds_and_no_other_does(code: Code):
    standing = (condition(code, "gyro", "2.0 s"),)
    out, health = decided(standing=standing)
    requested = any(isinstance(o, LandRequest) for o in out)
    assert requested != KINDS[code].forbids_landing
    if not requested:
        assert last(out, Decision).withheld_codes == (code.value,)
    assert health.message(4 * S, 4 * S, Clocks(0.0, 0.001)).state == state_of(standing) != "ok"


def test_conditions_are_listed_once_and_the_gravest_first():
    found = gravest_first(
        [
            condition(Code.CLOCK_WITHOUT_DATE),
            condition(Code.TWO_VEHICLES),
            condition(Code.INPUT_STALE, "gyro", "1.0 s"),
            condition(Code.TWO_VEHICLES),
            condition(Code.VITAL_INPUT_STALE, "frames", "1.0 s"),
        ]
    )
    assert [c.code for c in found] == [
        "vital_input_stale",
        "two_vehicles",
        "input_stale",
        "clock_without_date",
    ]
    assert [c.code for c in found if c.forbids_landing] == ["two_vehicles"]
    assert set(KINDS) == set(Code)


def health_of(*conditions: Condition) -> Health:
    return Health(
        time_unix_us=1,
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


@pytest.mark.parametrize("code", list(Code))
def test_the_page_is_green_only_where_nothing_stands(code: Code):
    fit, health = decision(verdict="fit", reasons=()), health_of(condition(code, "gyro", "2.0 s"))
    grave = KINDS[code].forbids_landing or KINDS[code].severity == "error"
    assert words.look(fit, health) == ("unknown" if grave else "caution")
    assert words.verdict(fit, health) == ("NO LANDING" if grave else "FIT, WITH FAULTS")
    assert health.conditions[0].text in words.against(fit, None, health)
    assert words.look(decision(), health) == "unfit"
    well = health_of()
    assert (words.look(fit, well), words.verdict(fit, well)) == ("fit", "FIT TO LAND")


def live(settings: Settings, conditions=tuple) -> tuple[LivePipeline, list]:
    out: list = []
    return LivePipeline(settings, out.append, conditions), out


def test_the_live_pipeline_reports_what_stands_outside_of_it_until_it_is_gone():
    now: list[Condition] = [condition(Code.RECORDING_STOPPED, detail="disk full")]
    settings = Settings(camera=CameraSettings(width=64, height=48), mavlink=MavlinkSettings(connection="x"))
    pipeline, out = live(settings, lambda: tuple(now))
    for k in range(40):
        if k == 20:
            now.clear()
        pipeline.feed([Heartbeat(S + k * S // 10, True, "GUIDED", "ardupilot", 4)])
        pipeline.tick(S + k * S // 10)
    codes = [[c.code for c in h.conditions] for h in out if isinstance(h, Health)]
    assert "recording_stopped" in codes[0]
    assert "recording_stopped" not in codes[-1]
    assert all("uncalibrated" in found for found in codes)


def test_a_radio_that_falls_silent_is_a_condition_where_the_switch_is_on_it():
    landing = LandingSettings(enable_rc_channel=7)
    settings = Settings(
        camera=CameraSettings(width=64, height=48), mavlink=MavlinkSettings(connection="x"), landing=landing
    )
    pipeline, out = live(settings)
    for k in range(60):
        us = S + k * S // 10
        samples = [Heartbeat(us, True, "GUIDED", "ardupilot", 4, "quadrotor")]
        pipeline.feed([*samples, *([RcChannels(us, (1500,) * 8)] if k < 30 else [])])
        pipeline.tick(us)
    lost = ["radio_lost" in [c.code for c in h.conditions] for h in out if isinstance(h, Health)]
    assert not lost[0]
    assert lost[-1]


def test_a_second_vehicle_on_the_live_link_is_a_condition():
    settings = Settings(camera=CameraSettings(width=64, height=48), mavlink=MavlinkSettings(connection="x"))
    pipeline, out = live(settings)
    for k in range(20):
        us = S + k * S // 10
        pipeline.feed([Heartbeat(us, True, "GUIDED", "ardupilot", 4, "quadrotor")])
        if k == 2:
            pipeline.feed([Refusal(us, "mavlink", RefusalCode.SECOND_VEHICLE, "system 2")])
        pipeline.tick(us)
    health = last(out, Health)
    assert "two_vehicles" in [c.code for c in health.conditions]
    assert health.state == "failed"


def test_pictures_of_another_size_than_the_calibrations_are_a_condition_until_they_fit():
    calibration = REPOSITORY / "sitl_logs" / "stairs_a" / "camera.yaml"
    pipeline, out = live(Settings(camera=CameraSettings(calibration=str(calibration))))
    for k in range(60):
        us = S + k * S // 10
        width, height = (80, 60) if k < 30 else (pipeline._camera.width, pipeline._camera.height)
        pipeline.feed([Frame(k, us, us, np.full((height, width), k, np.uint8))])
        pipeline.tick(us)
    wrong = ["image_size" in [c.code for c in h.conditions] for h in out if isinstance(h, Health)]
    assert wrong[1]
    assert not wrong[-1]


def test_an_uncalibrated_camera_that_changes_its_size_is_followed():
    pipeline, out = live(Settings(camera=CameraSettings(width=64, height=48)))
    for k in range(40):
        us = S + k * S // 10
        size = (48, 64) if k < 5 else (60, 80)
        pipeline.feed([Frame(k, us, us, np.full(size, k, np.uint8))])
        pipeline.tick(us)
    assert "image_size" not in [c.code for c in last(out, Health).conditions]
    assert (pipeline._camera.width, pipeline._camera.height) == (80, 60)


def test_the_recording_that_stopped_is_a_condition(tmp_path):
    from companion.live.recording import FlightRecording

    (tmp_path / "flights").write_text("a file where a folder belongs")
    record = RecordSettings(directory=str(tmp_path / "flights"), when="always")
    recording = FlightRecording(Settings(record=record))
    assert recording.conditions() == ()
    recording.step(0)
    while not recording.step(0):
        pass
    (found,) = recording.conditions()
    assert found.code == "recording_stopped"
    assert found.text.startswith("not recording: ")
    recording.close()


@pytest.mark.parametrize(("readout_s", "unknown"), [("unknown", True), (0.0, False), (0.018, False)])
def test_a_readout_that_is_neither_set_nor_found_is_a_condition(readout_s, unknown):
    camera = CameraSettings(width=64, height=48, readout_s=readout_s)
    pipeline, out = live(Settings(camera=camera, mavlink=MavlinkSettings(connection="x")))
    for k in range(20):
        us = S + k * S // 10
        pipeline.feed([Heartbeat(us, True, "GUIDED", "ardupilot", 4, "quadrotor")])
        pipeline.tick(us)
    assert ("readout_unknown" in [c.code for c in last(out, Health).conditions]) == unknown
