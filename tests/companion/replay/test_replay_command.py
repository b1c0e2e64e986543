"""``landslope replay``: what it writes, what it says, and that bad input is one clear line before or after the run."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from bus_support import Watcher, router
from folder_edits import EDITS, short_flight
from ports import free_endpoint
from replay_support import landslope

from companion import cli
from drivers.files.video_file import VideoFile

FAST = ("--set", "estimator.method=quadratic")
SECONDS = 3.0
FRAMES = 90


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return short_flight(tmp_path_factory.mktemp("replay") / "short", seconds=SECONDS)


@pytest.fixture(scope="module")
def images(flight: Path) -> Path:
    folder = flight.parent / "images"
    folder.mkdir()
    for index, image in VideoFile(flight / "camera.mkv").images():
        if index >= 60:
            cv2.imwrite(str(folder / f"image{index - 60}.png"), image)
    return folder


def lines(path: Path) -> list[dict]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_files_of_one_flight_and_what_the_video_shows(flight: Path, tmp_path: Path, capsys):
    out, events, plot, video = (tmp_path / n for n in ("e.jsonl", "v.jsonl", "p.png", "o.webm"))
    arguments = ["--out", out, "--events", events, "--plot", plot, "--video", video, "--enable-after", "1"]
    arguments += ["--set", "decision.dwell_s=0.3"]  # the flight is short
    assert cli.main(["replay", str(flight), *map(str, arguments)]) == 0
    assert [estimate["frame"] for estimate in lines(out)] == list(range(FRAMES))
    reported = lines(events)
    assert all({"event", "frame", "time_unix_us"} <= set(line) for line in reported)
    assert "decision" in {line["event"] for line in reported}
    requested = [line["frame"] for line in reported if line["event"] == "landing_requested"]
    printed = capsys.readouterr().out
    assert f"(frame {requested[0]})" in printed
    assert printed.startswith("short: 90 frames in 3.0 s")
    picture = cv2.imread(str(plot))
    assert picture.shape[0] > 600
    assert picture.std() > 20
    assert VideoFile(video).fps == pytest.approx(30, abs=0.1)
    capture = cv2.VideoCapture(str(video))
    pictures = [image for read, image in iter(capture.read, (False, None)) if read]
    assert len(pictures) == FRAMES
    assert pictures[0].shape == (720, 960, 3)
    unknown, fit = pictures[5][30, 850].astype(int), pictures[85][30, 850].astype(int)
    assert np.ptp(unknown) < 30, "grey while nothing is known"
    assert fit[1] > fit[0] + 40, "green when fit"
    assert fit[1] > fit[2] + 40
    green = (pictures[85][..., 1].astype(int) - pictures[85][..., 2]) > 60
    assert 500 < green[80:600, :250].sum() < 40_000, "tracks in green beside the grid"


@pytest.mark.parametrize("name", [name for name, edit in EDITS.items() if edit.error])
def test_what_cannot_be_replayed_is_one_line_with_file_and_remedy(
    name: str, flight: Path, tmp_path: Path, capsys
):
    damaged = shutil.copytree(flight, tmp_path / name)
    EDITS[name].apply(damaged)
    assert cli.main(["replay", str(damaged), *FAST]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == 1
    for word in EDITS[name].error:
        assert word in said.err


@pytest.mark.parametrize("name", ["video_cut", "rows_gap", "tlog_garbage", "tlog_cut", "clock_jump_forward"])
def test_damage_is_counted_and_everything_up_to_it_is_used(name: str, flight: Path, tmp_path: Path, capsys):
    damaged = shutil.copytree(flight, tmp_path / "flight")
    EDITS[name].apply(damaged)
    out = tmp_path / "out.jsonl"
    assert cli.main(["replay", str(damaged), *FAST, "--out", str(out)]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    assert len(lines(out)) >= EDITS[name].frames
    for _, reason, count in EDITS[name].refusals:
        number = int(said.out[: said.out.index(reason.replace("_", " "))].split()[-3])
        assert number >= count
    if name == "clock_jump_forward":
        assert "short" not in said.out.splitlines()[0]
        assert "90 frames in 3.0 s" in said.out, "the time that the clock was set by is no time of flight"


@pytest.mark.parametrize("how", ["calibration", "fov", "focal", "nothing"])
def test_a_plain_video_goes_without_telemetry(how: str, flight: Path, tmp_path: Path, capsys):
    out = tmp_path / "out.jsonl"
    options = {
        "calibration": ["--calibration", str(flight / "camera.yaml")],
        "fov": ["--fov-deg", "64"],
        "focal": ["--focal-px", "256"],
        "nothing": [],
    }[how]
    assert cli.main(["replay", str(flight / "camera.mkv"), *options, "--out", str(out)]) == 0
    estimates = lines(out)
    assert len(estimates) == FRAMES
    good = [estimate for estimate in estimates if estimate["status"] == "ok"]
    assert good or how == "nothing", "without a calibration the slope may stay too uncertain"
    assert all(e["slope_x_deg"] is not None and e["inclination_deg"] is None for e in good)
    assert {e["calibrated"] for e in estimates} == {how != "nothing"}
    assert not any(e["flat"] for e in estimates)
    printed = capsys.readouterr().out
    assert ("uncalibrated camera" in printed) == (how == "nothing")
    assert ("relative to the camera" in printed) == bool(good)
    steps = np.diff([estimate["time_unix_us"] for estimate in estimates])
    assert steps.mean() == pytest.approx(33_333, abs=50)


def test_a_folder_of_images_in_the_order_of_their_numbers(images: Path, flight: Path, tmp_path: Path, capsys):
    out, again = tmp_path / "images.jsonl", tmp_path / "video.jsonl"
    assert cli.main(["replay", str(images), "--fov-deg", "64", "--fps", "30", "--out", str(out)]) == 0
    estimates = lines(out)
    assert len(estimates) == 30
    assert cli.main(["replay", str(flight / "camera.mkv"), "--fov-deg", "64", "--out", str(again)]) == 0
    slopes, expected = ([e["slope_y_deg"] for e in es[-5:]] for es in (estimates, lines(again)))
    assert np.allclose(np.array(slopes), np.array(expected), atol=3.0)


def test_several_flights_run_beside_each_other_and_give_the_same_as_alone(tmp_path: Path):
    flight = short_flight(tmp_path / "short", seconds=1.5)
    other = shutil.copytree(flight, tmp_path / "other")
    broken = shutil.copytree(flight, tmp_path / "broken")
    EDITS["video_empty"].apply(broken)
    alone = tmp_path / "alone.jsonl"
    assert cli.main(["replay", str(flight), *FAST, "--out", str(alone)]) == 0
    folder = tmp_path / "results"
    result = landslope(
        "replay", flight, other, broken, *FAST, "--out", f"{folder}/", "--events", folder / "{flight}.e"
    )
    assert result.returncode == 2
    assert result.stdout.count("45 frames in") == 2
    assert result.stderr.splitlines() == [line for line in result.stderr.splitlines() if "camera.mkv" in line]
    assert (folder / "short.jsonl").read_bytes() == alone.read_bytes()
    assert (folder / "other.jsonl").read_bytes() == alone.read_bytes()
    assert lines(folder / "short.e") == lines(folder / "other.e")


def test_several_flights_into_one_file_are_refused(flight: Path, tmp_path: Path, capsys):
    assert (
        cli.main(["replay", str(flight), str(flight / "camera.mkv"), "--out", str(tmp_path / "one.jsonl")])
        == 2
    )
    assert "{flight}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--out", "absent/e.jsonl"], "cannot be written"),
        (["--plot", "file/p.png"], "cannot be written"),
        (["--video", "file/"], "cannot be made"),
        (["--out", "same", "--events", "same"], "written twice"),
        (["--fps", "30"], "for plain videos"),
        (["--config", "absent.toml"], "no such settings file"),
        (["--set", "estimator.metod=map"], "did you mean estimator.method?"),
        (["--set", "decision.dwell_s=99"], "outside its limits 0 to 10 s"),
        (["--set", "camera.calibration=absent.yaml"], "absent.yaml"),
    ],
)
def test_wrong_options_are_one_line_before_the_run(
    options: list[str], says: str, flight: Path, tmp_path: Path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    assert cli.main(["replay", str(flight), *FAST, *options]) == 2
    said = capsys.readouterr()
    assert says in said.err
    assert len(said.err.splitlines()) == 1
    assert said.out == ""
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    "options", [["--fps", "0"], ["--fov-deg", "x"], ["--fov-deg", "60", "--focal-px", "200"]]
)
def test_arguments_that_make_no_sense_are_refused(options: list[str], capsys):
    with pytest.raises(SystemExit) as end:
        cli.main(["replay", "x", *options])
    assert end.value.code == 2
    assert "Traceback" not in capsys.readouterr().err


def test_a_missing_flight_and_a_folder_of_nothing(tmp_path: Path, capsys):
    assert cli.main(["replay", str(tmp_path / "absent")]) == 2
    assert "no such flight" in capsys.readouterr().err
    assert cli.main(["replay", str(tmp_path)]) == 2
    assert "no images" in capsys.readouterr().err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_is_one_line(flight: Path, capsys):
    assert cli.main(["replay", str(flight), *FAST, "--out", "/dev/full"]) == 2
    said = capsys.readouterr().err
    assert "No space left" in said
    assert "/dev/full" in said


def test_without_matplotlib_a_plot_is_refused_before_the_run(
    flight: Path, monkeypatch, capsys, tmp_path: Path
):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert cli.main(["replay", str(flight), "--plot", str(tmp_path / "p.png")]) == 2
    assert "pip install 'landslope[plot]'" in capsys.readouterr().err


def test_heavy_libraries_are_left_alone_until_asked_for(tmp_path: Path):
    flight = short_flight(tmp_path / "short", seconds=0.5)
    code = (
        "import sys; from companion import cli; code = cli.main(sys.argv[1:]); "
        "print(*sorted({m.split('.')[0] for m in sys.modules} & {'matplotlib', 'zenoh', 'mavsdk', 'rich', 'nicegui'}));"
        "sys.exit(code)"
    )
    command = [sys.executable, "-c", code, "replay", str(flight), *FAST]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    assert result.stdout.splitlines()[-1] == ""


def test_at_the_recorded_pace(flight: Path, capsys):
    assert cli.main(["replay", str(flight), *FAST, "--realtime"]) == 0
    elapsed_s = float(capsys.readouterr().out.split("replayed in ")[1].split()[0])
    assert elapsed_s >= SECONDS - 0.1


@pytest.mark.parametrize("several", [False, True])
def test_an_interrupt_ends_it_without_a_traceback(several: bool, flight: Path, tmp_path: Path):
    flights = [flight, shutil.copytree(flight, tmp_path / "other")] if several else [flight]
    outs = ["--realtime", "--out", f"{tmp_path}/out/"]
    process = subprocess.Popen(
        [sys.executable, "-m", "companion.cli", "replay", *map(str, flights), *FAST, *outs],
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    written = tmp_path / "out" / f"{flights[-1].name}.jsonl"
    while process.poll() is None and not (written.exists() and written.stat().st_size):
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=3600)
    assert process.returncode == 130
    assert said == b""


@pytest.mark.parametrize("routed", [False, True], ids=["peer to peer", "through a router"])
def test_a_watcher_in_another_process_gets_every_decision_and_event(
    routed: bool, flight: Path, tmp_path: Path
):
    endpoint = free_endpoint()
    events = tmp_path / "events.jsonl"
    options = ["--set", f"zenoh.connect={endpoint}", "--set", "vehicle.name=kestrel", "--events", str(events)]
    with (
        router(endpoint) if routed else Watcher("--listen", endpoint) as first,
        Watcher("--connect", endpoint, "--set", "zenoh.mode=client") if routed else first as watcher,
    ):
        # The watcher's subscription takes a moment to reach the router; the replay waits for it.
        result = landslope("replay", flight, *FAST, "--publish", *options, "--enable-after", "1")
        assert result.returncode == 0, result.stderr
        seen = watcher.until(lambda seen: any(m.get("alive") is False for m in seen))
    written = lines(events)
    expected = [line for line in written if line["event"] != "decision"]
    assert [
        {k: m[k] for k in line} for m, line in zip(watcher.of("event"), expected, strict=True)
    ] == expected
    decisions = watcher.of("decision")
    for line in written:
        if line["event"] == "decision":
            assert {k: v for k, v in line.items() if k != "event"} in [
                {k: v for k, v in m.items() if k not in ("vehicle", "topic")} for m in decisions
            ]
    assert {m["vehicle"] for m in seen} == {"kestrel"}
    assert len(watcher.of("estimate")) > 0
    assert len(watcher.of("health")) > 0
