"""Flight folders under named damage: one clear error, or refusals that are counted, and the rest is used."""

import shutil
from collections import Counter
from itertools import pairwise
from pathlib import Path

import folder_edits
import numpy as np
import pytest
from flight_copy import FLIGHTS

from companion.core import core as core_module
from companion.core.core import Core
from companion.errors import LandslopeError
from companion.messages.messages import Estimate, Event, Health, encode
from companion.replay.source import PlainCamera, open_source
from drivers.errors import DriverError
from drivers.files.flight_folder import FlightFolder
from drivers.files.video_file import VideoFile
from drivers.samples import Attitude, Frame, Refusal
from landing.estimate import SurfaceEstimate
from landing.pipeline import SurfacePipeline
from landing.plane.time_offset import TimeOffsetFilter

EDITS = folder_edits.EDITS


class NoPipeline:
    """Stands in for the mathematics where only the way to it is of interest."""

    def __init__(self, camera, options):
        self.time_offset = TimeOffsetFilter(0.0, 0.0, 0.0)
        whole = SurfacePipeline(camera, options)
        self.ground, self.contradictions = whole.ground, whole.contradictions
        self.camera, self.fixed = whole.camera, None

    def find_fixed(self, known):
        """Nothing is looked for in pictures here."""

    def step(self, observation):
        known = observation.ned_from_body is not None
        return SurfaceEstimate(observation.frame, observation.time_s, "ok" if known else "no_attitude", "map")


def run(folder):
    """Outputs of the core over a folder and the refusals on the way in."""
    source = open_source(folder, None, (), PlainCamera())
    core = Core(source.settings, source.camera, calibrated=source.calibrated, telemetry=source.telemetry)
    out, refused = [], Counter()
    for sample in source.samples():
        if isinstance(sample, Refusal):
            refused[sample.source, sample.reason] += 1
        out += core.feed(sample)
    return out + core.finish(), refused


@pytest.mark.parametrize("name", [n for n, e in EDITS.items() if e.error])
def test_what_cannot_be_replayed_is_one_line_that_names_the_file(flight, name):
    EDITS[name].apply(flight)
    with pytest.raises((DriverError, LandslopeError)) as caught:
        run(flight)
    text = str(caught.value)
    assert "\n" not in text
    assert all(words in text for words in EDITS[name].error), text


@pytest.mark.parametrize("name", [n for n, e in EDITS.items() if not e.error])
def test_damage_is_counted_and_the_rest_is_used(flight, monkeypatch, name):
    monkeypatch.setattr(core_module, "SurfacePipeline", NoPipeline)
    edit = EDITS[name]
    edit.apply(flight)
    out, refused = run(flight)
    health = [o for o in out if isinstance(o, Health)][-1]
    for source, reason, least in edit.refusals:
        reported = sum(n for key, n in health.counters.items() if key.endswith(f": {reason}"))
        assert max(refused[source, reason], reported) >= least, (refused, health.counters)
        assert reported >= least, "refusals are in Health"
    events = {o.event for o in out if isinstance(o, Event)}
    assert set(edit.events) <= events, events
    estimates = [o for o in out if isinstance(o, Estimate)]
    statuses = Counter(e.status for e in estimates)
    assert statuses["ok"] + statuses["no_attitude"] >= edit.frames
    assert statuses["ok"] >= edit.with_attitude, statuses
    if not edit.with_attitude:
        assert statuses["ok"] == 0
    numbers = [e.frame for e in estimates]
    assert len(set(numbers)) == len(numbers), "one estimate a frame"
    [encode(o) for o in out if isinstance(o, Estimate | Event | Health)]


def test_samples_come_in_order_of_arrival(recorded):
    folder = FlightFolder(recorded)
    samples = list(folder.samples())
    assert all(a.arrival_us <= b.arrival_us for a, b in pairwise(samples))
    frames = [s for s in samples if isinstance(s, Frame)]
    assert [f.number for f in frames] == list(range(90))
    assert folder.frame_count == 90
    assert folder.duration_s == pytest.approx(89 / 30, abs=1e-3)
    assert folder.start_us == samples[0].arrival_us


