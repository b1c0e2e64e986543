"""Recordings that end without being closed: a killed process, a power cut, a video cut anywhere."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
from camera_support import textured
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from places import SUPPORT

import drivers.files.flight_writer
from drivers.files.flight_folder import FlightFolder
from drivers.files.matroska import JpegMatroska
from drivers.files.recorder import FlightPapers, Recorder, RecorderOptions
from drivers.files.tlog import bytes_of
from drivers.files.video_file import VideoFile
from drivers.samples import Frame

PAPERS = FlightPapers(settings="[vehicle]\nsystem_id = 1\n", calibration="")
START_US = 1_795_299_001_000_000
STEP_US = 33_333


def options(directory: Path, **changes) -> RecorderOptions:
    return RecorderOptions(directory, **{"min_free_bytes": 1_000_000, **changes})


FRAMES_OF_A_SECOND = 50

WRITER = """
import sys, time
sys.path.insert(0, {tests!r})
from pathlib import Path
from camera_support import textured
from drivers.files.recorder import *
from drivers.samples import Frame
recorder = Recorder(RecorderOptions(Path({directory!r}), min_free_bytes=1), FlightPapers("[vehicle]\\n"))
recorder.start()
pictures = [textured(k) for k in range(50)]
number = 0
while True:
    now = time.time_ns() // 1000
    recorder.frame(Frame(number, now, now, pictures[number % 50]))
    recorder.mavlink(now, bytes.fromhex("fd0000000001010000000000"))
    number += 1
    print(number, now, flush=True)
    time.sleep(0.02)
"""


def test_a_killed_recorder_leaves_all_but_the_last_second(tmp_path):
    code = WRITER.format(tests=str(SUPPORT), directory=str(tmp_path))
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        said = [process.stdout.readline() for _ in range(110)]
        process.send_signal(signal.SIGKILL)
        said += process.stdout.readlines()
    last, last_us = map(int, [line for line in said if line.count(" ") == 1][-1].split())
    (folder,) = tmp_path.iterdir()
    rows = (folder / "frames.csv").read_text().splitlines()[1:]
    images = list(VideoFile(folder / "camera.mkv").images())
    assert len(images) >= len(rows) > 20
    # a second, or where the machine is too busy to run the threads in time the frames of a second
    kept, kept_us = (int(value) for value in rows[-1].split(",")[:2])
    assert last_us - kept_us < 1_000_000 or last - kept <= FRAMES_OF_A_SECOND
    frames = [sample for sample in FlightFolder(folder).samples() if isinstance(sample, Frame)]
    assert len(frames) == len(rows)
    tlog = bytes_of(folder / "vehicle.tlog")
    packets = len(tlog) // 20
    kept_us = int.from_bytes(tlog[(packets - 1) * 20 :][:8], "big")
    assert last_us - kept_us < 1_000_000 or last - packets <= FRAMES_OF_A_SECOND


def test_what_was_forced_to_the_disk_is_played_back_and_never_far_behind(tmp_path, monkeypatch):
    """A power cut keeps what fsync has returned for; here the sizes at that moment are taken down."""
    forced: dict[str, int] = {}
    real = drivers.files.flight_writer._force

    def force(file) -> None:
        real(file)
        forced[Path(file.name).name] = file.tell()

    monkeypatch.setattr(drivers.files.flight_writer, "_force", force)
    recorder = Recorder(options(tmp_path, sync_interval_s=0.2), PAPERS)
    recorder.start()
    for k in range(60):
        recorder.frame(Frame(k, START_US + k, START_US + k, textured(k)))
        time.sleep(0.02)
    cut = tmp_path / "cut"
    cut.mkdir()
    given_up = time.monotonic() + 300
    rows = 0
    while rows < 60:  # nothing more comes, so the next interval forces all that is there
        assert time.monotonic() < given_up, (forced, rows)
        time.sleep(0.02)
        for name, size in dict(forced).items():
            (cut / name).write_bytes((recorder.folder / name).read_bytes()[:size])
        if "frames.csv" in forced:
            rows = len((cut / "frames.csv").read_text().splitlines()) - 1
    recorder.close()
    assert rows == 60
    assert len(list(VideoFile(cut / "camera.mkv").images())) == 60


@examples(25)
@given(part=st.floats(0.2, 1.0), width=st.integers(16, 96), height=st.integers(16, 96))
def test_a_video_cut_anywhere_is_a_shorter_video(tmp_path_factory, part, width, height):
    path = tmp_path_factory.mktemp("cut") / "camera.mkv"
    lengths = []
    with path.open("wb") as file:
        video = JpegMatroska(file, width, height, 10.0)
        for k in range(25):
            assert video.write(cv2.imencode(".jpg", textured(k, width, height))[1].tobytes()) == k
            lengths.append(file.tell())
    path.write_bytes(path.read_bytes()[: max(lengths[0], int(part * lengths[-1]))])
    whole = sum(length <= path.stat().st_size for length in lengths)
    images = list(VideoFile(path).images())
    assert [index for index, _ in images][:whole] == list(range(whole))
    assert all(image.shape == (height, width) for _, image in images)
