"""Frames and telemetry on one time line: waiting, late stamps, jumps, reboots, and the frames' own stamps."""

import math
import random
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from companion.clocks.frame_time import FrameTime, FrameTimeline
from companion.core.attitude import BodyAttitude
from companion.core.sync import Synchroniser
from companion.settings.settings import CameraSettings, Settings, SyncSettings
from drivers.refusals import RefusalCode
from drivers.samples import Attitude, Frame, Heartbeat, Imu, Velocity
from landing.rotations import euler_from_matrix

OFFSET_US = 1_795_000_000_000_000
BOOT_US = 60_000_000
IMAGE = np.zeros((24, 32), np.uint8)


def roll_at(boot_us):
    return 0.3 * math.sin(2e-6 * boot_us)


def flight(seconds, *, delay_us=3000, frame_delay_us=0, late_us=0, frame_hz=30, attitude_hz=100, jump=None):
    """Samples in order of arrival; ``jump`` (at boot time, by) sets the companion's clock for all of them."""
    samples = []

    def stamped(boot_us):
        return OFFSET_US + boot_us + (jump[1] if jump and boot_us >= jump[0] else 0)

    for k in range(round(seconds * attitude_hz)):
        boot_us = BOOT_US + round(k * 1e6 / attitude_hz)
        wiggle = 1500 * (k * 7 % 5)
        attitude = Attitude(stamped(boot_us) + delay_us + wiggle, boot_us, roll_at(boot_us), 0, 0, 0.3)
        samples.append((boot_us + delay_us + wiggle, attitude))
        gyro = Imu(stamped(boot_us) + delay_us, boot_us, (0.6 * math.cos(2e-6 * boot_us), 0.0, 0.0))
        samples.append((boot_us + delay_us, gyro))
        if k % 10 == 0:
            north = boot_us * 1e-6
            velocity = Velocity(stamped(boot_us) + delay_us, boot_us, (0, 0, 0), (north, 0, 0))
            samples.append((boot_us + delay_us, velocity))
    for k in range(round(seconds * frame_hz)):
        boot_us = BOOT_US + 5000 + round(k * 1e6 / frame_hz)
        stamp_us = stamped(boot_us) + late_us
        samples.append(
            (boot_us + late_us + frame_delay_us, Frame(k, stamp_us, stamp_us + frame_delay_us, IMAGE))
        )
    return [sample for _, sample in sorted(samples, key=lambda item: item[0])]


def run(samples, sync=None, **options):
    """Ready frames and notices of a synchroniser."""
    sync = sync or Synchroniser(
        Settings(
            camera=CameraSettings(time_offset_s=options.pop("offset_s", 0.0)), sync=SyncSettings(**options)
        ),
        True,
    )
    ready, notices = [], []
    for sample in samples:
        frames, reported = sync.feed(sample)
        ready += frames
        notices += reported
    return ready + sync.flush("end_of_input"), notices


def roll_errors(ready, late_us=0):
    """Roll of every frame against the truth at its exposure, by the frame's number."""
    found = {}
    for frame in ready:
        if isinstance(frame.attitude, BodyAttitude):
            truth = roll_at(BOOT_US + 5000 + round(frame.frame.number * 1e6 / 30))
            found[frame.frame.number] = euler_from_matrix(frame.attitude.ned_from_body)[0] - truth
    return found


def test_every_frame_gets_the_attitude_at_its_exposure():
    ready, _ = run(flight(5))
    assert [r.frame.number for r in ready] == list(range(150))
    errors = roll_errors(ready)
    assert len(errors) >= 145
    # The least delay of the link, 3 ms, is all that the relation cannot see: 0.6 rad/s of it.
    assert max(map(abs, errors.values())) < 0.6 * 0.0035
    assert all(r.exposure_us == r.frame.stamp_us for r in ready)


def test_late_stamps_are_taken_back():
    ready, _ = run(flight(4, late_us=40_000), offset_s=0.04)
    errors = roll_errors(ready)
    assert len(errors) >= 110
    assert max(map(abs, errors.values())) < 0.6 * 0.0035
    assert all(r.exposure_us == r.frame.stamp_us - 40_000 for r in ready)
    uncorrected = roll_errors(run(flight(4, late_us=40_000))[0])
    assert max(map(abs, uncorrected.values())) > 0.6 * 0.03


def test_sparse_attitudes_with_gyro_are_nearly_as_good():
    ready, _ = run(flight(4, attitude_hz=20), slerp_max_gap_s=0.02)
    errors = roll_errors(ready)
    assert len(errors) >= 110
    assert max(map(abs, errors.values())) < 0.6 * 0.0045


