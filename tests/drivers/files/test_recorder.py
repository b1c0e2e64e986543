"""Recordings are played back by the reader of flights, also when the power went, and a full disk harms nothing else."""

import csv
import json
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
from camera_support import SITL_LOGS, textured
from places import SUPPORT

import drivers.files.flight_writer
from drivers.files.flight_folder import FlightFolder
from drivers.files.recorder import FlightPapers, Recorder, RecorderOptions
from drivers.files.tlog import GARBAGE, bytes_of, records
from drivers.files.video_file import VideoFile
from drivers.samples import Attitude, Frame, Refusal

PAPERS = FlightPapers(settings="[vehicle]\nsystem_id = 1\n", calibration="")
START_US = 1_795_298_557_000_000
STEP_US = 33_333


def options(directory: Path, **changes) -> RecorderOptions:
    return RecorderOptions(directory, **{"min_free_bytes": 1_000_000, **changes})


def await_event(recorder: Recorder, name: str) -> str:
    """The text of the first event of that name."""
    until = time.monotonic() + 300
    while time.monotonic() < until:
        for event in recorder.events():
            if event.event == name:
                return event.text
        time.sleep(0.02)
    raise AssertionError(f"no event {name}")


def test_a_recording_is_a_flight_that_is_read_back_whole(tmp_path):
    recorder = Recorder(options(tmp_path / "flights"), PAPERS)
    recorder.frame(Frame(0, 1, 1, textured(0)))  # not recording yet: nothing happens
    recorder.start()
    data = bytes_of(SITL_LOGS / "stairs_a" / "vehicle.tlog")[:20_000]
    packets = [record for record in records(data) if record.message_id != GARBAGE]
    for record in packets:
        recorder.mavlink(record.stamp_us, data[record.start + 8 : record.end])
    numbers = [k + (k > 20) for k in range(60)]  # frame 21 was skipped
    for k, number in enumerate(numbers):
        stamp_us = START_US + number * STEP_US
        recorder.frame(Frame(number, stamp_us, stamp_us + 9000, textured(number)))
        recorder.message("estimate", json.dumps({"frame": number}).encode())
        recorder.message("preview", b"not recorded")
        if k == 30:
            recorder.message("event", b'{"event":"mode_changed"}')
    recorder.stop()
    recorder.close()
    folder = recorder.folder
    flight = FlightFolder(folder)
    samples = list(flight.samples())
    frames = [s for s in samples if isinstance(s, Frame)]
    assert not [s for s in samples if isinstance(s, Refusal)]
    assert [f.stamp_us for f in frames] == [START_US + number * STEP_US for number in numbers]
    errors = [np.abs(f.image.astype(int) - textured(n)).mean() for f, n in zip(frames, numbers, strict=True)]
    assert max(errors) < 2.0
    assert sum(isinstance(s, Attitude) for s in samples) > 10
    rows = list(csv.DictReader((folder / "frames.csv").open()))
    assert [int(row["number"]) for row in rows] == numbers
    assert {int(row["arrival_us"]) - int(row["host_time_us"]) for row in rows} == {9000}
    assert (folder / "landslope.toml").read_text() == PAPERS.settings
    assert len((folder / "estimates.jsonl").read_text().splitlines()) == 60
    assert json.loads((folder / "events.jsonl").read_text()) == {"event": "mode_changed"}
    assert recorder.counters == {"frames": 60, "packets": len(packets), "messages": 61}


def test_starting_and_stopping_makes_a_folder_each(tmp_path):
    recorder = Recorder(options(tmp_path), PAPERS)
    for _ in range(3):
        recorder.start()
        recorder.start()
        recorder.frame(Frame(0, START_US, START_US, textured(0)))
        recorder.stop()
        recorder.stop()
    recorder.close()
    assert [event.event for event in recorder.events()] == ["recording_started", "recording_stopped"] * 3
    assert len(list(tmp_path.iterdir())) == 3


FULL = """
import resource, sys, time
sys.path.insert(0, {tests!r})
from pathlib import Path
from camera_support import textured
from drivers.files.recorder import *
from drivers.samples import Frame
resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, resource.RLIM_INFINITY))
recorder = Recorder(RecorderOptions(Path({directory!r}), min_free_bytes=1, sync_interval_s=0.05, retry_s=1.0),
                    FlightPapers("\\n"))
recorder.start()
number = 0
while not recorder.counters["failures"]:
    recorder.frame(Frame(number, number, number, textured(number)))
    number += 1
    time.sleep(0.005)
while not recorder.stopped:
    time.sleep(0.005)
print(recorder.recording, recorder.stopped)
print(*[event.event for event in recorder.events()], recorder.counters["failures"])
resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
until = time.monotonic() + 300
while not recorder.recording and time.monotonic() < until:
    time.sleep(0.02)
print(recorder.recording, *[event.event for event in recorder.events()])
recorder.close()
"""


def test_a_disk_that_takes_no_more_stops_the_recording_until_it_takes_more_and_nothing_else(tmp_path):
    code = FULL.format(tests=str(SUPPORT), directory=str(tmp_path))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=3600)
    assert done.stdout.splitlines() == [
        "False File too large",
        "recording_started recording_failed 1",
        "True recording_started",
    ], done.stderr
    folder = min(tmp_path.iterdir())
    assert len(list(VideoFile(folder / "camera.mkv").images())) >= 3


MOST_WAITING = 8


def record_until(recorder: Recorder, condition) -> None:
    """Frames, until the condition holds; no more of them than the recorder has time to write."""
    until, k = time.monotonic() + 300, 0
    begun = recorder.counters["frames"]
    while not condition():
        while recorder.recording and k - recorder.counters["frames"] + begun > MOST_WAITING:
            assert time.monotonic() < until
            time.sleep(0.002)
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


def test_a_slow_disk_costs_parts_of_the_recording_and_says_so(tmp_path, monkeypatch):
    answers = threading.Event()
    monkeypatch.setattr(drivers.files.flight_writer, "_force", lambda file: answers.wait(20))
    recorder = Recorder(
        options(tmp_path, max_waiting_bytes=5 * textured(0).nbytes, sync_interval_s=0.01), PAPERS
    )
    recorder.start()
    for k in range(40):
        recorder.frame(Frame(k, START_US + k, START_US + k, textured(k)))
    assert not answers.is_set(), "taking frames waits for no disk"
    answers.set()
    recorder.close(patience_s=20)
    names = [event.event for event in recorder.events()]
    assert names.count("recording_behind") == 1
    assert recorder.counters["dropped"] + recorder.counters["frames"] == 40


def test_a_directory_that_cannot_be_made_is_an_event(tmp_path):
    (tmp_path / "flights").write_text("a file, not a directory")
    recorder = Recorder(options(tmp_path / "flights"), PAPERS)
    recorder.start()
    assert "flights" in await_event(recorder, "recording_failed")
    recorder.close()


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
