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
from companion.core.camera_model import model_of
from companion.errors import LandslopeError
from drivers.files.camera_info import read_camera_info
from landing.vision.camera import CameraModel


def distance_px(path) -> float:
    """Largest distance between the true lens's pixels and the calibrated one's, over the picture, turn allowed."""
    info = read_camera_info(path)
    found = model_of(info, path)
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
    covariance = np.array(info.covariance).reshape(9, 9)
    focal_std, centre_std = np.sqrt(np.diag(covariance)[:2]), np.sqrt(np.diag(covariance)[2:4])
    found, true = np.array(info.matrix).reshape(3, 3), board_support.MATRIX
    assert (np.abs(np.diag(found - true)[:2]) < 4 * focal_std).all()
    assert (np.abs((found - true)[:2, 2]) < 4 * centre_std).all()
    # not larger than what calibrate itself lets pass
    assert (focal_std < 0.01 * true[0, 0]).all()
    shown = cv2.imread(str(picture))
    assert shown.shape[1] == 960
    assert len(np.unique(shown.reshape(-1, 3), axis=0)) > 20


def test_charuco_pictures_give_the_camera_back(charuco_film, tmp_path, capsys):
    out = tmp_path / "camera.yaml"
    assert main(["calibrate", str(charuco_film), "--out", str(out)]) == 0
    check(out, tmp_path / "camera.png", most_px=0.5)
    assert "reprojection error 0." in capsys.readouterr().out


def test_the_equidistant_model_fits_the_same_pictures(charuco_film, tmp_path, capsys):
    out = tmp_path / "camera.yaml"
    assert main(["calibrate", str(charuco_film), "--fisheye", "--out", str(out)]) == 0
    assert read_camera_info(out).distortion_model == "equidistant"
    assert "(equidistant)" in capsys.readouterr().out
    assert distance_px(out) < 1.0


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
    found = collect_views([(f"p{k}", picture) for k in range(5)], finder, CalibrationOptions())
    assert (len(found.views), found.pictures) == (1, 5)
    assert found.size == (board_support.WIDTH, board_support.HEIGHT)
    assert found.left_out == [(f"p{k}", "as another") for k in range(1, 5)]


def test_too_few_views_are_refused(charuco_views):
    found, finder = charuco_views
    views, count, size = found.views, found.pictures, found.size
    with pytest.raises(LandslopeError, match=r"only 5 different views .* 12 are needed: film it longer"):
        calibrate(views[:5], count, size, finder, CalibrationOptions())


def test_poor_coverage_is_refused():
    camera, finder = BoardCamera(Board()), BoardFinder(Board())
    random = np.random.default_rng(2)
    pictures = [
        (k, camera.take(tuple(random.uniform(-0.5, 0.5, 3)), (-90.0 + 3 * k, -60.0, 420.0)))
        for k in range(14)
    ]
    found = collect_views(pictures, finder, CalibrationOptions(min_move=0.005))
    with pytest.raises(LandslopeError, match="bring it into every corner"):
        calibrate(found.views, found.pictures, found.size, finder, CalibrationOptions())


def test_views_without_tilt_are_refused():
    camera, finder = BoardCamera(Board()), BoardFinder(Board())
    places = [(x, y, 300.0) for x in (-90.0, -30.0, 30.0, 90.0) for y in (-60.0, 0.0, 60.0)]
    pictures = [(k, camera.take((0.0, 0.0, 0.0), place)) for k, place in enumerate(places)]
    found = collect_views(pictures, finder, CalibrationOptions())
    with pytest.raises(LandslopeError, match="0 views are tilted"):
        calibrate(found.views, found.pictures, found.size, finder, CalibrationOptions())


