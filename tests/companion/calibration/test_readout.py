"""The rows' readout is measured from a recorded flight with an honest uncertainty, or refused."""

from typing import Any

import cv2
import pytest
from camera_support import SITL_LOGS

from companion.calibration import readout as module
from companion.calibration.readout import measure_readout
from companion.cli import main
from companion.errors import LandslopeError
from companion.messages.messages import Health
from companion.replay.source import PlainCamera, open_source
from companion.settings.settings import Settings
from drivers.samples import Frame


def health(readout_s: float | None, std_s: float | None = 0.0003) -> Health:
    return Health(
        time_unix_us=0,
        state="ok",
        problems=(),
        inputs={},
        counters={},
        clock_offset_s=None,
        clock_std_s=None,
        camera_late_s=None,
        camera_late_std_s=None,
        pipeline_ms=None,
        camera_readout_s=readout_s,
        camera_readout_std_s=None if readout_s is None else std_s,
    )


@pytest.fixture
def measured(monkeypatch):
    """The measurement of a flight whose health, second by second, is given."""

    def measure(*reported: Health) -> module.Readout:
        class Reporting:
            def __init__(self, *_: Any, **__: Any) -> None: ...

            def feed(self, sample: Health) -> list[object]:
                return [object(), sample]

            def finish(self) -> list[object]:
                return []

        monkeypatch.setattr(module, "Core", Reporting)
        return measure_readout(reported, None, Settings())

    return measure


def test_the_newest_value_counts_with_the_spread_of_those_since_it_settled(measured):
    found = measured(health(None), health(0.016), health(0.018), health(0.020))
    assert found.readout_s == 0.020
    assert found.std_s == pytest.approx((0.0003**2 + (2 * 0.002**2 / 3)) ** 0.5)
    assert found.settled_s == 3


def test_what_has_not_settled_or_began_to_move_again_is_not_known(measured):
    for reported in ((), [health(None)] * 9, [health(0.018)] * 9 + [health(None)] + [health(0.018)] * 2):
        with pytest.raises(LandslopeError, match="turn more, unevenly"):
            measured(*reported)


def test_what_is_too_uncertain_is_refused_with_its_value(measured):
    with pytest.raises(LandslopeError, match=r"would be 18\.0 ms, but uncertain by 3\.0 ms"):
        measured(*[health(0.018, 0.003)] * 5)


@pytest.mark.slow
def test_a_global_shutter_is_found_to_have_none(monkeypatch):
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    source = open_source(SITL_LOGS / "agile_a", None, ("camera.readout_s=unknown",), PlainCamera())
    frames = 0

    def some():
        nonlocal frames
        for sample in source.samples():
            frames += isinstance(sample, Frame)
            if frames > 360:
                return
            yield sample

    found = measure_readout(some(), source.camera, source.settings)
    cv2.setNumThreads(threads)
    assert found.readout_s == pytest.approx(0.0, abs=3 * found.std_s)
    assert found.std_s < 0.001


@pytest.mark.parametrize("known", [True, False])
def test_the_command_prints_what_to_set_or_why_not(monkeypatch, capsys, known):
    def of_rows(*_: object) -> module.Readout:
        if not known:
            raise LandslopeError("the rows' readout was not found: turn more")
        return module.Readout(0.01784, 0.00025, 21)

    offset = type(
        "Offset",
        (),
        {"offset_s": 0.001, "std_s": 0.0009, "correlation": 0.999, "swing_rad_s": 0.4, "pairs": 400},
    )
    monkeypatch.setattr("companion.commands.calibrate.measure_time_offset", lambda *_: offset())
    monkeypatch.setattr("companion.commands.calibrate.measure_readout", of_rows)
    assert main(["calibrate", "--time-offset", str(SITL_LOGS / "agile_a")]) == 0
    said = capsys.readouterr().out
    assert "time_offset_s = 0.0010  # +- 0.0009 s" in said
    wanted = (
        "readout_s = 0.0178  # +- 0.0003 s; the settings have"
        if known
        else "# the rows' readout was not found"
    )
    assert f"\n{wanted}" in said
