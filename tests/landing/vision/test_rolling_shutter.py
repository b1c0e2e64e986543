"""Places of tracks at their frame's time, against points followed exactly through each row's own moment."""

import cv2
import numpy as np
import pytest

from landing.options import TrackingOptions
from landing.rotations import exp_so3
from landing.vision.camera import CameraModel
from landing.vision.homography import Warp, apply, towards
from landing.vision.rolling_shutter import TURN_STD, Motion, Rows
from landing.vision.tracking import FeatureTracker

FOCAL_PX = 256.0
TURN = np.array((0.3, -0.5, 0.15))
MOTION = Motion(np.array((0.4, -0.7, 0.3)), np.array((0.2, -0.1, 1.0)))


def rolled(camera: CameraModel, points: np.ndarray, turn: np.ndarray = TURN) -> np.ndarray:
    """Where points (n, 2) of the middle row's time are in the picture; the row that sees each is iterated for."""
    assert camera.readout_s is not None
    p = np.column_stack((points, np.ones(len(points))))
    seen = points
    for _ in range(20):
        dt = (camera.project(seen)[:, 1] / (camera.height - 1) - 0.5) * camera.readout_s
        moved = np.array(
            [
                exp_so3(-turn * t) @ (q - MOTION.omega * t * (MOTION.normal @ q))
                for q, t in zip(p, dt, strict=True)
            ]
        )
        seen = moved[:, :2] / moved[:, 2:]
    return seen


def rows_of(camera: CameraModel, picture: np.ndarray) -> Rows:
    tracker = FeatureTracker(camera, TrackingOptions(max_features=len(picture)))
    tracker.frame = 0
    tracker.alive[:] = True
    tracker.history[0] = picture
    tracker.pixel_history[0] = camera.project(picture)
    return Rows(camera, tracker)


@pytest.mark.parametrize("readout_s", [0.018, -0.018])
def test_points_are_where_they_were_at_the_middle_rows_time(readout_s: float):
    camera = CameraModel.from_focal(320, 240, FOCAL_PX, readout_s=readout_s)
    points = np.random.default_rng(1).uniform((-0.5, -0.4), (0.5, 0.4), (150, 2))
    picture = rolled(camera, points)
    rows = rows_of(camera, picture)
    rows.step(TURN, MOTION)
    assert np.abs(picture - points).max() * FOCAL_PX > 1.5
    assert np.abs(rows.places(0) - points).max() * FOCAL_PX < 0.02


def test_without_a_motion_the_rotation_alone_is_taken_out_and_the_measured_motion_follows():
    camera = CameraModel.from_focal(320, 240, FOCAL_PX, readout_s=0.018)
    points = np.random.default_rng(2).uniform((-0.5, -0.4), (0.5, 0.4), (50, 2))
    rows = rows_of(camera, rolled(camera, points))
    rows.step(TURN, None)
    assert np.abs(rows.places(0) - points).max() * FOCAL_PX > 0.5
    rows.saw(MOTION)
    assert np.abs(rows.places(0) - points).max() * FOCAL_PX < 0.02


def test_each_error_of_the_motion_moves_the_places_as_another_motion_does():
    camera = CameraModel.from_focal(320, 240, FOCAL_PX, readout_s=0.018)
    points = np.random.default_rng(5).uniform((-0.5, -0.4), (0.5, 0.4), (40, 2))
    std = np.array((0.02, 0.03, 0.01))
    doubted = Motion(MOTION.omega, MOTION.normal, std)
    rows = rows_of(camera, points)
    rows.step(TURN, doubted)
    errors = rows.errors(0, np.arange(len(points)))
    assert errors is not None
    assert errors.shape == (6, len(points), 2)
    before = rows.places(0).copy()
    for axis in range(3):
        more = np.eye(3)[axis]
        for error, turn, omega, sigma in (
            (errors[axis], TURN + more * 1e-3, MOTION.omega, 1e-3),
            (errors[3 + axis], TURN, MOTION.omega + more * 1e-3, 1e-3),
        ):
            rows.step(turn, Motion(omega, MOTION.normal, std))
            unit = (rows.places(0) - before) / sigma
            # first order in the readout: the places themselves are moved by it once more
            per_sigma = error / (std[axis] if turn is TURN else TURN_STD)
            assert np.abs(unit - per_sigma).max() < 0.03 * np.abs(per_sigma).max() + 1e-5


def test_without_rows_or_motion_there_is_no_error_of_them():
    points = np.random.default_rng(6).uniform(-0.4, 0.4, (20, 2))
    for camera in (
        CameraModel.from_focal(320, 240, FOCAL_PX, readout_s=0.0),
        CameraModel.from_focal(320, 240, FOCAL_PX),
    ):
        rows = rows_of(camera, points)
        rows.step(TURN, MOTION)
        assert rows.errors(0, np.arange(20)) is None
    rows = rows_of(CameraModel.from_focal(320, 240, FOCAL_PX, readout_s=0.018), points)
    rows.step(TURN, None)
    assert rows.errors(0, np.arange(20)) is None


def test_a_global_shutter_leaves_the_places_as_they_are():
    camera = CameraModel.from_focal(320, 240, FOCAL_PX)
    points = np.random.default_rng(3).uniform(-0.4, 0.4, (50, 2))
    rows = rows_of(camera, points)
    rows.step(TURN, MOTION)
    assert rows.ring is rows._tracker.history


@pytest.mark.parametrize("readout_s", [0.018, -0.018])
def test_a_warp_knows_the_moment_of_every_row_in_both_pictures(readout_s: float):
    camera = CameraModel.from_focal(320, 240, FOCAL_PX, readout_s=readout_s)
    points = np.random.default_rng(4).uniform((-0.45, -0.35), (0.45, 0.35), (150, 2))
    old_from_new = exp_so3(np.array((0.01, -0.02, 0.03))) @ towards((0.05, -0.02, 0.01), MOTION.normal)
    new, old = rolled(camera, points), rolled(camera, apply(old_from_new, points), -TURN)
    rows = rows_of(camera, old)
    rows.step(-TURN, MOTION)
    rows._tracker.frame = 1
    rows._tracker.history[1] = new
    rows._tracker.pixel_history[1] = camera.project(new)
    rows.step(TURN, MOTION)
    old, new = camera.project(old), camera.project(new)
    warp, at = Warp(camera), new.astype(np.float32)[:, None]
    there, ignorant = (
        cv2.remap(warp.places(old_from_new, row_moves=moves), at, None, cv2.INTER_LINEAR)[:, 0]
        for moves in (rows.moves_of(1), None)
    )
    assert np.abs(there - old).max() < 0.06
    assert np.abs(ignorant - old).max() > 1.0


def test_a_warp_of_a_global_shutter_has_no_rows():
    camera = CameraModel.from_focal(320, 240, FOCAL_PX)
    rows = rows_of(camera, np.zeros((5, 2)))
    rows.step(TURN, MOTION)
    assert rows.moves_of(0) is None
