"""The core on recorded flights: estimates, decisions, one request, the same bytes twice."""

from collections import Counter

import numpy as np
import pytest
import sample_edits

from companion.core.core import Core, LandRequest, Processed
from companion.core.health import Clocks, HealthMonitor
from companion.messages.messages import Decision, Estimate, Event, Health, encode
from companion.replay.source import PlainCamera, open_source
from drivers.refusals import RefusalCode
from drivers.samples import Attitude, Frame, Imu, Refusal
from landing.vision.camera import CameraModel

MESSAGES = (Estimate, Decision, Health, Event)
NO_SAMPLE_US = 700_000


def feed(source, samples=None, enabled=False, settings=None):
    core = Core(
        settings or source.settings, source.camera, calibrated=source.calibrated, telemetry=source.telemetry
    )
    core.set_enabled(enabled)
    out = []
    for sample in source.samples() if samples is None else samples:
        out += core.feed(sample)
    return out + core.finish()


def of(out, kind):
    return [o for o in out if isinstance(o, kind)]


@pytest.fixture(scope="module")
def source(recorded):
    return open_source(recorded, None, ("decision.dwell_s=0.2",), PlainCamera())  # the flight is short


@pytest.fixture(scope="module")
def samples(source):
    return list(source.samples())


@pytest.fixture(scope="module")
def outputs(source, samples):
    return feed(source, samples, enabled=True)


def test_every_frame_has_one_estimate_and_comes_back_with_it(outputs):
    estimates = of(outputs, Estimate)
    assert [e.frame for e in estimates] == list(range(90))
    processed = of(outputs, Processed)
    assert [(p.frame.number, p.estimate.frame) for p in processed] == [(k, k) for k in range(90)]
    assert Counter(e.status for e in estimates)["ok"] >= 50
    assert all(e.calibrated for e in estimates)


def test_estimates_carry_their_exposure_in_both_clocks(outputs, samples):
    stamps = {s.number: s.stamp_us for s in samples if isinstance(s, Frame)}
    boots = [s.boot_us for s in samples if isinstance(s, Attitude)]
    for estimate in of(outputs, Estimate):
        assert estimate.time_unix_us == stamps[estimate.frame]
        assert boots[0] * 1e-6 <= estimate.time_boot_s <= boots[-1] * 1e-6
        assert abs(estimate.roll_deg) < 10
        assert estimate.pitch_deg is not None


def test_level_ground_is_requested_once_and_never_again(outputs):
    """The flight begins over the platform, which is level."""
    assert len(of(outputs, LandRequest)) == 1
    assert [e.event for e in of(outputs, Event)].count("landing_requested") == 1
    assert of(outputs, Decision)[-1].requested


def test_without_permission_nothing_is_requested(source, samples):
    out = feed(source, samples)
    assert of(out, LandRequest) == []
    assert of(out, Decision)[-1].withheld == ("landing is not enabled",)


def test_two_runs_give_the_same_bytes(source, samples, outputs):
    again = feed(source, samples, enabled=True)
    first = [encode(o) for o in outputs if isinstance(o, MESSAGES)]
    assert first == [encode(o) for o in again if isinstance(o, MESSAGES)]


def test_health_is_reported_every_second(outputs):
    health = of(outputs, Health)
    assert 3 <= len(health) <= 5
    assert health[1].state == "ok", health[1].problems
    assert health[1].inputs["attitude"].rate_hz == pytest.approx(100, rel=0.05)
    assert health[1].clock_std_s < 0.002


def test_frames_in_the_dark_have_a_reason(source, samples):
    out = feed(source, sample_edits.blank(samples, 40, 60))
    dark = [e for e in of(out, Estimate) if 42 <= e.frame <= 60]
    assert all(e.status != "ok" for e in dark)
    assert all(e.slope_x_deg is None and not e.flat for e in dark)
    assert [e for e in of(out, Estimate) if e.frame > 75 and e.status == "ok"]


def test_without_attitude_the_slope_is_relative_to_the_camera_and_nothing_is_fit(source, samples):
    out = feed(source, sample_edits.drop(samples, Attitude), enabled=True)
    estimates = of(out, Estimate)
    assert len(estimates) == 90
    assert all(e.inclination_deg is None and e.roll_deg is None for e in estimates)
    assert of(out, LandRequest) == []
    assert {d.verdict for d in of(out, Decision)} <= {"unknown", "unfit"}
    assert "attitude_lost" in [e.event for e in of(out, Event)]


def test_sparse_attitude_with_gyro_gives_the_same_surface(source, samples, outputs):
    sparse = feed(source, sample_edits.thin(samples, Attitude, 10))
    full = {e.frame: e for e in of(outputs, Estimate) if e.status == "ok"}
    both = [(full[e.frame], e) for e in of(sparse, Estimate) if e.status == "ok" and e.frame in full]
    assert len(both) >= 50
    assert np.median([abs(a.pitch_deg - b.pitch_deg) for a, b in both]) < 0.05
    assert np.median([abs(a.slope_x_deg - b.slope_x_deg) for a, b in both]) < 0.3


