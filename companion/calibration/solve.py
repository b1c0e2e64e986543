"""Intrinsics that fit views of a board best: pinhole by OpenCV's calibrateCamera, wide lenses by cv2.fisheye."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.calibration.board import View
from companion.errors import LandslopeError
from drivers.files.camera_info import EQUIDISTANT

Array = NDArray[np.float64]
Lens = Literal["plumb_bob", "equidistant"]

K3_PLACE = 8
"""Of k3 among the intrinsics' standard deviations: fx, fy, cx, cy, k1, k2, p1, p2, k3."""

STARTS_DEG = (120.0, 90.0, 150.0, 180.0)
"""Fields of view across the picture that a wide lens is first taken for."""
INTRINSICS = 8
"""Of an equidistant lens: fx, fy, cx, cy, k1 to k4."""
_FLAGS = cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW | cv2.CALIB_USE_INTRINSIC_GUESS
_CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-9)


@dataclass(frozen=True, slots=True)
class Solution:
    """RMS in px, camera matrix (3, 3), distortion, std of fx, fy, ..., RMS, tilt, residuals (n, 2) px a view."""

    rms: float
    matrix: Array
    distortion: Array
    std: Array
    view_rms: Array
    tilts_deg: Array
    residuals: tuple[Array, ...]
    covariance: Array
    """Of fx, fy, cx, cy and the distortion (4 + k, 4 + k), as ``_covariance`` has it."""

    @property
    def focal_std(self) -> float:
        """Largest relative standard deviation of the two focal lengths."""
        return float(max(self.std[0] / self.matrix[0, 0], self.std[1] / self.matrix[1, 1]))


def solve(views: Sequence[View], size: tuple[int, int], lens: Lens, sure_std: float) -> Solution:
    """The solution with the fewest terms: k3 only where it is ``sure_std`` sigma from zero.

    Beyond the last corners it runs wild. Raises LandslopeError where the views have no solution.
    """
    if lens == EQUIDISTANT:
        return _wide(views, size)
    full = _pinhole(views, size, 0)
    k3, k3_std = full.distortion[4], full.std[K3_PLACE]
    if abs(k3) > sure_std * k3_std:
        return full
    return _pinhole(views, size, cv2.CALIB_FIX_K3)


def _pinhole(views: Sequence[View], size: tuple[int, int], flags: int) -> Solution:
    rms, matrix, distortion, turns, moves, std, _, view_rms = cv2.calibrateCameraExtended(
        [view.board_mm for view in views],
        [view.image_px for view in views],
        size,
        np.eye(3),
        np.zeros(5),
        flags=flags,
    )
    residuals: list[Array] = []
    parts: list[tuple[Array, Array]] = []
    count = 4 + len(np.ravel(distortion)[:5])
    for view, turn, move in zip(views, turns, moves, strict=True):
        there, jacobian = cv2.projectPoints(view.board_mm, turn, move, matrix, distortion)
        residuals.append(view.image_px.astype(np.float64) - np.asarray(there, np.float64).reshape(-1, 2))
        own = np.array(jacobian[:, 6 : 6 + count], np.float64)
        # a term that was not solved for has no error of its own
        if flags & cv2.CALIB_FIX_K3:
            own[:, K3_PLACE:] = 0.0
        parts.append((own, np.asarray(jacobian[:, :6], np.float64)))
    return Solution(
        float(rms),
        np.asarray(matrix, np.float64),
        np.asarray(distortion, np.float64).ravel()[:5],
        np.asarray(std, np.float64).ravel(),
        np.asarray(view_rms, np.float64).ravel(),
        np.array([_tilt_deg(turn) for turn in turns]),
        tuple(residuals),
        _covariance(parts, residuals),
    )


