"""A flight replayed with the autopilot's own log in the place of the tlog, aligned by the rotation in both."""

import shutil
from pathlib import Path

import pytest
from dataflash_support import rows_of_tlog, write_log
from flight_copy import FLIGHTS, short_flight

from companion.errors import LandslopeError
from companion.replay.source import PlainCamera, ReplaySource, open_source
from drivers.samples import Attitude

SECONDS = 7.0


@pytest.fixture(scope="module")
def flight(tmp_path_factory) -> Path:
    """A flight that turns briskly, with ``vehicle.bin`` beside its tlog."""
    folder = short_flight(tmp_path_factory.mktemp("log") / "flight", "agile_a", SECONDS)
    write_log(folder / "vehicle.bin", rows_of_tlog(folder / "vehicle.tlog"))
    return folder


def _by_log(flight: Path, folder: Path) -> Path:
    shutil.copytree(flight, folder)
    (folder / "vehicle.tlog").unlink()
    return folder


def _offset_us(source: ReplaySource) -> float:
    """Companion's time minus boot time of a replay's attitudes; the earliest, as a link only delays."""
    return min(s.arrival_us - s.boot_us for s in source.samples() if isinstance(s, Attitude))


def test_a_log_without_round_trips_is_aligned_by_rotation_and_said_so(flight, tmp_path):
    folder = _by_log(flight, tmp_path / "flight")
    source = open_source(folder, None, (), PlainCamera())
    assert len(source.cautions) == 1
    assert "aligned by the rotation in" in source.cautions[0]
    assert _offset_us(source) == pytest.approx(
        _offset_us(open_source(flight, None, (), PlainCamera())), abs=5000
    )


def test_another_flights_log_is_refused(flight, tmp_path):
    folder = _by_log(flight, tmp_path / "flight")
    other = FLIGHTS / "descent_a"
    write_log(folder / "vehicle.bin", rows_of_tlog(other / "vehicle.tlog"))
    with pytest.raises(LandslopeError, match="autopilot's log"):
        open_source(folder, None, (), PlainCamera())