def test_a_folder_can_be_read_twice(recorded):
    folder = FlightFolder(recorded)
    first = [(type(s), s.arrival_us) for s in folder.samples()]
    assert first == [(type(s), s.arrival_us) for s in folder.samples()]


@pytest.mark.parametrize(
    ("seconds", "frames_too"), [(50.0, True), (-50.0, True), (5.0, False), (-5.0, False)]
)
def test_a_clock_that_was_set_does_not_mix_up_the_order(recorded, flight, seconds, frames_too):
    """Telemetry and frames stay beside each other as they were recorded."""

    def frames_by_attitude(folder):
        order, count = [], 0
        for sample in FlightFolder(folder).samples():
            if isinstance(sample, Attitude):
                count += 1
            elif isinstance(sample, Frame):
                order.append(count)
        return order

    before = frames_by_attitude(recorded)
    folder_edits.clock_jump(flight, seconds, frames_too)
    after = frames_by_attitude(flight)
    assert len(before) == len(after)
    assert max(abs(a - b) for a, b in zip(before, after, strict=True)) <= 4


def test_frames_behind_damage_keep_their_number(tmp_path):
    """Frames that damage took out of the video are refused by their rows; those behind are not taken for them."""
    recorded = FLIGHTS / "stairs_a"
    folder = Path(shutil.copytree(recorded, tmp_path / "flight"))
    video = folder / "camera.mkv"
    video.write_bytes(folder_edits.damaged(video.read_bytes()))
    samples = list(FlightFolder(folder).samples())
    frames = [s for s in samples if isinstance(s, Frame)]
    lost = [s for s in samples if isinstance(s, Refusal)]
    assert 1 <= len(lost) < 100
    assert {s.reason for s in lost} == {"undecodable_frame"}
    assert frames[-1].number == 753
    assert len(frames) + len(lost) == 754
    whole = {index: image for index, image in VideoFile(recorded / "camera.mkv").images() if index >= 740}
    assert all(np.array_equal(f.image, whole[f.number]) for f in frames if f.number >= 740)


def test_a_gap_that_the_stamps_have_too_is_no_loss(flight):
    """A camera that was late, recorded with true times: the rows count the frames that are there."""
    video = VideoFile(flight / "camera.mkv")
    rows = [line.split(",") for line in (flight / "frames.csv").read_text().splitlines()[1:]]
    times = [(int(row[1]) - int(rows[0][1])) * 1e-6 + (0.2 if k >= 40 else 0.0) for k, row in enumerate(rows)]
    folder_edits.edit_rows(
        flight, lambda rows: [[n, str(int(t) + (200_000 if int(n) >= 40 else 0))] for n, t in rows]
    )
    folder = FlightFolder(flight)
    images = [image for _, image in video.images()]
    folder.video.timed_images = lambda: zip(times, images, strict=True)
    samples = list(folder.samples())
    assert [s.number for s in samples if isinstance(s, Frame)] == list(range(90))
    assert not [s for s in samples if isinstance(s, Refusal)]


def test_a_camera_off_the_nominal_rate_of_the_file_loses_no_frame(flight):
    """28.6 frames a second written into a file of 30: one slot in twenty stays empty, no frame is missing."""
    video = VideoFile(flight / "camera.mkv")
    images = [image for _, image in video.images()]
    slots = [k + k // 20 for k in range(len(images))]
    folder = FlightFolder(flight)
    folder.video.timed_images = lambda: zip([slot / video.fps for slot in slots], images, strict=True)
    samples = list(folder.samples())
    assert [s.number for s in samples if isinstance(s, Frame)] == list(range(90))
    assert not [s for s in samples if isinstance(s, Refusal)]


def test_a_vehicle_that_is_not_in_the_log_is_named(recorded):
    with pytest.raises(DriverError, match="vehicle 9"):
        FlightFolder(recorded, system_id=9)


def test_a_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(DriverError, match="nowhere"):
        FlightFolder(tmp_path / "nowhere")