def _covariance(parts: Sequence[tuple[Array, Array]], residuals: Sequence[Array]) -> Array:
    """Covariance of the intrinsics from the views as clusters, every view's pose eliminated (Schur complement).

    The errors of one view's corners are alike (board not flat, blur, a lens that the model does not describe), so that
    the views and not the corners are what is independent: A^-1 (sum of g g^T) A^-1 with g the views' scores (the
    cluster-robust covariance of Liang and Zeger, 1986). ``parts``: derivatives of a view's corners by the intrinsics
    and by its pose.
    """
    size = parts[0][0].shape[1]
    information, scores = np.zeros((size, size)), []
    for (own, pose), residual in zip(parts, residuals, strict=True):
        left = own - pose @ np.linalg.lstsq(pose, own, rcond=None)[0]
        information += left.T @ left
        scores.append(left.T @ residual.ravel())
    scale = np.sqrt(np.maximum(np.diag(information), 0.0))
    scale = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0)
    inverse = np.linalg.pinv(information * scale[:, None] * scale, rcond=1e-12) * scale[:, None] * scale
    both = np.array(scores) @ inverse
    # as many degrees of freedom are lost as there are intrinsics, two of which a view determines at most
    return np.asarray(both.T @ both * (len(parts) / max(1.0, len(parts) - size / 2)), np.float64)


def _wide(views: Sequence[View], size: tuple[int, int]) -> Solution:
    """cv2.fisheye.calibrate from several first guesses: it finds no way from one that is far off."""
    board = [view.board_mm.astype(np.float64).reshape(1, -1, 3) for view in views]
    image = [view.image_px.astype(np.float64).reshape(1, -1, 2) for view in views]
    for across_deg in STARTS_DEG:
        focal = size[0] / math.radians(across_deg)
        start = np.array(((focal, 0, (size[0] - 1) / 2), (0, focal, (size[1] - 1) / 2), (0, 0, 1)))
        try:
            rms, matrix, distortion, turns, moves = cv2.fisheye.calibrate(
                board, image, size, start, np.zeros(4), flags=_FLAGS, criteria=_CRITERIA
            )
        except cv2.error:
            continue  # OpenCV's assertion that the first guess is near enough
        if math.isfinite(rms):
            found = np.asarray(matrix, np.float64)
            return _wide_solution(views, board, float(rms), found, np.ravel(distortion), turns, moves)
    raise LandslopeError(
        "the views have no solution for a wide lens: is it one? Without --fisheye a pinhole is fitted"
    )


def _wide_solution(
    views: Sequence[View],
    board: list[Array],
    rms: float,
    matrix: Array,
    distortion: Array,
    turns: Any,
    moves: Any,
) -> Solution:
    """The residuals, and the intrinsics' standard deviations with every view's pose eliminated (Schur complement)."""
    residuals: list[Array] = []
    parts: list[tuple[Array, Array]] = []
    information = np.zeros((INTRINSICS, INTRINSICS))
    for view, points, turn, move in zip(views, board, turns, moves, strict=True):
        there, jacobian = cv2.fisheye.projectPoints(points, turn, move, matrix, distortion)
        residuals.append(view.image_px.astype(np.float64) - there.reshape(-1, 2))
        own, pose = jacobian[:, :INTRINSICS], jacobian[:, INTRINSICS : INTRINSICS + 6]
        parts.append((np.asarray(own, np.float64), np.asarray(pose, np.float64)))
        both = own.T @ pose
        information += own.T @ own - both @ np.linalg.pinv(pose.T @ pose) @ both.T
    squares = sum(float((r**2).sum()) for r in residuals)
    count = sum(r.size for r in residuals)
    variance = squares / max(1, count - INTRINSICS - 6 * len(views))
    std = np.sqrt(np.maximum(np.diag(np.linalg.pinv(information)) * variance, 0.0))
    view_rms = np.array([math.sqrt(float((r**2).sum(axis=1).mean())) for r in residuals])
    tilts = np.array([_tilt_deg(np.asarray(turn).reshape(3, 1)) for turn in turns])
    return Solution(
        rms,
        np.asarray(matrix),
        distortion,
        std,
        view_rms,
        tilts,
        tuple(residuals),
        _covariance(parts, residuals),
    )


def _tilt_deg(turn: NDArray[Any]) -> float:
    """Angle between the board's normal and the optical axis, of the board's rotation vector."""
    return math.degrees(math.acos(min(1.0, abs(float(cv2.Rodrigues(turn)[0][2, 2])))))
