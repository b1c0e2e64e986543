"""Calibration boards: drawn for the printer, and found in pictures."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.errors import LandslopeError
from landing.options import Limits

Array = NDArray[np.float64]
MM_PER_INCH = 25.4
RULER_MM = 100
FOOT_MM = 14.0
"""Room below the board for the ruler and the words."""

DICTIONARIES = ("4X4_50", "4X4_100", "4X4_250", "5X5_100", "5X5_250", "6X6_250")


@dataclass(frozen=True, slots=True)
class Board:
    """A board by its squares; ``marker_mm`` and ``dictionary`` matter to ChArUco boards alone."""

    kind: Literal["charuco", "chessboard"] = "charuco"
    columns: Annotated[int, Limits(3, 40, "", "squares from left to right")] = 8
    rows: Annotated[int, Limits(3, 40, "", "squares from top to bottom")] = 6
    square_mm: Annotated[float, Limits(1, 1000, "mm", "side of a square")] = 30.0
    marker_mm: Annotated[float, Limits(0.5, 900, "mm", "side of a marker")] = 22.0
    dictionary: str = "4X4_50"

    def __post_init__(self) -> None:
        if self.columns < 3 or self.rows < 3:
            raise LandslopeError(
                f"a board of {self.columns} x {self.rows} squares is too small: at least 3 x 3"
            )
        if self.kind == "charuco" and not 0 < self.marker_mm < self.square_mm:
            raise LandslopeError(
                f"markers of {self.marker_mm:g} mm do not fit squares of {self.square_mm:g} mm: choose smaller ones"
            )
        if self.dictionary not in DICTIONARIES:
            raise LandslopeError(f"dictionary '{self.dictionary}' is not known: {', '.join(DICTIONARIES)}")

    @property
    def text(self) -> str:
        """The board in words, as they are printed on it."""
        text = f"{self.kind} {self.columns} x {self.rows} squares of {self.square_mm:g} mm"
        return f"{text}, markers {self.marker_mm:g} mm {self.dictionary}" if self.kind == "charuco" else text

    def charuco(self) -> cv2.aruco.CharucoBoard:
        """OpenCV's description; lengths in mm."""
        names = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{self.dictionary}"))
        needed = self.columns * self.rows // 2
        if len(names.bytesList) < needed:
            raise LandslopeError(
                f"dictionary {self.dictionary} has {len(names.bytesList)} markers, the board needs {needed}: change it"
            )
        return cv2.aruco.CharucoBoard((self.columns, self.rows), self.square_mm, self.marker_mm, names)


def draw_board(board: Board, dpi: float, margin_mm: float = 10.0) -> NDArray[np.uint8]:
    """The board as it is to be printed at ``dpi``: a white margin around, a ruler and its description below."""
    px_per_mm = dpi / MM_PER_INCH
    side = round(board.square_mm * px_per_mm)
    if side < 8:
        raise LandslopeError(
            f"a square would be {side} pixels wide at {dpi:g} dpi: choose a higher resolution"
        )
    width, height = board.columns * side, board.rows * side
    if board.kind == "charuco":
        squares = board.charuco().generateImage((width, height), marginSize=0)
    else:
        dark = (np.add.outer(np.arange(board.rows), np.arange(board.columns)) % 2 == 0).astype(np.uint8)
        squares = np.kron(255 * (1 - dark), np.ones((side, side), np.uint8)).astype(np.uint8)
    margin, foot = round(margin_mm * px_per_mm), round(FOOT_MM * px_per_mm)
    page = np.full((height + margin + max(margin, foot), width + 2 * margin), 255, np.uint8)
    page[margin : margin + height, margin : margin + width] = squares
    _write_foot(page, board, (margin, margin + height + foot // 2), px_per_mm)
    return page


@dataclass(frozen=True, slots=True)
class View:
    """The board in picture ``number``: corners on the board (n, 3) mm and in the image (n, 2) px, by ``ids`` (n,)."""

    number: int
    board_mm: NDArray[np.float32]
    image_px: NDArray[np.float32]
    ids: NDArray[np.intp]


class BoardFinder:
    """Finds one kind of board in grey pictures."""

    MIN_CORNERS = 8
    """Corners that a view must have, of a board seen in part."""

    def __init__(self, board: Board) -> None:
        self.board = board
        self._detector = cv2.aruco.CharucoDetector(board.charuco()) if board.kind == "charuco" else None
        self.foreign_markers = 0

    def find(self, number: int, image: NDArray[np.uint8]) -> View | None:
        """The board in a picture, or None."""
        return self._charuco(number, image) if self._detector is not None else self._chessboard(number, image)

    def _charuco(self, number: int, image: NDArray[np.uint8]) -> View | None:
        assert self._detector is not None
        corners, ids, _, marker_ids = self._detector.detectBoard(image)
        if marker_ids is not None:
            own = self.board.columns * self.board.rows // 2
            self.foreign_markers += int((np.asarray(marker_ids) >= own).sum())
        if ids is None or len(ids) < self.MIN_CORNERS:
            return None
        places = np.asarray(ids, np.intp).ravel()
        points = np.asarray(self.board.charuco().getChessboardCorners(), np.float32)[places]
        if _on_a_line(points):
            return None
        return View(number, points, np.asarray(corners, np.float32).reshape(-1, 2), places)

    def _chessboard(self, number: int, image: NDArray[np.uint8]) -> View | None:
        size = (self.board.columns - 1, self.board.rows - 1)
        flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
        found, corners = cv2.findChessboardCornersSB(image, size, flags=flags)
        if not found:
            return None
        across, down = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
        points = (
            np.stack((across.ravel(), down.ravel(), np.zeros(across.size)), axis=1) * self.board.square_mm
        )
        image_px = np.asarray(corners, np.float32).reshape(-1, 2)
        return View(number, points.astype(np.float32), image_px, np.arange(len(points)))


def _on_a_line(points: NDArray[np.float32]) -> bool:
    """Whether corners of the board lie in one row or column, which calibrates nothing."""
    return len(np.unique(points[:, 0])) < 2 or len(np.unique(points[:, 1])) < 2


def _write_foot(page: NDArray[np.uint8], board: Board, start: tuple[int, int], px_per_mm: float) -> None:
    x, y = start
    length = round(min(RULER_MM, board.columns * board.square_mm) * px_per_mm)
    thick = max(1, round(0.3 * px_per_mm))
    tick = round(1.5 * px_per_mm)
    cv2.line(page, (x, y), (x + length, y), 0, thick)
    for end in (x, x + length):
        cv2.line(page, (end, y - tick), (end, y + tick), 0, thick)
    scale = max(0.3, px_per_mm / 12)
    words = f"{length / px_per_mm:.0f} mm. landslope: {board.text}; print at 100 %"
    room = page.shape[1] - 2 * x
    wide = cv2.getTextSize(words, cv2.FONT_HERSHEY_SIMPLEX, scale, thick)[0][0]
    scale = scale * min(1.0, room / wide)
    cv2.putText(
        page,
        words,
        (x, y + math.ceil(4.5 * px_per_mm)),
        cv2.FONT_HERSHEY_SIMPLEX,
        scale,
        0,
        max(1, thick // 2),
    )
