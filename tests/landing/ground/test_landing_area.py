"""The ground to land on: measured or not, and how finely."""

import math
from dataclasses import replace

import numpy as np
import pytest

from landing.decision.decision import Decider, against_flat, against_landing
from landing.estimate import SurfaceEstimate, TrackView
from landing.ground.landing_area import LandingArea
from landing.options import DecisionOptions, TrackingOptions
from landing.reasons import Code
from landing.vision.camera import CameraModel, body_from_camera

WIDTH, HEIGHT, FOCAL_PX = 160, 120, 120.0
OPTIONS = DecisionOptions(landing_radius_m=0.4, min_area_measured=0.8, max_patch_m=0.45, hysteresis=0.0)
TRACKING = TrackingOptions(max_features=150, window_px=15)
WINDOW_M = 15 / FOCAL_PX


def camera(roll_deg: float = 0.0, pitch_deg: float = 0.0) -> CameraModel:
    mount = body_from_camera(math.radians(roll_deg), math.radians(pitch_deg), 0.0)
    return CameraModel.from_focal(WIDTH, HEIGHT, FOCAL_PX, mount)


def tracks(keep=lambda x, y: np.ones(len(x), bool), measured=lambda x, y: np.ones(len(x), bool)) -> TrackView:
    """Tracks in every tenth pixel, those of ``keep``; heights known where ``measured``."""
    x, y = (v.ravel() for v in np.meshgrid(np.arange(10.0, WIDTH - 9, 10), np.arange(10.0, HEIGHT - 9, 10)))
    kept = keep(x, y)
    x, y = x[kept], y[kept]
    px = np.column_stack((x, y))
    return TrackView(px, px, np.ones(len(x), bool), np.where(measured(x, y), 0.0, np.nan))


FLAT = SurfaceEstimate(
    0,
    0.0,
    "ok",
    "map",
    slope_x_deg=0.0,
    slope_y_deg=0.0,
    roll_deg=0.0,
    pitch_deg=0.0,
    inclination_deg=1.0,
    inclination_std_deg=0.2,
    roughness=0.001,
    roughness_std=0.001,
    coverage=1.0,
    height_m=2.0,
    height_std_m=0.1,
    tracks=tracks(),
)


def look(estimate: SurfaceEstimate, model: CameraModel | None = None):
    return LandingArea(model or camera(), OPTIONS, TRACKING).look(estimate)


def test_ground_with_tracks_everywhere_is_measured():
    seen = look(FLAT)
    assert seen.measured == 1.0
    assert seen.patch_m == pytest.approx(2.0 * WINDOW_M)


@pytest.mark.parametrize("by_deg", [(50.0, 0.0), (0.0, 50.0), (-50.0, 0.0), (0.0, -50.0)])
def test_what_lies_beside_the_picture_is_not_measured(by_deg):
    assert look(FLAT, camera(*by_deg)).measured < 0.2, "mounted aslant"
    leaning = replace(FLAT, roll_deg=by_deg[0], pitch_deg=by_deg[1])
    assert look(leaning).measured < 0.2, "flying aslant"


def test_mount_and_attitude_together_look_straight_down():
    leaning = replace(FLAT, roll_deg=-40.0)
    assert look(leaning, camera(40.0)).measured == 1.0


def test_tracks_of_unknown_height_measure_nothing():
    assert look(replace(FLAT, tracks=tracks(measured=lambda x, y: np.zeros(len(x), bool)))).measured == 0.0
    assert look(replace(FLAT, tracks=None)).measured == 0.0


def test_a_hole_at_the_place_below_counts_more_from_near_than_from_far():
    hole = tracks(keep=lambda x, y: np.hypot(x - 79.5, y - 59.5) > 45)
    near, far = (look(replace(FLAT, tracks=hole, height_m=h)).measured for h in (2.0, 1.0))
    assert near < 0.2
    assert near < far < 0.9


def test_without_a_height_only_the_place_straight_below_is_asked_for():
    estimate = replace(FLAT, height_m=math.nan)
    seen = look(estimate)
    assert seen.measured == 1.0
    assert math.isnan(seen.patch_m)
    assert look(replace(estimate, tracks=tracks(keep=lambda x, y: x > 110))).measured == 0.0


def test_a_sky_below_is_not_measured():
    assert look(replace(FLAT, roll_deg=180.0)).measured == 0.0


def test_what_is_flat_is_not_fit_where_the_place_below_is_unseen():
    area = LandingArea(camera(), OPTIONS, TRACKING)
    beside = replace(FLAT, tracks=tracks(keep=lambda x, y: x < 50))
    assert against_flat(beside, OPTIONS) == ()
    assert against_landing(FLAT, OPTIONS, 0.0, area) == ()
    (reason,) = against_landing(beside, OPTIONS, 0.0, area)
    assert reason.code is Code.GROUND_NOT_SEEN
    decider = Decider(OPTIONS, area)
    assert {decider.step(replace(beside, time_s=k * 0.1)).verdict for k in range(20)} == {"unknown"}
    assert "fit" in {decider.step(replace(FLAT, time_s=2 + k * 0.1)).verdict for k in range(20)}


def test_from_where_a_box_is_smaller_than_a_track_s_window_nothing_is_fit():
    area = LandingArea(camera(), OPTIONS, TRACKING)
    lowest = OPTIONS.max_patch_m / WINDOW_M
    even = replace(FLAT, roughness=0.0, roughness_std=0.0)
    assert against_landing(replace(even, height_m=lowest * 0.99), OPTIONS, 0.0, area) == ()
    (reason,) = against_landing(replace(even, height_m=lowest * 1.01), OPTIONS, 0.0, area)
    assert reason.code is Code.GROUND_UNRESOLVED


def test_whether_the_place_below_is_in_view_does_not_depend_on_tracks():
    area = LandingArea(camera(), OPTIONS, TRACKING)
    assert area.in_view(replace(FLAT, tracks=None)) == 1.0
    assert area.in_view(replace(FLAT, height_m=0.5)) < 0.7, "so near that it is larger than the picture"
    assert area.in_view(replace(FLAT, roll_deg=60.0)) == 0.0
    assert area.in_view(replace(FLAT, roll_deg=180.0)) == 0.0