@pytest.mark.parametrize("gone_from_s", [2.0])
def test_frames_without_attitude_leave_after_the_wait(gone_from_s):
    gone_us = BOOT_US + gone_from_s * 1e6
    samples = [s for s in flight(4) if not (isinstance(s, Attitude) and s.boot_us > gone_us)]
    sync = Synchroniser(Settings(sync=SyncSettings(attitude_wait_s=0.2)), True)
    late = []
    for sample in samples:
        for frame in sync.feed(sample)[0]:
            if frame.attitude == "attitude_late":
                late.append((sample.arrival_us - frame.frame.arrival_us) * 1e-6)
    assert len(late) >= 50
    assert 0.2 <= max(late) < 0.24
    ends = [frame.attitude for frame in sync.flush("end_of_input")]
    assert set(ends) == {"end_of_input"}


def test_frames_leave_in_order_and_each_once():
    samples = [s for k, s in enumerate(flight(5)) if not (isinstance(s, Attitude) and 250 < k < 420)]
    ready, _ = run(samples, attitude_max_gap_s=0.1)
    assert [r.frame.number for r in ready] == list(range(150))
    assert {r.attitude for r in ready if isinstance(r.attitude, str)} >= {"attitude_gap"}


def test_no_attitude_at_all_is_its_own_reason():
    ready, _ = run([s for s in flight(2) if not isinstance(s, Attitude)])
    assert {r.attitude for r in ready} == {"no_attitude"}
    assert ready[-1].boot_us is not None, "the clocks are related by the gyro alone"


def test_without_telemetry_frames_do_not_wait():
    sync = Synchroniser(Settings(), False)
    for frame in [s for s in flight(1) if isinstance(s, Frame)]:
        ((ready,), _) = sync.feed(frame)
        assert ready.attitude == "no_telemetry"
        assert ready.boot_us is None


@pytest.mark.parametrize("by_s", [-100.0, -0.5, -0.15, 0.15, 0.3, 0.5, 0.7, 100.0])
def test_after_a_jump_of_the_clock_attitudes_still_fit(by_s):
    at_us = BOOT_US + 3_000_000
    samples = flight(8, jump=(at_us, round(by_s * 1e6)))
    ready, notices = run(samples)
    names = [n.name for n in notices]
    assert names.count("clock_jumped") == 1
    jump = next(n for n in notices if n.name == "clock_jumped")
    assert jump.details["jump_s"] == pytest.approx(by_s, abs=0.002)
    assert jump.details["frames_too"]
    errors = roll_errors(ready)
    assert max(map(abs, errors.values())) < 0.6 * 0.008
    after = [n for n in errors if n > 30 * 4]
    assert len(after) >= 110, "from a second after the jump on every frame has an attitude again"
    assert max(abs(errors[n]) for n in after) < 0.6 * 0.005
    times = [r.time_us for r in ready]
    assert all(b > a for a, b in pairwise(times))


@pytest.mark.parametrize("by_s", [-5.0, 5.0])
def test_a_jump_of_the_telemetry_alone_leaves_the_frames_where_they_are(by_s):
    samples = flight(8)
    at_us = OFFSET_US + BOOT_US + 3_000_000
    by_us = round(by_s * 1e6)
    moved = []
    for s in samples:
        if not isinstance(s, Frame) and s.arrival_us >= at_us:
            s = type(s)(s.arrival_us + by_us, *(getattr(s, f) for f in list(s.__slots__)[1:]))
        moved.append(s)
    ready, notices = run(moved)
    jump = next(n for n in notices if n.name == "clock_jumped")
    assert not jump.details["frames_too"]
    errors = roll_errors(ready)
    assert len([n for n in errors if n > 120]) >= 110
    assert max(map(abs, errors.values())) < 0.6 * 0.006


def test_after_a_reboot_old_attitudes_are_gone():
    first, second = flight(3), []
    for s in flight(3):
        arrival_us = s.arrival_us + 4_000_000
        if isinstance(s, Frame):
            second.append(Frame(s.number + 200, arrival_us, arrival_us, s.image))
        else:
            values = [getattr(s, f) for f in list(s.__slots__)[2:]]
            second.append(type(s)(arrival_us, s.boot_us - BOOT_US + 1000, *values))
    ready, notices = run(first + second)
    assert [n.name for n in notices].count("autopilot_rebooted") == 1
    by_number = {r.frame.number: r for r in ready}
    late = by_number[280]
    assert isinstance(late.attitude, BodyAttitude)
    assert late.boot_us is not None
    assert late.boot_us < 4_000_000
    assert len(ready) == 180


def test_velocity_is_interpolated_and_does_not_outlive_its_age():
    ready, _ = run(flight(3))
    known = [r for r in ready if r.velocity_ned is not None and r.boot_us is not None]
    assert len(known) > 80
    assert max(abs(r.velocity_ned[0] - r.boot_us * 1e-6) for r in known) < 0.07
    gone = [s for s in flight(3) if not (isinstance(s, Velocity) and s.boot_us > BOOT_US + 1_000_000)]
    ready, _ = run(gone)
    assert next(r for r in ready if r.frame.number == 60).velocity_ned is None


