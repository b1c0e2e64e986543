"""A camera is found again from pictures of a board that it took, and sets of pictures that cannot tell are refused."""

import struct

import board_support
import cv2
import numpy as np
import pytest
from board_support import BoardCamera, film, tour

from companion.calibration.board import Board, BoardFinder, draw_board
from companion.calibration.calibration import CalibrationOptions, calibrate, collect_views
from companion.cli import main
from companion.errors import LandslopeError
from drivers.files.camera_info import read_camera_info
from landing.vision.camera import CameraModel


@pytest.fixture(scope="module")
def charuco_film(tmp_path_factory):
    folder = tmp_path_factory.mktemp("charuco")
    film(folder, Board(), tour())
    return folder


def distance_px(path) -> float:
    """Largest distance between the true lens's pixels and the calibrated one's, over the picture, turn allowed."""
    info = read_camera_info(path)
    found = CameraModel(
        info.width, info.height, np.array(info.matrix).reshape(3, 3), np.array(info.distortion)
    )
    true = CameraModel(info.width, info.height, board_support.MATRIX, board_support.DISTORTION)
    x, y = np.meshgrid(np.linspace(5, info.width - 6, 12), np.linspace(5, info.height - 6, 9))
    pixels = np.stack((x.ravel(), y.ravel()), axis=1)
    a, b = (np.column_stack((m.undistort(pixels), np.ones(len(pixels)))) for m in (true, found))
    a, b = a / np.linalg.norm(a, axis=1)[:, None], b / np.linalg.norm(b, axis=1)[:, None]
    u, _, vt = np.linalg.svd(a.T @ b)
    turned = b @ (u @ vt).T
    there, here = (found.project(rays[:, :2] / rays[:, 2:]) for rays in (turned, a))
    return float(np.linalg.norm(there - here, axis=1).max())


def check(out, picture, most_px: float) -> None:
    info = read_camera_info(out)
    assert info.matrix[0] == pytest.approx(board_support.MATRIX[0, 0], rel=0.005)
    assert info.matrix[4] == pytest.approx(board_support.MATRIX[1, 1], rel=0.005)
    assert info.matrix[2] == pytest.approx(board_support.MATRIX[0, 2], abs=2.0)
    assert info.matrix[5] == pytest.approx(board_support.MATRIX[1, 2], abs=2.0)
    assert distance_px(out) < most_px
    shown = cv2.imread(str(picture))
    assert shown.shape[1] == 960
    assert len(np.unique(shown.reshape(-1, 3), axis=0)) > 20


def test_charuco_pictures_give_the_camera_back(charuco_film, tmp_path, capsys):
    out = tmp_path / "camera.yaml"
    assert main(["calibrate", str(charuco_film), "--out", str(out)]) == 0
    check(out, tmp_path / "camera.png", most_px=0.5)
    assert "reprojection error 0." in capsys.readouterr().out


def test_chessboard_pictures_give_the_camera_back(tmp_path):
    board = Board("chessboard", 7, 6, 25.0)
    film(tmp_path / "film", board, tour())
    out, picture = tmp_path / "camera.yaml", tmp_path / "look.png"
    words = [
        "--chessboard",
        "--squares",
        "7x6",
        "--square-mm",
        "25",
        "--out",
        str(out),
        "--picture",
        str(picture),
    ]
    assert main(["calibrate", str(tmp_path / "film"), *words]) == 0
    check(
        out, picture, most_px=1.0
    )  # it shows no corner near the picture's edges, being seen whole or not at all


@pytest.fixture(scope="module")
def charuco_views(charuco_film):
    finder = BoardFinder(Board())
    pictures = [
        (k, cv2.imread(str(p), cv2.IMREAD_GRAYSCALE)) for k, p in enumerate(sorted(charuco_film.iterdir()))
    ]
    return collect_views(pictures, finder, CalibrationOptions()), finder


def test_pictures_that_repeat_count_once(charuco_film):
    finder = BoardFinder(Board())
    picture = cv2.imread(str(min(charuco_film.iterdir())), cv2.IMREAD_GRAYSCALE)
    views, count, size = collect_views([(k, picture) for k in range(5)], finder, CalibrationOptions())
    assert (len(views), count, size) == (1, 5, (board_support.WIDTH, board_support.HEIGHT))


def test_too_few_views_are_refused(charuco_views):
    (views, count, size), finder = charuco_views
    with pytest.raises(LandslopeError, match=r"only 5 different views .* 12 are needed: film it longer"):
        calibrate(views[:5], count, size, finder, CalibrationOptions())


