"""Recording goes with arming or by hand, and takes the settings and the calibration along."""

import dataclasses
import statistics

import pytest
from camera_support import SITL_LOGS, textured
from daemon_support import wait_for
from replay_support import replayed, run

from companion.live.recording import FlightRecording, RecordingSwitch, flight_papers, recorder_options
from companion.settings.settings import RecordSettings, Settings
from companion.settings.settings_file import load
from drivers.files.flight_folder import FlightFolder
from drivers.files.tlog import GARBAGE, bytes_of, records
from drivers.samples import Frame, Heartbeat

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
    papers = flight_papers(loaded.settings)
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
    papers = flight_papers(load(None).settings)
    assert papers.calibration == ""
    assert 'calibration = ""' in papers.settings


def test_a_flight_is_recorded_from_arming_to_disarming(tmp_path):
    settings = Settings(record=RecordSettings(directory=str(tmp_path), min_free_mb=1, after_disarm_s=0.0))
    recording = FlightRecording(settings)
    names = []
    for t in range(40):
        armed = 10 <= t < 30
        at_us = 1_795_299_001_000_000 + t * S // 30
        recording.samples(
            [Heartbeat(at_us, armed, "GUIDED", "ardupilot", 4), Frame(t, at_us, at_us, textured(t))]
        )
        names += [event.event for event in recording.step(at_us)]
    recording.close()
    names += [event.event for event in recording.step(at_us)]
    assert names == ["recording_started", "recording_stopped"]
    (folder,) = tmp_path.iterdir()
    frames = (folder / "frames.csv").read_text().splitlines()[1:]
    assert [int(line.split(",")[3]) for line in frames] == list(range(11, 31))
    assert FlightFolder(folder).frame_count == 20
    assert recording.counters["recorder frames"] == 20


def test_without_a_directory_everything_may_be_reported_and_nothing_is_kept():
    recording = FlightRecording(Settings())
    recording.samples([Frame(0, 0, 0, textured(0))])
    recording.mavlink(0, b"")
    assert recording.step(0) == []
    assert recording.counters == {}
    recording.close()


@pytest.mark.slow
def test_a_recorded_flight_replays_like_the_flight_itself(tmp_path, replay_cache):
    """Five seconds of a flight go through the recorder; the replay of what it wrote agrees with the original's."""
    source = SITL_LOGS / "stairs_a"
    loaded = load(source / "landslope.toml")
    camera = dataclasses.replace(loaded.settings.camera, calibration=str(source / "camera.yaml"))
    record = RecordSettings(directory=str(tmp_path), when="always", min_free_mb=1, jpeg_quality=95)
    recording = FlightRecording(dataclasses.replace(loaded.settings, camera=camera, record=record))
    recording.step(0)
    data, given = bytes_of(source / "vehicle.tlog"), 0
    flight = FlightFolder(source)
    end_us = flight.start_us + 5 * S
    for packet in records(data):
        if packet.message_id != GARBAGE and packet.stamp_us < end_us:
            recording.mavlink(packet.stamp_us, data[packet.start + 8 : packet.end])
            given += 1
            if given % 500 == 0:
                # five seconds of packets at once are more than the recorder keeps for a slow disk
                wait_for(
                    lambda n=given: recording.counters.get("recorder packets", 0) >= n, "packets on disk"
                )
    for sample in flight.samples():
        if isinstance(sample, Frame) and sample.stamp_us < end_us:
            recording.samples([sample])
    recording.close()
    assert not recording.counters.get("recorder dropped")
    (folder,) = (path for path in tmp_path.iterdir() if path.is_dir())
    again = run(folder, folder).estimates
    whole = replayed(replay_cache, "stairs_a").estimates[: len(again)]
    assert len(again) == pytest.approx(150, abs=10)
    assert [e["time_unix_us"] for e in again] == [e["time_unix_us"] for e in whole]
    both = [(a, b) for a, b in zip(again, whole, strict=True) if a["status"] == b["status"] == "ok"]
    assert len(both) > 80
    far = [
        abs(a["inclination_deg"] - b["inclination_deg"])
        / max(a["inclination_std_deg"], b["inclination_std_deg"])
        for a, b in both
    ]
    assert statistics.median(far) < 0.5
    assert statistics.quantiles(far, n=10)[-1] < 3
