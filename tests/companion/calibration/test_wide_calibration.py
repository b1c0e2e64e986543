"""Wide lenses: found again from corners that they see, with an honest uncertainty, and never as a pinhole."""

import cv2
import numpy as np
import pytest

from companion.calibration.board import Board, BoardFinder, View
from companion.calibration.calibration import CalibrationOptions, calibrate
from companion.errors import LandslopeError

SIZE = (640, 480)
MATRIX = np.array(((310.0, 0, 325.0), (0, 309.0, 236.0), (0, 0, 1)))
DISTORTION = np.array((-0.02, 0.01, -0.006, 0.001))
"""About 118 degrees across."""


def views(seed: int, count: int = 30, noise_px: float = 0.15) -> list[View]:
    """Corners of the board as the lens sees them, all over the picture, facing the camera and tilted."""
    random = np.random.default_rng(seed)
    board = Board()
    corners = np.asarray(board.charuco().getChessboardCorners(), np.float64)
    centred = corners - corners.mean(axis=0)
    found = []
    while len(found) < count:
        x, y, z = random.uniform(-260, 260), random.uniform(-180, 180), random.uniform(130, 260)
        turn = np.array((-y / 300, x / 300, 0.0)) + random.uniform(-0.5, 0.5, 3)
        solid = centred @ cv2.Rodrigues(turn)[0].T + (x, y, z)
        ahead = solid[:, 2] > 20
        pixels, _ = cv2.fisheye.projectPoints(
            np.ascontiguousarray(solid[:, None]), np.zeros(3), np.zeros(3), MATRIX, DISTORTION
        )
        pixels = pixels.reshape(-1, 2) + random.normal(0, noise_px, (len(corners), 2))
        seen = ahead & (pixels > 2).all(axis=1) & (pixels < np.array(SIZE) - 3).all(axis=1)
        ids = np.flatnonzero(seen)
        if len(ids) >= 12:
            found.append(
                View(len(found), corners[ids].astype(np.float32), pixels[ids].astype(np.float32), ids)
            )
    return found


def solved(seed: int):
    return calibrate(views(seed), 30, SIZE, BoardFinder(Board()), CalibrationOptions(), "equidistant")


def test_the_lens_comes_back():
    found = solved(1)
    matrix = np.array(found.info.matrix).reshape(3, 3)
    assert found.info.distortion_model == "equidistant"
    assert matrix[0, 0] == pytest.approx(310.0, rel=0.003)
    assert matrix[1, 1] == pytest.approx(309.0, rel=0.003)
    np.testing.assert_allclose(matrix[:2, 2], MATRIX[:2, 2], atol=1.0)
    rays = np.array([[[0.0, 0.0]], [[1.2, 0.3]], [[-0.9, 0.9]], [[0.4, -1.1]]])
    there, true = (
        cv2.fisheye.distortPoints(rays, m, np.array(d)).reshape(-1, 2)
        for m, d in ((matrix, found.info.distortion), (MATRIX, DISTORTION))
    )
    assert np.abs(there - true).max() < 1.0


def test_the_uncertainty_is_that_of_the_scatter():
    found = [solved(seed) for seed in range(2, 7)]
    errors = [abs(one.info.matrix[0] / 310.0 - 1) / one.focal_std for one in found]
    assert 0.1 < np.median(errors) < 2.5
    assert max(errors) < 4.5


def test_a_pinhole_for_a_wide_lens_is_refused_with_the_option():
    with pytest.raises(LandslopeError, match="--fisheye"):
        calibrate(views(1), 30, SIZE, BoardFinder(Board()), CalibrationOptions())


def test_corners_without_sense_are_refused():
    random = np.random.default_rng(1)
    spoilt = [
        View(v.number, v.board_mm, random.uniform(5, 470, v.image_px.shape).astype(np.float32), v.ids)
        for v in views(1, count=12)
    ]
    with pytest.raises(LandslopeError):
        calibrate(spoilt, 12, SIZE, BoardFinder(Board()), CalibrationOptions(), "equidistant")