def test_attitudes_that_come_too_late_are_done_without(source, samples):
    start_us = samples[0].arrival_us + 1_500_000
    out = feed(source, sample_edits.late(samples, start_us, NO_SAMPLE_US))
    assert [e.frame for e in of(out, Estimate)] == list(range(90))
    assert any(e.roll_deg is None for e in of(out, Estimate))


def test_an_image_of_another_size_is_refused(source, samples):
    camera = CameraModel.from_focal(160, 120, 128.0)
    core = Core(source.settings, camera, calibrated=True, telemetry=True)
    out = [o for s in samples for o in core.feed(s)] + core.finish()
    assert {e.status for e in of(out, Estimate)} == {"image_size"}
    assert of(out, Health)[-1].counters["refused frames: image_size"] == 90


def test_a_second_vehicle_is_reported_once_and_nothing_is_requested_until_it_has_left(source, samples):
    strange = Refusal(samples[0].arrival_us, "ATTITUDE", RefusalCode.SECOND_VEHICLE, "from 7:1")
    out = feed(source, [strange, strange, *samples[:600]], enabled=True)
    assert [e.event for e in of(out, Event)].count("second_vehicle") == 1
    assert of(out, LandRequest) == []

    def stands(message):
        return "two_vehicles" in {c.code for c in message.conditions}

    monitor = HealthMonitor(source.settings.health, telemetry=True)
    assert monitor.second_vehicle(0)
    assert not monitor.second_vehicle(5_000_000)
    health = [monitor.message(us, us, Clocks()) for us in (5_000_000, 14_999_999)]
    assert all(stands(m) and m.state == "failed" for m in health)
    assert not monitor.second_vehicle_gone(15_000_000)
    assert monitor.second_vehicle_gone(15_000_001)
    assert not stands(monitor.message(15_000_002, 15_000_002, Clocks()))
    assert not monitor.second_vehicle_gone(16_000_000)
    assert monitor.second_vehicle(17_000_000)


def test_the_end_of_a_second_vehicle_is_reported(source, samples):
    strange = Refusal(samples[0].arrival_us, "ATTITUDE", RefusalCode.SECOND_VEHICLE, "from 7:1")
    core = Core(source.settings, source.camera, calibrated=True, telemetry=True)
    out = [o for s in [*samples[:200], strange] for o in core.feed(s)]
    now_us = core._sync.now_us
    for k in range(25):
        out += core.tick(now_us + k * 500_000)
    names = [e.event for e in of(out, Event)]
    assert names.count("second_vehicle") == names.count("second_vehicle_gone") == 1


def test_frames_without_an_attitude_are_a_condition_until_they_have_one(source, samples):
    frames = [s for s in samples if isinstance(s, Frame)]
    hole = frames[30].arrival_us, frames[70].arrival_us
    holed = [s for s in samples if not (isinstance(s, Attitude | Imu) and hole[0] < s.arrival_us < hole[1])]
    core = Core(source.settings, source.camera, calibrated=True, telemetry=True)
    core.set_enabled(True)
    codes, withheld = [], []
    for s in holed:
        out = core.feed(s)
        if isinstance(s, Frame):
            codes.append("attitude_missing" in core._health.standing_codes())
        withheld += [d.withheld_codes for d in of(out, Decision)]
    assert not any(codes[:30])
    assert any(codes[40:75])
    assert not codes[-1]
    assert any("attitude_missing" in found for found in withheld)


def test_refused_frames_are_not_counted_as_taken(source, samples):
    frames = [s for s in samples if isinstance(s, Frame)]
    doubled = sorted([*samples, *frames[10:15]], key=lambda s: s.arrival_us)
    out = feed(source, doubled)
    health = of(out, Health)[-1]
    assert (health.inputs["frames"].count, health.inputs["frames"].refused) == (90, 5)
    refused = [e for e in of(out, Estimate) if e.status == "repeated_stamp"]
    assert [e.frame for e in refused] == [10, 11, 12, 13, 14]


def test_a_plain_video_is_processed_without_waiting(recorded):
    source = open_source(recorded / "camera.mkv", None, (), PlainCamera(focal_px=256.0))
    core = Core(source.settings, source.camera, calibrated=True, telemetry=False)
    for k, sample in enumerate(source.samples()):
        out = core.feed(sample)
        assert [e.frame for e in of(out, Estimate)] == [k]
        assert of(out, Estimate)[0].time_boot_s is None
        if k == 30:
            break
    assert of(core.finish(), Health)[-1].state == "ok"


def test_silence_is_reported_while_time_passes(source, samples):
    core = Core(source.settings, source.camera, calibrated=True, telemetry=True)
    for sample in samples[:300]:
        core.feed(sample)
    out = []
    for k in range(1, 31):
        out += core.tick(samples[299].arrival_us + 100_000 * k)
    assert [h.state for h in of(out, Health)] == ["failed"] * 3
    assert of(out, Decision)[-1].verdict == "unknown"
    assert "input_stale" in [e.event for e in of(out, Event)]
