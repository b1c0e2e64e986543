"""What is found of the camera's times is reported once it has settled."""

import pytest

from companion.core.camera_times import CameraTimes
from landing.plane.time_offset import TimeOffsetFilter


class Found(TimeOffsetFilter):
    """A filter whose readout is set by the test."""

    def know(self, readout_s: float, std_s: float) -> None:
        self.readout_s = readout_s
        self._covariance[1, 1] = std_s**2


def watched(readout_std_s: float = 0.016) -> tuple[Found, CameraTimes]:
    found = Found(0.01, 0.0, 7e-4, 0.0, readout_std_s)
    return found, CameraTimes(found, 0.0)


def names(times: CameraTimes, seconds: range) -> list[str]:
    return [event.event for s in seconds for event in times.step(float(s), None, s * 1_000_000)]


def test_a_readout_is_reported_once_when_it_has_settled():
    found, times = watched()
    found.know(0.01, 0.004)
    assert names(times, range(10)) == []
    assert times.readout == (None, None)
    assert times.readout_unknown
    found.know(0.0178, 0.0005)
    reported = [event for s in range(10, 30) for event in times.step(float(s), 7, s)]
    assert [event.event for event in reported] == ["readout_found"]
    assert "set camera.readout_s = 0.0178" in reported[0].text
    assert reported[0].details == {"readout_s": 0.0178, "std_s": 0.0005}
    assert times.readout == (0.0178, pytest.approx(0.0005))
    assert not times.readout_unknown


def test_one_that_still_moves_is_not():
    found, times = watched()
    reported = []
    for s in range(30):
        found.know(0.01 + 0.0006 * s, 0.0005)
        reported += times.step(float(s), None, s)
    assert reported == []


def test_a_global_shutter_makes_no_event_but_health_says_so():
    found, times = watched()
    found.know(0.0003, 0.0004)
    assert names(times, range(20)) == []
    assert times.readout[0] == 0.0003


def test_one_that_is_set_is_not_reported():
    _, times = watched(0.0)
    assert not times.readout_unknown
    assert names(times, range(20)) == []
    assert times.readout == (None, None)


def test_a_lateness_is_reported_when_it_is_sure():
    found, times = watched(0.0)
    found.late_s, found.std_s = 0.02, 0.006
    assert names(times, range(2)) == []
    found.std_s = 0.002
    assert names(times, range(2, 5)) == ["camera_late"]


def test_a_lateness_at_the_bound_of_the_search_is_reported_as_at_least_so_much():
    found, times = watched(0.0)
    found.late_s = 0.1
    (reported,) = times.step(0.0, None, 0)
    assert "at least 100 ms later" in reported.text
    assert "set it to" not in reported.text
    assert reported.details == {"late_s": 0.1, "at_least": True}


def test_no_lateness_is_reported_while_pictures_and_gyro_contradict_each_other():
    found, times = watched(0.0)
    found.late_s, found.std_s = 0.04, 0.002
    assert times.step(0.0, None, 0, contradicted=True) == []
    assert len(times.step(1.0, None, 0)) == 1
