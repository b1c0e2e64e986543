"""Recordings roll over, keep their limits by stopping or deleting, go on when there is room, and queue few bytes."""

import shutil
import threading
import time
from pathlib import Path

import numpy as np
from camera_support import PAPERS, START_US, await_event, options, textured

import drivers.files.flight_writer
from drivers.files.flight_folder import FlightFolder
from drivers.files.recorder import Recorder
from drivers.samples import Frame


def record_until(recorder: Recorder, condition) -> None:
    """Frames, until the condition holds."""
    until, k = time.monotonic() + 20, 0
    while not condition():
        assert time.monotonic() < until
        recorder.frame(Frame(k, START_US + k, START_US + k, textured(k % 50)))
        k += 1
        time.sleep(0.002)


def test_a_recording_goes_on_in_a_new_folder_when_its_size_is_reached(tmp_path):
    recorder = Recorder(options(tmp_path, sync_interval_s=0.02, max_flight_bytes=30_000), PAPERS)
    recorder.start()
    record_until(recorder, lambda: len(list(tmp_path.iterdir())) >= 4)
    assert recorder.recording
    recorder.close()
    names = [event.event for event in recorder.events()]
    assert names.count("recording_continued") >= 3
    folders = sorted(tmp_path.iterdir(), key=lambda path: path.stat().st_mtime)
    frames = [
        len([s for s in FlightFolder(f).samples() if isinstance(s, Frame)]) for f in folders if _frames(f)
    ]
    assert sum(frames) == recorder.counters["frames"], "none is lost at a change of folders"
    assert all((folder / "landslope.toml").read_text() == PAPERS.settings for folder in folders)


def _frames(folder: Path) -> bool:
    return (folder / "camera.mkv").exists() and (folder / "frames.csv").read_text().count("\n") > 1


def size_of(directory: Path) -> int:
    return sum(file.stat().st_size for file in directory.rglob("*") if file.is_file())


def test_a_limit_for_all_flights_is_kept_by_deleting_the_oldest_that_we_recorded(tmp_path):
    limit = 150_000
    foreign = tmp_path / "20200101T000000Z"  # a name like ours, but no flight
    foreign.mkdir()
    (foreign / "thesis.tex").write_text("years of work")
    changes = {"sync_interval_s": 0.02, "max_flight_bytes": 30_000, "max_total_bytes": limit}
    recorder = Recorder(options(tmp_path, delete_oldest=True, **changes), PAPERS)
    recorder.start()
    record_until(recorder, lambda: recorder.counters["folders deleted"] >= 3)
    assert recorder.recording
    recorder.close()
    assert size_of(tmp_path) < limit + 60_000, "the limit, and what two intervals bring"
    assert (foreign / "thesis.tex").exists()
    assert len([e for e in recorder.events() if e.event == "recording_deleted"]) >= 3


def test_a_limit_for_all_flights_stops_the_recording_which_goes_on_when_there_is_room(tmp_path):
    changes = {"sync_interval_s": 0.02, "max_total_bytes": 60_000, "retry_s": 0.05}
    recorder = Recorder(options(tmp_path, **changes), PAPERS)
    recorder.start()
    record_until(recorder, lambda: recorder.stopped)
    assert "record.max_total_mb" in recorder.stopped
    assert not recorder.recording
    size = size_of(tmp_path)
    for k in range(20):
        recorder.frame(Frame(k, k, k, textured(k)))
    time.sleep(0.1)
    assert size_of(tmp_path) == size
    shutil.rmtree(next(tmp_path.iterdir()))
    record_until(recorder, lambda: recorder.recording and not recorder.stopped)
    recorder.close()
    names = [event.event for event in recorder.events()]
    assert names.count("recording_stopped") >= 1
    assert names[-2:] == ["recording_started", "recording_stopped"]


def test_space_that_runs_out_stops_the_recording_and_space_that_is_back_resumes_it(tmp_path, monkeypatch):
    usage = shutil.disk_usage(tmp_path)
    recorder = Recorder(options(tmp_path, sync_interval_s=0.02, retry_s=0.05), PAPERS)
    recorder.start()
    await_event(recorder, "recording_started")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage._replace(free=10))
    assert "record.min_free_mb" in await_event(recorder, "recording_stopped")
    assert "record.min_free_mb" in recorder.stopped
    time.sleep(0.2)
    assert recorder.events() == [], "said once"
    monkeypatch.undo()
    await_event(recorder, "recording_started")
    assert recorder.recording
    recorder.close()
    assert len(list(tmp_path.iterdir())) == 2


def test_a_disk_that_is_too_full_from_the_start_is_reported(tmp_path):
    recorder = Recorder(options(tmp_path, sync_interval_s=0.05, min_free_bytes=10**18), PAPERS)
    recorder.start()
    assert "min_free_mb" in await_event(recorder, "recording_refused")
    assert not recorder.recording
    recorder.close()


def test_the_queue_is_bounded_by_bytes_not_by_items(tmp_path, monkeypatch):
    held = threading.Event()
    monkeypatch.setattr(drivers.files.flight_writer, "_force", lambda file: held.wait(20))
    recorder = Recorder(options(tmp_path, max_waiting_bytes=3_000_000, sync_interval_s=0.01), PAPERS)
    recorder.start()
    big = np.zeros((1000, 1000), np.uint8)
    for k in range(30):
        recorder.frame(Frame(k, k, k, big))
    assert recorder.counters["dropped"] == 28
    for _ in range(1000):
        recorder.mavlink(1, bytes(40))
    assert recorder.counters["dropped"] == 28, "telemetry still fits"
    held.set()
    recorder.close(20)
    assert recorder.counters["frames"] == 2
    assert recorder.counters["packets"] == 1000


def test_pictures_of_another_size_begin_a_new_folder(tmp_path):
    recorder = Recorder(options(tmp_path), PAPERS)
    recorder.start()
    for k in range(20):
        recorder.frame(Frame(k, k, k, textured(k, *((160, 120) if k < 10 else (80, 60)))))
    recorder.close()
    folders = list(tmp_path.iterdir())
    shapes = [{s.image.shape for s in FlightFolder(f).samples() if isinstance(s, Frame)} for f in folders]
    assert sorted(shapes, key=str) == [{(120, 160)}, {(60, 80)}]
    assert recorder.counters["frames"] == 20
