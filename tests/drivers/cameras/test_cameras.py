"""Every kind of camera, over real sockets where there are any, and what happens when they fail."""

import random
import shutil
import socket
import subprocess
import sys
import threading
import time
from itertools import pairwise

import numpy as np
import pytest
from camera_support import SITL_LOGS, MjpegServer, moving, rtsp_server, textured
from hypothesis import given
from hypothesis import strategies as st

from drivers.cameras import Camera, Grab, ReaderLimits, open_camera
from drivers.cameras.checks import SIZE_WITNESSES, FrameCheck
from drivers.cameras.grey import grey_of
from drivers.cameras.reader import ReaderCamera
from drivers.cameras.stamping import MinimumDelayStamper
from drivers.errors import DriverError
from drivers.samples import Frame, Refusal
from drivers.system.host_clock import now_us

QUICK = ReaderLimits(open_timeout_s=20.0, read_timeout_s=1.0, first_retry_s=0.05, longest_retry_s=0.2)
PATIENCE_S = 600.0


def collect(camera: Camera, count: int) -> list[Frame]:
    """The next ``count`` frames."""
    frames: list[Frame] = []
    until = time.monotonic() + PATIENCE_S
    while len(frames) < count and time.monotonic() < until:
        frames += [s for s in camera.read(0.2) if isinstance(s, Frame)]
    assert len(frames) >= count, camera.status()
    return frames


def await_state(camera: Camera, state: str) -> None:
    """Wait until the camera is in a state."""
    until = time.monotonic() + PATIENCE_S
    while camera.status().state != state:
        assert time.monotonic() < until, camera.status()
        time.sleep(0.02)


def adds_up(camera: Camera) -> bool:
    """Whether the counters account for every frame."""
    s = camera.status()
    return s.grabbed == s.delivered + s.skipped + s.waiting + sum(s.refused.values())


class ScriptedGrabber:
    """A grabber that does what a test says, frame by frame."""

    def __init__(self, actions) -> None:
        self._actions = actions

    def open(self) -> None:
        pass

    def grab(self) -> Grab | None:
        action = next(self._actions, "end")
        if action == "end":
            return None
        if isinstance(action, Exception):
            raise action
        if isinstance(action, threading.Event):
            action.wait()
            raise DriverError("woken too late")
        return action

    def close(self) -> None:
        pass


def test_http_stream_comes_at_its_pace_and_back_after_silence_and_a_cut():
    began_us = now_us()
    with MjpegServer(moving()) as server, open_camera(server.url, limits=QUICK) as camera:
        frames = collect(camera, 20)
        assert frames[0].image.shape == (120, 160)
        assert frames[0].image.dtype == np.uint8
        assert all(b.stamp_us > a.stamp_us for a, b in pairwise(frames))
        assert began_us <= frames[0].stamp_us <= frames[-1].stamp_us <= now_us()
        server.pause.set()
        await_state(camera, "lost")
        assert "no frame" in camera.status().problem or "stopped" in camera.status().problem
        server.pause.clear()
        collect(camera, 5)
        server.drop.set()
        await_state(camera, "lost")
        collect(camera, 5)
        names = [event.event for event in camera.events()]
        assert names.count("camera_lost") >= 2
        assert names.count("camera_back") >= 2
        assert camera.status().reopened >= 2
        assert adds_up(camera)


def test_slow_consumer_gets_the_newest_frame_and_the_rest_is_counted():
    with MjpegServer(moving(), rate_hz=60) as server, open_camera(server.url, limits=QUICK) as camera:
        collect(camera, 3)
        until = time.monotonic() + PATIENCE_S
        while camera.status().skipped <= 5 and time.monotonic() < until:
            time.sleep(0.02)
        skipped, grabbed = camera.status().skipped, camera.status().grabbed
        (late,) = (s for s in camera.take() if isinstance(s, Frame))
        assert skipped > 5
        assert late.number >= grabbed - 1, "the newest"
        assert adds_up(camera)


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="the RTSP server sends by ffmpeg")
def test_rtsp_stream_with_the_senders_times():
    with rtsp_server(SITL_LOGS / "stairs_a" / "camera.mkv") as url, open_camera(url) as camera:
        frames = collect(camera, 40)
    steps_ms = np.diff([frame.stamp_us for frame in frames]) / 1000
    per_frame_ms = steps_ms / np.diff([frame.number for frame in frames])
    assert np.median(per_frame_ms) == pytest.approx(1000 / 30, abs=2)
    assert frames[0].image.shape == (240, 320)


