"""A calibration to look at: where corners were seen, how far off each was, how the lens bends straight lines."""

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.calibration.calibration import COVERAGE_COLUMNS, COVERAGE_ROWS, Calibration, cells_seen
from companion.core.camera_model import model_of

WIDTH = 960
MAGNIFY = 40
"""Errors are drawn this much longer than they are."""

WHITE, GREY, RED, BLUE, INK, GREEN = (
    (255, 255, 255),
    (215, 215, 215),
    (60, 60, 220),
    (200, 120, 40),
    (40, 40, 40),
    (225, 245, 225),
)
"""Blue, green, red as OpenCV has them."""


def picture_of(calibration: Calibration) -> NDArray[np.uint8]:
    """A picture of (height, 960, 3) uint8, BGR."""
    info = calibration.info
    scale = WIDTH / info.width
    height = round(info.height * scale)
    foot = 70
    page = np.full((height + foot, WIDTH, 3), 255, np.uint8)
    seen = cells_seen(calibration.views, (info.width, info.height))
    for row in range(COVERAGE_ROWS):
        for column in range(COVERAGE_COLUMNS):
            a = (round(column * WIDTH / COVERAGE_COLUMNS), round(row * height / COVERAGE_ROWS))
            b = (round((column + 1) * WIDTH / COVERAGE_COLUMNS), round((row + 1) * height / COVERAGE_ROWS))
            cv2.rectangle(page, a, b, GREEN if seen[row, column] else WHITE, -1)
            cv2.rectangle(page, a, b, GREY, 1)
    _lens_lines(page, calibration, scale)
    for view, residual in zip(calibration.views, calibration.residuals, strict=True):
        for corner, error in zip(view.image_px * scale, residual * scale * MAGNIFY, strict=True):
            start = (round(float(corner[0])), round(float(corner[1])))
            end = (round(float(corner[0] + error[0])), round(float(corner[1] + error[1])))
            cv2.line(page, start, end, RED, 1, cv2.LINE_AA)
            cv2.circle(page, start, 2, INK, -1, cv2.LINE_AA)
    m = info.matrix
    words = (
        f"{len(calibration.views)} views, {calibration.left_out} left out; RMS {calibration.rms_px:.3f} px "
        f"(red: errors x {MAGNIFY}); coverage {calibration.coverage:.0%} (green)",
        f"{info.width} x {info.height}: fx {m[0]:.2f} fy {m[4]:.2f} (+- {calibration.focal_std:.2%}) "
        f"cx {m[2]:.2f} cy {m[5]:.2f}; blue: straight lines as the lens shows them",
    )
    for k, line in enumerate(words):
        cv2.putText(
            page, line, (12, height + 28 + 26 * k), cv2.FONT_HERSHEY_SIMPLEX, 0.55, INK, 1, cv2.LINE_AA
        )
    return page


def _lens_lines(page: NDArray[np.uint8], calibration: Calibration, scale: float) -> None:
    """Lines that are straight in the world, as the lens bends them."""
    info = calibration.info
    camera = model_of(info, "the result")
    border = np.array([[0, 0], [info.width - 1, info.height - 1]], np.float64)
    (left, top), (right, bottom) = camera.undistort(border)
    along = np.linspace(0, 1, 60)
    for share in np.linspace(0, 1, 9):
        for x, y in (
            (left + along * (right - left), np.full_like(along, top + share * (bottom - top))),
            (np.full_like(along, left + share * (right - left)), top + along * (bottom - top)),
        ):
            line = camera.project(np.stack((x, y), axis=1))
            points = np.rint(line.reshape(-1, 1, 2) * scale).astype(np.int32)
            cv2.polylines(page, [points], False, BLUE, 1, cv2.LINE_AA)
