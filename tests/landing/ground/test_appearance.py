"""Ground that looks different from what has been measured, where it comes into view."""

import numpy as np
import pytest
from border_support import CAMERA, FRAMES, KEPT_PX, RATE_HZ, TURNS, pictures

from landing.decision.decision import against_flat
from landing.estimate import SurfaceEstimate
from landing.ground.appearance import AppearanceChange
from landing.ground.border import SIDES
from landing.observation import Observation
from landing.options import Options
from landing.pipeline import SurfacePipeline
from landing.reasons import Code, Reason
from landing.vision.camera import CameraModel

OPTIONS = Options()
ALL = {0, 1, 2, 3}
NUMBER = {"top": 0, "bottom": 1, "left": 2, "right": 3}


def shaded(image: np.ndarray, side: str, depth: int, factor: float) -> np.ndarray:
    """The picture with another brightness along a side."""
    axis, far = SIDES[NUMBER[side]]
    out = image.astype(np.float64)
    lines = out if axis == 1 else out.T
    lines[(len(lines) - depth if far else 0) :][:depth] *= factor
    return np.clip(np.rint(out), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("side", TURNS)
@pytest.mark.parametrize("factor", [0.4, 1.9])
def test_another_brightness_is_reported_at_its_side(side: str, factor: float):
    detector = AppearanceChange(OPTIONS.estimator, CAMERA, KEPT_PX)
    *usual, last = pictures(None, 0)
    for image in usual:
        assert detector.step(image, ALL) == set()
    assert detector.step(shaded(last, side, 8, factor), ALL) == {NUMBER[side]}


def test_a_flight_that_begins_near_an_edge_is_reported_of_it():
    """Ten frames are enough: what is usual need not be learnt for seconds first."""
    detector = AppearanceChange(OPTIONS.estimator, CAMERA, KEPT_PX)
    *usual, last = pictures(None, 0)[:11]
    for image in usual:
        assert detector.step(image, ALL) == set()
    assert detector.step(shaded(last, "top", 8, 0.75), ALL) == {NUMBER["top"]}


def test_a_change_is_in_doubt_until_the_view_has_moved_by_a_baseline():
    detector = AppearanceChange(OPTIONS.estimator, CAMERA, KEPT_PX)
    *usual, last = pictures(None, 0)
    for image in usual:
        detector.step(image, ALL, 5.0)
    assert detector.step(shaded(last, "top", 8, 0.4), ALL, 5.0) == {NUMBER["top"]}
    assert detector.step(last, ALL, 5.0) == {NUMBER["top"]}, "no longer unusual, and not measured either"
    assert detector.step(last, set(), 0.0) == {NUMBER["top"]}, "hovering measures nothing"
    assert detector.step(last, ALL, KEPT_PX - 5.0) == set()


def test_vignetting_is_usual_and_so_are_changes_of_the_light():
    detector = AppearanceChange(OPTIONS.estimator, CAMERA, KEPT_PX)
    y, x = np.mgrid[: CAMERA.height, : CAMERA.width]
    lens = 1 - 0.6 * np.hypot((x - 120) / 120, (y - 90) / 90) / np.sqrt(2)
    for k, image in enumerate(pictures(None, 0)):
        seen = image * lens * (0.7 + 0.3 * np.sin(k / 3))
        assert detector.step(np.clip(np.rint(seen), 0, 255).astype(np.uint8), ALL) == set()


def test_what_stays_becomes_usual():
    detector = AppearanceChange(OPTIONS.estimator, CAMERA, KEPT_PX)
    first = pictures(None, 0)[0]
    detector.step(first, ALL)
    edge = shaded(first, "top", 8, 0.4)
    reported = [bool(detector.step(edge, ALL)) for _ in range(200)]
    assert reported[0]
    assert not reported[-1]


def test_a_small_view_is_left_alone():
    small = CameraModel.from_focal(80, 60, 60.0)
    assert (
        AppearanceChange(OPTIONS.estimator, small, KEPT_PX).step(np.zeros((60, 80), np.uint8), ALL) == set()
    )


def test_only_where_ground_comes_in_it_speaks_against_flat():
    flat = {}
    for side in ("right", "left"):
        pipeline = SurfacePipeline(CAMERA, OPTIONS)
        for k, image in enumerate(pictures(None, 0)):  # the ground comes in at the right
            seen = shaded(image, side, 8, 0.4) if k == FRAMES - 1 else image
            estimate = pipeline.step(Observation(k, k / RATE_HZ, seen, np.eye(3), 1e-5))
        flat[side] = estimate.flat, estimate.appearance_change
    assert flat == {"right": (False, True), "left": (True, False)}


def test_the_reason_is_said():
    fine = SurfaceEstimate(
        0, 0.0, "ok", "map", inclination_deg=1.0, inclination_std_deg=0.2, roughness=0.001, roughness_std=0.001,
        coverage=0.9, appearance_change=True,
    )  # fmt: skip
    (reason,) = against_flat(fine, OPTIONS.decision)
    assert reason == Reason(Code.APPEARANCE_CHANGE)