def test_flight_folder_plays_at_its_recorded_pace_and_ends(tmp_path):
    source = SITL_LOGS / "stairs_a"
    shutil.copy(source / "camera.mkv", tmp_path / "camera.mkv")
    lines = (source / "frames.csv").read_text().splitlines()[:31]
    (tmp_path / "frames.csv").write_text("\n".join(lines) + "\n")
    recorded = np.diff([int(line.split(",")[1]) for line in lines[1:]])
    with open_camera(str(tmp_path)) as camera:
        frames = [s for s in camera.frames() if isinstance(s, Frame)]
        status = camera.status()
    assert status.state == "ended"
    assert status.grabbed == 30
    assert status.reopened == 0
    played = {b.number: b.stamp_us - a.stamp_us for a, b in pairwise(frames) if b.number == a.number + 1}
    assert len(played) > 10
    assert all(step == recorded[number - 1] for number, step in played.items())


def test_faulty_frames_are_refused_by_name_and_counted():
    start = now_us()
    small = textured(9, 80, 60)
    actions = [
        Grab(textured(0), start),
        Grab(textured(0), start + 1000),  # frozen
        Grab(textured(1), start),  # the same stamp
        Grab(textured(1), start - 500),  # backward
        Grab(small, start + 2000),  # another size
        Grab(textured(2), start + 3000),
    ]
    camera = ReaderCamera("test", lambda: ScriptedGrabber(iter(actions)), QUICK)
    samples = list(camera.frames())
    camera.close()
    refused = [s.reason for s in samples if isinstance(s, Refusal)]
    assert refused == ["picture_repeated", "repeated_stamp", "backward_stamp", "size_changed"]
    assert "80 x 60 instead of 160 x 120" in [s.detail for s in samples if isinstance(s, Refusal)][-1]
    assert camera.status().refused == dict.fromkeys(refused, 1)
    assert adds_up(camera)


def test_a_read_that_hangs_is_given_up_and_its_late_frames_ignored():
    hang = threading.Event()
    lives = iter(
        [
            iter([Grab(textured(0), now_us()), hang]),
            iter([Grab(textured(k), now_us() + k) for k in range(1, 4)]),
        ]
    )
    camera = ReaderCamera("test", lambda: ScriptedGrabber(next(lives)), QUICK)
    list(camera.frames())
    status = camera.status()
    assert status.state == "ended"
    assert status.grabbed == 4
    assert status.reopened == 1
    assert status.hanging_reads == 1
    assert [e.event for e in camera.events()][:2] == ["camera_lost", "camera_back"]
    hang.set()
    camera.close()


def test_readers_that_all_hang_do_not_pile_up_and_closing_waits_for_none():
    hang = threading.Event()
    started = []

    def make() -> ScriptedGrabber:
        started.append(1)
        return ScriptedGrabber(iter([hang]))

    limits = ReaderLimits(
        open_timeout_s=0.1, read_timeout_s=0.1, first_retry_s=0.01, longest_retry_s=0.01, max_hanging_reads=2
    )
    camera = ReaderCamera("test", make, limits)
    until = time.monotonic() + PATIENCE_S
    while camera.status().hanging_reads < 2 and time.monotonic() < until:
        time.sleep(0.02)
    time.sleep(0.5)  # fifty times longer than it takes to try again
    assert len(started) == 2
    assert camera.status().state == "lost"
    camera.close()
    assert not hang.is_set(), "closed while both still hang"
    hang.set()


def test_missing_device_is_waited_for_and_named(tmp_path):
    with open_camera("/dev/video77", limits=QUICK) as camera:
        await_state(camera, "lost")
        assert "/dev/video77: no such camera" in camera.status().problem


@pytest.mark.parametrize("source", ["", "nowhere.mkv", "ftp://x/y", "picamera:one"])
def test_a_source_that_is_none_says_what_may_stand_there(source):
    with pytest.raises(DriverError, match="rtsp://"):
        open_camera(source)


@given(
    jitter_us=st.lists(st.integers(0, 40_000), min_size=30, max_size=60),
    offset_us=st.integers(-(10**12), 10**12),
)
def test_stamping_takes_the_jitter_out_up_to_the_least_delay(jitter_us, offset_us):
    stamper = MinimumDelayStamper()
    jitter_us[0] = 0
    for k, extra_us in enumerate(jitter_us):
        sent_us = k * 33_333
        assert stamper.stamp(sent_us, sent_us + offset_us + extra_us) == sent_us + offset_us


def test_stamping_starts_anew_when_presentation_times_fall_back():
    stamper = MinimumDelayStamper()
    stamper.stamp(5_000_000, 100_000_000)
    assert stamper.stamp(0, 100_033_000) == 100_033_000
    assert stamper.stamp(33_000, 100_070_000) == 100_066_000