def test_velocity_between_messages_and_just_behind_them_goes_on_as_it_changed():
    ready, _ = run(flight(3))
    reported_us = sorted(s.boot_us for s in flight(3) if isinstance(s, Velocity))
    interval_us = reported_us[1] - reported_us[0]
    for r in ready:
        if r.velocity_ned is not None and r.boot_us is not None and reported_us[1] <= r.boot_us:
            assert r.velocity_age_s <= interval_us * 1e-6
            # the vehicle speeds up by 1 m/s^2: a velocity that is held would be late
            assert abs(r.velocity_ned[0] - r.boot_us * 1e-6) < 0.3 * interval_us * 1e-6


def test_time_does_not_run_ahead_on_samples_that_do_not_fit():
    sync = Synchroniser(Settings(), True)
    for sample in flight(2):
        sync.feed(sample)
    now_us = sync.now_us
    sync.feed(Attitude(now_us + 50_000_000, BOOT_US + 2_010_000, 0, 0, 0))
    assert sync.now_us == now_us
    sync.feed(Heartbeat(now_us + 10_000, True, "GUIDED", "ardupilot", 4))
    assert sync.now_us == now_us + 10_000


def test_refused_samples_are_reported_once():
    sync = Synchroniser(Settings(), True)
    for sample in flight(1):
        sync.feed(sample)
    assert sync.refusals() == []
    frame = Frame(99, OFFSET_US + BOOT_US + 100_000, OFFSET_US + BOOT_US + 1_000_000, IMAGE)
    sync.feed(frame)
    assert sync.refusals() == [("frames", "backward_stamp")]
    assert sync.refusals() == []


# The frames' own time line.


def test_repeated_and_single_backward_stamps_are_refused():
    line = FrameTimeline(100_000)
    stamps = [0, 33_000, 33_000, 66_000, 20_000, 99_000, 132_000]
    got = [line.feed(1_000_000 + s) for s in stamps]
    assert got[2] == "repeated_stamp"
    assert got[4] == "backward_stamp"
    times = [t.time_us for t in got if isinstance(t, FrameTime)]
    assert times == [1_000_000 + s for s in (0, 33_000, 66_000, 99_000, 132_000)]


@given(st.lists(st.integers(-200_000, 400_000), min_size=1, max_size=80))
@examples(200)
def test_time_rises_whatever_the_stamps_do(steps):
    line, stamp, last = FrameTimeline(100_000), 10_000_000, -1
    for step in steps:
        stamp += step
        times = line.feed(stamp)
        if isinstance(times, FrameTime):
            assert times.time_us > last
            last = times.time_us


def test_stamps_that_fell_back_for_good_are_followed():
    line = FrameTimeline(100_000)
    for k in range(30):
        line.feed(50_000_000 + 33_333 * k)
    got = [line.feed(20_000_000 + 33_333 * k) for k in range(5)]
    assert got[:2] == ["backward_stamp", "backward_stamp"]
    assert isinstance(got[2], FrameTime)
    assert got[2].jump_us == pytest.approx(-30_000_000 - 30 * 33_333, abs=1000)
    assert got[4].steady_us == pytest.approx(50_000_000 + 34 * 33_333, abs=1000)


def test_a_gap_is_a_jump_only_if_the_telemetry_jumped_as_far():
    line = FrameTimeline(100_000)
    for k in range(30):
        line.feed(33_333 * k + 1)
    line.feed(33_333 * 30 + 5_000_000)
    assert not line.telemetry_jumped(2_000_000)
    assert line.telemetry_jumped(5_000_000)
    assert not line.telemetry_jumped(5_000_000), "one step, one jump"
    times = line.feed(33_333 * 31 + 5_000_000)
    assert isinstance(times, FrameTime)
    assert times.steady_us == 33_333 * 31


def test_two_links_of_one_vehicle_are_one_and_their_copies_are_counted():
    """Every message once more, 80 to 320 ms later, as a log of two links has it."""
    chance, once = random.Random(1), flight(4)
    copies = [
        replace(s, arrival_us=s.arrival_us + chance.randint(80_000, 320_000))
        for s in once
        if not isinstance(s, Frame)
    ]
    sync, refused = Synchroniser(Settings(), True), []
    ready, notices = [], []
    for sample in sorted([*once, *copies], key=lambda s: s.arrival_us):
        frames, found = sync.feed(sample)
        ready += frames
        notices += [notice.name for notice in found]
        refused += sync.refusals()
    alone, _ = run(once)
    assert notices == ["clock_settled"]
    assert len(refused) == len(copies)
    assert {reason for _, reason in refused} == {RefusalCode.REPEATED_MESSAGE}
    ready += sync.flush("end_of_input")
    assert roll_errors(ready) == roll_errors(alone)
