"""The camera's lateness is found in flown flights, with an honest uncertainty, and refused where it cannot be known."""

import dataclasses
from collections.abc import Callable, Iterator

import cv2
import numpy as np
import pytest
from camera_support import SITL_LOGS
from hypothesis import given
from hypothesis import strategies as st

from companion.calibration.time_offset import (
    TimeOffset,
    TimeOffsetOptions,
    _exp,
    _log,
    measure_time_offset,
)
from companion.cli import main
from companion.errors import LandslopeError
from companion.replay.source import PlainCamera, open_source
from drivers.samples import Attitude, Frame, Sample
from landing.rotations import exp_so3

Edit = Callable[[Sample], Sample]


@pytest.fixture(autouse=True)
def one_thread():
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    yield
    cv2.setNumThreads(threads)


def measured(
    flight: str, seconds: float, edit: Edit = lambda s: s, overrides: tuple[str, ...] = ()
) -> TimeOffset:
    source = open_source(SITL_LOGS / flight, None, overrides, PlainCamera())

    def samples() -> Iterator[Sample]:
        start_us = None
        for sample in source.samples():
            if isinstance(sample, Frame):
                start_us = start_us or sample.stamp_us
                if sample.stamp_us - start_us > seconds * 1e6:
                    return
            yield edit(sample)

    return measure_time_offset(samples(), source.camera, source.settings, TimeOffsetOptions())


def late(seconds: float) -> Edit:
    """Frames stamped later than they were taken."""
    shift_us = round(seconds * 1e6)
    return lambda s: dataclasses.replace(s, stamp_us=s.stamp_us + shift_us) if isinstance(s, Frame) else s


@pytest.mark.slow
def test_frames_stamped_late_are_found_late():
    found = measured("agile_a", 8.0, late(0.020))
    assert found.offset_s == pytest.approx(0.020, abs=max(0.002, 3 * found.std_s))
    assert found.std_s < 0.003
    assert found.correlation > 0.95


@pytest.mark.slow
def test_a_camera_that_is_late_by_itself():
    """The low-contrast flight, flown with a camera 18 ms late; little rotation, so with more doubt."""
    found = measured("stairs_c", 14.0)
    assert found.offset_s == pytest.approx(0.018, abs=max(0.003, 3 * found.std_s))
    assert found.std_s < 0.005


@pytest.mark.slow
def test_a_flight_without_rotation_cannot_tell():
    def still(sample: Sample) -> Sample:
        return (
            dataclasses.replace(sample, roll=0.0, pitch=0.0, yaw=0.0)
            if isinstance(sample, Attitude)
            else sample
        )

    with pytest.raises(LandslopeError, match="too little rotation"):
        measured("agile_a", 7.0, still)


@pytest.mark.slow
def test_a_wrong_mount_is_noticed():
    with pytest.raises(LandslopeError, match="mount"):
        measured("agile_a", 7.0, overrides=("camera.mount_yaw_deg=90",))


def test_too_short_a_flight_cannot_tell():
    with pytest.raises(LandslopeError, match="pairs of frames"):
        measured("agile_a", 1.5)


def test_a_plain_video_is_refused(tmp_path, capsys):
    video = SITL_LOGS / "agile_a" / "camera.mkv"
    assert main(["calibrate", "--time-offset", str(video)]) == 2
    assert "telemetry is needed" in capsys.readouterr().err


@given(st.lists(st.floats(-1.5, 1.5), min_size=3, max_size=3))
def test_rotations_in_bulk_are_those_of_the_single_ones(vector):
    v = np.array([vector])
    assert np.allclose(_exp(v)[0], exp_so3(v[0]), atol=1e-9)
    assert np.allclose(_log(_exp(v)), v, atol=1e-7)