def test_wrong_squares_give_no_calibration(charuco_film, tmp_path, capsys):
    out = tmp_path / "camera.yaml"
    assert main(["calibrate", str(charuco_film), "--squares", "6x5", "--out", str(out)]) == 2
    assert main(["calibrate", str(charuco_film), "--dictionary", "6X6_250", "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert "no board in any of 18 pictures" in said
    assert not out.exists()


def test_views_that_do_not_fit_the_rest_are_left_out(charuco_views):
    found, finder = charuco_views
    views, count, size = found.views, found.pictures, found.size
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
    found, finder = charuco_views
    views, count, size = found.views, found.pictures, found.size
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


def test_pictures_of_another_size_are_left_out_and_named(charuco_film, tmp_path, capsys):
    """The first one too, by its name: most pictures decide which size is calibrated."""
    for file in charuco_film.iterdir():
        (tmp_path / file.name).symlink_to(file)
    cv2.imwrite(str(tmp_path / "a_first.png"), np.full((301, 401), 128, np.uint8))
    (tmp_path / "broken.png").write_bytes(b"no picture")
    cv2.imwrite(str(tmp_path / "wall.png"), np.full((300, 400), 128, np.uint8))
    out = tmp_path / "camera.yaml"
    assert main(["calibrate", str(tmp_path), "--out", str(out), "--picture", str(tmp_path / "look.txt")]) == 0
    said = capsys.readouterr().out
    assert "19 pictures of 400 x 300, 18 different views" in said
    assert "3 pictures left out:" in said
    assert "1 401 x 301, not 400 x 300: a_first.png" in said
    assert "1 cannot be decoded: broken.png" in said
    assert "1 no board found: wall.png" in said
    check(out, tmp_path / "look.txt", most_px=0.5)


def oriented(jpeg: bytes, orientation: int) -> bytes:
    """A JPEG with the EXIF orientation that a phone writes when it is held turned."""
    tags = b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01" + struct.pack(">H", orientation) + bytes(6)
    part = b"Exif\0\0" + tags
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(part) + 2) + part + jpeg[2:]


def test_orientation_tags_do_not_turn_the_sensor(charuco_film, tmp_path):
    for k, file in enumerate(sorted(charuco_film.iterdir())):
        jpeg = cv2.imencode(
            ".jpg", cv2.imread(str(file), cv2.IMREAD_GRAYSCALE), [cv2.IMWRITE_JPEG_QUALITY, 95]
        )[1]
        (tmp_path / f"{file.stem}.jpg").write_bytes(oriented(jpeg.tobytes(), (1, 3, 6)[k % 3]))
    turned = cv2.imread(str(tmp_path / "view002.jpg"), cv2.IMREAD_GRAYSCALE)
    assert turned.shape == (400, 300), "the tag is one that OpenCV follows"
    out = tmp_path / "camera.yaml"
    assert main(["calibrate", str(tmp_path), "--out", str(out)]) == 0
    check(out, tmp_path / "camera.png", most_px=0.6)


def test_a_recorded_flight_is_a_film_of_the_board(charuco_film, tmp_path):
    flight = tmp_path / "flight"
    flight.mkdir()
    writer = cv2.VideoWriter(
        str(flight / "camera.mkv"), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"FFV1"), 10, (400, 300), False
    )
    for file in sorted(charuco_film.iterdir()):
        writer.write(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE))
    writer.release()
    (flight / "frames.csv").write_text("frame,host_time_us\n")
    out = tmp_path / "camera.yaml"
    assert main(["calibrate", str(flight), "--out", str(out)]) == 0
    check(out, tmp_path / "camera.png", most_px=0.5)


@pytest.mark.parametrize("chessboard", [[], ["--chessboard"]])
def test_the_printed_board_has_its_size_and_is_found(tmp_path, chessboard):
    path = tmp_path / "board.png"
    words = ["--squares", "7x5", "--square-mm", "20", "--marker-mm", "15", "--dpi", "254"]
    assert main(["calibrate", "--print-board", str(path), *words, *chessboard]) == 0
    data = path.read_bytes()
    per_metre = struct.unpack(">II", data[data.index(b"pHYs") + 4 :][:8])
    assert per_metre == (10000, 10000)
    page = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert page.shape == (2100, 2970)
    board = Board("chessboard" if chessboard else "charuco", 7, 5, 20.0, 15.0)
    page = page[500:-500, 700:-700]  # the board alone, which is found faster
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
        (["--square-mm", "40"], "340 x 264 mm, A4 297 x 210"),
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