@pytest.mark.parametrize(("nominal_hz", "true_hz"), [(25, 22.5), (25, 24.5), (30, 29)])
def test_times_that_the_sender_makes_up_are_not_used(nominal_hz, true_hz):
    stamper, chance, made_up_at = MinimumDelayStamper(), random.Random(1), None
    for k in range(600):
        seen_us = round(k * 1e6 / true_hz)
        arrival_us = seen_us + 30_000 + chance.randrange(8_000)
        stamp_us = stamper.stamp(round(k * 1e6 / nominal_hz), arrival_us)
        assert -50_000 <= stamp_us - (seen_us + 30_000) <= 50_000
        if stamper.made_up and made_up_at is None:
            made_up_at = arrival_us
    assert made_up_at is not None
    assert made_up_at < 8_000_000


@pytest.mark.parametrize("drift_ppm", [-200, 0, 200])
@pytest.mark.parametrize("queue_us", [0, 60_000])
def test_times_of_a_camera_s_clock_are_used_through_a_slow_network(drift_ppm, queue_us):
    stamper, chance = MinimumDelayStamper(), random.Random(2)
    for k in range(1800):
        sent_us = round(k * 1e6 / 30)
        late_us = queue_us if 600 <= k % 900 < 690 else 0
        arrival_us = round(sent_us * (1 + drift_ppm * 1e-6)) + late_us + chance.randrange(15_000)
        stamp_us = stamper.stamp(sent_us, arrival_us)
        assert abs(stamp_us - sent_us * (1 + drift_ppm * 1e-6)) < 45_000
    assert not stamper.made_up


@given(st.integers(1, 6).filter(lambda channels: channels not in (1, 2, 3, 4)))
def test_pictures_with_odd_channels_are_refused(channels):
    with pytest.raises(DriverError, match="shape"):
        grey_of(np.zeros((4, 4, channels), np.uint8))


def test_grey_of_planar_yuv_is_its_first_rows():
    planar = np.vstack([textured(0), np.full((60, 160), 128, np.uint8)])
    assert np.array_equal(grey_of(planar, 120), textured(0))


def test_check_takes_up_again_after_refusals():
    check = FrameCheck()
    good = [Frame(k, 1000 * k, 1000 * k, textured(k)) for k in range(3)]
    assert check.check(good[0]) is good[0]
    assert isinstance(check.check(Frame(9, 0, 0, textured(5))), Refusal)
    assert check.check(good[1]) is good[1]


def test_a_size_that_a_wrong_first_connection_had_is_given_up_when_another_one_stays():
    check = FrameCheck()
    shapes = [(80, 60)] + [(160, 120)] * (SIZE_WITNESSES + 5)
    frames = [Frame(k, 1000 * k, 1000 * k, textured(k, *shape)) for k, shape in enumerate(shapes)]
    results = [check.check(frame) for frame in frames]
    assert [isinstance(r, Refusal) for r in results] == [False] + [True] * SIZE_WITNESSES + [False] * 5
    stray = check.check(Frame(900, 900_000, 900_000, textured(900, 80, 60)))
    assert isinstance(stray, Refusal), "a single one is still refused"
    assert not isinstance(check.check(Frame(901, 901_000, 901_000, textured(901))), Refusal)


def test_frames_of_two_cameras_in_turn_change_nothing():
    check = FrameCheck()
    for k in range(100):
        size = (160, 120) if k % 2 == 0 else (80, 60)
        result = check.check(Frame(k, 1000 * k, 1000 * k, textured(k, *size)))
        assert isinstance(result, Refusal) == (k % 2 == 1)


def test_a_camera_whose_reads_all_hang_is_stuck_until_one_returns():
    hang = threading.Event()
    limits = ReaderLimits(
        open_timeout_s=0.1,
        read_timeout_s=0.1,
        first_retry_s=0.01,
        longest_retry_s=0.01,
        max_hanging_reads=2,
        stuck_after_s=0.3,
    )
    camera = ReaderCamera("test", lambda: ScriptedGrabber(iter([hang])), limits)
    until = time.monotonic() + PATIENCE_S
    while not camera.status().stuck and time.monotonic() < until:
        time.sleep(0.02)
    assert camera.status().stuck
    assert camera.status().hanging_reads == 2
    hang.set()
    while camera.status().stuck and time.monotonic() < until:
        time.sleep(0.02)
    assert not camera.status().stuck
    camera.close()


def test_the_command_ends_well_while_a_read_hangs():
    """A server that takes the call and never says a word; the process must end with its own code, and soon."""
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        source = f"camera.source=rtsp://127.0.0.1:{silent.getsockname()[1]}/live"
        words = ["doctor", "--seconds", "3", "--set", source, "--set", "camera.open_timeout_s=60"]
        done = subprocess.run(
            [sys.executable, "-m", "companion.cli", *words],
            capture_output=True,
            text=True,
            timeout=3600,
            check=False,
        )
    assert done.returncode == 2, done.stderr
    assert "no frame came" in done.stdout
    assert "0 failure" not in done.stdout.splitlines()[-1]
