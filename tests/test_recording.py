"""Recording goes with arming or by hand, and takes the settings and the calibration along."""

import pytest
from camera_support import SITL_LOGS

from companion.recording import RecordingSwitch, flight_papers, recorder_options
from companion.settings import RecordSettings
from companion.settings_file import load

S = 1_000_000


def switch(when: str = "armed", directory: str = "flights") -> RecordingSwitch:
    return RecordingSwitch(RecordSettings(directory=directory, when=when, after_disarm_s=5.0))


def test_recording_follows_arming_and_goes_on_for_a_while():
    recording = switch()
    said = [recording.step(t * S, armed) for t, armed in enumerate([None, False, True, True, None, False])]
    assert said == [False, False, True, True, True, True]
    assert recording.step(9 * S, False)
    assert not recording.step(10 * S, False)
    assert recording.step(11 * S, True)


def test_a_word_by_hand_holds_until_the_next_arming():
    recording = switch()
    assert not recording.step(0, False)
    recording.by_hand(True)
    assert recording.step(1 * S, False)
    assert recording.step(2 * S, True)
    recording.by_hand(False)
    assert not recording.step(3 * S, True)
    assert recording.step(4 * S, False)  # what follows disarming
    assert not recording.step(10 * S, False)


@pytest.mark.parametrize(("when", "expected"), [("always", True), ("manual", False)])
def test_always_and_manual_do_not_ask_for_arming(when, expected):
    recording = switch(when)
    assert recording.step(0, None) is expected
    recording.by_hand(not expected)
    assert recording.step(S, True) is not expected
    assert recording.step(2 * S, False) is not expected


def test_without_a_directory_nothing_is_recorded():
    recording = switch("always", directory="")
    recording.by_hand(True)
    assert not recording.step(0, True)


def test_papers_are_settings_that_load_again_with_the_calibration_beside_them(tmp_path):
    loaded = load(
        SITL_LOGS / "stairs_c" / "landslope.toml", ["decision.dwell_s=1.25", "record.min_free_mb=7"]
    )
    papers = flight_papers(loaded)
    (tmp_path / "landslope.toml").write_text(papers.settings)
    (tmp_path / "camera.yaml").write_text(papers.calibration)
    again = load(tmp_path / "landslope.toml")
    assert papers.calibration == (SITL_LOGS / "stairs_c" / "camera.yaml").read_text()
    assert again.settings.camera.calibration == str(tmp_path / "camera.yaml")
    assert again.settings.camera.time_offset_s == 0.018
    assert again.settings.decision == loaded.settings.decision
    assert again.settings.record == loaded.settings.record
    assert recorder_options(again.settings.record, 25.0).min_free_bytes == 7_000_000


def test_papers_without_a_calibration():
    papers = flight_papers(load(None))
    assert papers.calibration == ""
    assert 'calibration = ""' in papers.settings
