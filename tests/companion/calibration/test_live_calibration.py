"""Calibrating from a camera: what is missing is said until it is enough, then it ends by itself."""

import cv2
import numpy as np
import pytest

from companion.calibration.board import Board, BoardFinder
from companion.calibration.calibration import CalibrationOptions
from companion.calibration.live import LiveCalibration, run_live
from companion.cli import main
from companion.commands import calibrate as command
from companion.errors import LandslopeError
from drivers.cameras import Camera, CameraStatus
from drivers.files.camera_info import read_camera_info
from drivers.samples import Frame


class PictureCamera(Camera):
    """Gives pictures one after the other, as fast as they are taken, then ends or stays silent."""

    def __init__(self, pictures, *, ends: bool = True, problem: str = "") -> None:
        self._pictures, self._ends, self._problem = list(pictures), ends, problem
        self.taken, self.closed = 0, False

    def take(self):
        return self.read(0)

    def read(self, timeout_s):
        if self.taken == len(self._pictures):
            return []
        self.taken += 1
        return [Frame(self.taken, self.taken, self.taken, self._pictures[self.taken - 1])]

    def status(self):
        over = self.taken == len(self._pictures)
        return CameraStatus(
            "ended" if over and self._ends else "ok", self._problem, 400, 300, self.taken, self.taken, 0, 0
        )

    def events(self):
        return []

    def close(self):
        self.closed = True


@pytest.fixture(scope="module")
def pictures(charuco_film):
    return [cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in sorted(charuco_film.iterdir())]


def live() -> LiveCalibration:
    return LiveCalibration(BoardFinder(Board()), CalibrationOptions(), "plumb_bob")


def test_it_says_what_is_missing_and_ends_by_itself(pictures):
    said: list[str] = []
    camera = PictureCamera([np.full((300, 400), 90, np.uint8), *pictures, *pictures])
    found = run_live(camera, live(), said.append)
    assert found.info.matrix[0] == pytest.approx(288, rel=0.01)
    assert camera.taken < 2 * len(pictures), "it ended before the film"
    assert said[0].splitlines()[0] == "........"
    assert "no board seen yet" in said[0]
    assert "11 more views" in said[1]
    assert "bring it to the " in said[1]
    assert said[1].count("#") < said[-1].count("#")


def test_a_film_that_ends_too_early_is_refused_with_what_is_missing(pictures):
    with pytest.raises(LandslopeError, match="only 5 different views"):
        run_live(PictureCamera(pictures[:5]), live(), lambda text: None)


def test_a_camera_that_gives_nothing_is_one_line():
    camera = PictureCamera([], ends=False, problem="no such device")
    with pytest.raises(LandslopeError, match="no frame for 30 s: no such device"):
        run_live(camera, live(), lambda text: None)


@pytest.mark.parametrize(
    ("words", "source"),
    [
        (["--live", "--set", "camera.source=picamera"], "picamera"),
        (["http://camera.local/stream"], "http://camera.local/stream"),
        (["rtsp://10.0.0.2:8554/down"], "rtsp://10.0.0.2:8554/down"),
    ],
)
def test_cameras_and_streams_are_sources(pictures, tmp_path, monkeypatch, capsys, words, source):
    opened: list[str] = []
    cameras: list[PictureCamera] = []

    def open_camera(name, wanted, limits):
        opened.append(name)
        cameras.append(PictureCamera(pictures))
        return cameras[-1]

    monkeypatch.setattr(command, "open_camera", open_camera)
    out = tmp_path / "camera.yaml"
    assert main(["calibrate", *words, "--out", str(out)]) == 0
    assert opened == [source]
    assert cameras[0].closed
    assert read_camera_info(out).matrix[0] == pytest.approx(288, rel=0.01)
    assert "Missing: " in capsys.readouterr().out


def test_what_is_no_source_is_one_line(tmp_path, capsys):
    assert main(["calibrate", str(tmp_path / "no_film.mkv"), "--out", str(tmp_path / "c.yaml")]) == 2
    assert main(["calibrate", "--live", "--out", str(tmp_path / "c.yaml")]) == 2
    said = capsys.readouterr().err
    assert "is no camera and no file" in said
    assert "camera.source is empty" in said