def test_poor_coverage_is_refused():
    camera, finder = BoardCamera(Board()), BoardFinder(Board())
    random = np.random.default_rng(2)
    pictures = [
        (k, camera.take(tuple(random.uniform(-0.5, 0.5, 3)), (-90.0 + 3 * k, -60.0, 420.0)))
        for k in range(14)
    ]
    views, count, size = collect_views(pictures, finder, CalibrationOptions(min_move=0.005))
    with pytest.raises(LandslopeError, match="bring it into every corner"):
        calibrate(views, count, size, finder, CalibrationOptions())


def test_views_without_tilt_are_refused():
    camera, finder = BoardCamera(Board()), BoardFinder(Board())
    places = [(x, y, 300.0) for x in (-90.0, -30.0, 30.0, 90.0) for y in (-60.0, 0.0, 60.0)]
    pictures = [(k, camera.take((0.0, 0.0, 0.0), place)) for k, place in enumerate(places)]
    views, count, size = collect_views(pictures, finder, CalibrationOptions())
    with pytest.raises(LandslopeError, match="0 views are tilted"):
        calibrate(views, count, size, finder, CalibrationOptions())


def test_wrong_squares_give_no_calibration(charuco_film, tmp_path, capsys):
    out = tmp_path / "camera.yaml"
    assert main(["calibrate", str(charuco_film), "--squares", "6x5", "--out", str(out)]) == 2
    assert main(["calibrate", str(charuco_film), "--dictionary", "6X6_250", "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert "no board in any of 18 pictures" in said
    assert not out.exists()


def test_views_that_do_not_fit_the_rest_are_left_out(charuco_views):
    (views, count, size), finder = charuco_views
    bent = views[3]
    wave = 6 * np.sin(bent.image_px[:, :1] / 15) * np.ones((1, 2))
    spoilt = [
        *views[:3],
        type(bent)(bent.number, bent.board_mm, (bent.image_px + wave).astype(np.float32), bent.ids),
    ]
    found = calibrate([*spoilt, *views[4:]], count, size, finder, CalibrationOptions())
    assert found.left_out == 1
    assert found.rms_px < 0.3


def test_a_blurred_or_bent_board_is_refused(charuco_views):
    (views, count, size), finder = charuco_views
    random = np.random.default_rng(1)
    noisy = [
        type(v)(
            v.number,
            v.board_mm,
            (v.image_px + random.normal(0, 2, v.image_px.shape)).astype(np.float32),
            v.ids,
        )
        for v in views
    ]
    with pytest.raises(LandslopeError, match=r"reprojection error is .* the limit"):
        calibrate(noisy, count, size, finder, CalibrationOptions())


def test_a_change_of_size_within_a_film_is_refused(charuco_film):
    picture = cv2.imread(str(min(charuco_film.iterdir())), cv2.IMREAD_GRAYSCALE)
    with pytest.raises(LandslopeError, match="one size only"):
        collect_views([(0, picture), (1, picture[:200])], BoardFinder(Board()), CalibrationOptions())


@pytest.mark.parametrize("chessboard", [[], ["--chessboard"]])
def test_the_printed_board_has_its_size_and_is_found(tmp_path, chessboard):
    path = tmp_path / "board.png"
    words = ["--squares", "7x5", "--square-mm", "20", "--marker-mm", "15", "--dpi", "254"]
    assert main(["calibrate", "--print-board", str(path), *words, *chessboard]) == 0
    data = path.read_bytes()
    per_metre = struct.unpack(">II", data[data.index(b"pHYs") + 4 :][:8])
    assert per_metre == (10000, 10000)
    page = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert page.shape[1] == 1400 + 2 * 100
    board = Board("chessboard" if chessboard else "charuco", 7, 5, 20.0, 15.0)
    view = BoardFinder(board).find(0, page)
    assert view is not None
    assert len(view.ids) == 24
    scale = np.linalg.norm(view.image_px[-1] - view.image_px[0]) / np.linalg.norm(
        view.board_mm[-1] - view.board_mm[0]
    )
    assert scale == pytest.approx(10.0, rel=1e-3)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--squares", "eight"], "write it as 8x6"),
        (["--squares", "2x9"], "at least 3 x 3"),
        (["--marker-mm", "31"], "do not fit"),
        (["--dictionary", "ARUCO"], "not known"),
        (["--squares", "12x12"], "the board needs 72"),
        (["--dpi", "3"], "higher resolution"),
    ],
)
def test_boards_that_cannot_be_are_refused(tmp_path, capsys, words, said):
    assert main(["calibrate", "--print-board", str(tmp_path / "board.png"), *words]) == 2
    assert said in capsys.readouterr().err


def test_a_board_seen_on_one_line_is_no_view():
    board = Board()
    page = draw_board(board, 76.2)
    strip = page[: 30 + 2 * 90 - 20]  # the first row of corners and hardly more
    assert BoardFinder(board).find(0, strip) is None
