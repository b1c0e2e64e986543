"""Pictures of a calibration board as a known camera with a known lens would take them."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.calibration.board import Board, draw_board

WIDTH, HEIGHT = 400, 300
MATRIX = np.array(((288.0, 0, 203.0), (0, 286.5, 147.0), (0, 0, 1)))
DISTORTION = np.array((-0.21, 0.07, 0.0008, -0.0006, 0.0))
PX_PER_MM = 3.0
MARGIN_MM = 10.0


class BoardCamera:
    """Takes pictures of one board, anti-aliased, with noise."""

    def __init__(self, board: Board) -> None:
        page = draw_board(board, 25.4 * PX_PER_MM, MARGIN_MM)
        self.page = cv2.copyMakeBorder(page, 200, 200, 200, 200, cv2.BORDER_CONSTANT, value=128)
        self.centre_mm = np.array((board.columns, board.rows)) * board.square_mm / 2
        y, x = np.mgrid[0 : 2 * HEIGHT, 0 : 2 * WIDTH]
        pixels = np.stack((x.ravel(), y.ravel()), axis=1) / 2 - 0.25
        rays = cv2.undistortPoints(pixels.reshape(-1, 1, 2).astype(np.float64), MATRIX, DISTORTION).reshape(
            -1, 2
        )
        self.rays = np.column_stack((rays, np.ones(len(rays))))
        self.random = np.random.default_rng(3)

    def take(
        self, turn: tuple[float, float, float], place_mm: tuple[float, float, float]
    ) -> NDArray[np.uint8]:
        """The board's middle at ``place_mm`` in the camera frame, turned by the rotation vector ``turn``."""
        rotation = cv2.Rodrigues(np.array(turn, np.float64))[0]
        start = np.array(place_mm) - rotation[:, :2] @ self.centre_mm
        on_board = self.rays @ np.linalg.inv(np.column_stack((rotation[:, 0], rotation[:, 1], start))).T
        mm = on_board[:, :2] / on_board[:, 2:]
        px = ((mm + MARGIN_MM) * PX_PER_MM + 200 - 0.5).astype(np.float32).reshape(2 * HEIGHT, 2 * WIDTH, 2)
        large = cv2.remap(
            self.page, px[..., 0], px[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        small = cv2.resize(large, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA).astype(np.float64)
        return (30 + 0.75 * small + self.random.normal(0, 2, small.shape)).clip(0, 255).astype(np.uint8)


def tour() -> list[tuple[tuple[float, float, float], tuple[float, float, float]]]:
    """Poses that a careful user would film: all over the picture, tilted to all sides, near and far."""
    random = np.random.default_rng(8)
    poses = []
    for x in (-110.0, 0.0, 110.0):
        for y in (-75.0, 0.0, 75.0):
            for _ in range(2):
                turn = random.uniform(-0.6, 0.6, 3)
                poses.append((tuple(turn), (x, y, float(random.uniform(260, 420)))))
    return poses


def film(folder: Path, board: Board, poses) -> None:
    """A folder of numbered pictures."""
    camera = BoardCamera(board)
    folder.mkdir(parents=True, exist_ok=True)
    for number, (turn, place) in enumerate(poses):
        cv2.imwrite(str(folder / f"view{number:03d}.png"), camera.take(turn, place))
