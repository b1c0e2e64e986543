"""The overlay: any estimate can be drawn, and what is drawn lies where the camera sees it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace as replace_struct

from companion.messages.messages import Decision
from companion.replay.overlay import COLOURS, OverlayWriter, Scene, draw, reasons
from landing.estimate import SurfaceEstimate, TrackView
from landing.reasons import Certainty, Code, Reason
from landing.vision.camera import CameraModel

CAMERA = CameraModel.from_focal(320, 240, 256.0)
GREY = np.full((240, 320), 120, np.uint8)


def decision(verdict: str) -> Decision:
    return Decision(
        frame=0,
        time_unix_us=0,
        verdict=verdict,
        reasons=("too steep: 23 degrees, limit 10", "ä" * 300),
        since_unix_us=0,
        permitted=False,
        withheld=(),
        requested=False,
        command="none",
    )


def test_the_reasons_are_those_of_the_frame_where_it_has_any():
    even = SurfaceEstimate(0, 0.0, "ok", "map")
    steep = replace(even, against_flat=(Reason(Code.TOO_STEEP, Certainty.CERTAIN, 31.6, limit=10.0),))
    old = decision("unfit")
    assert reasons(steep, old) == ("too steep: 31.6 degrees, limit 10.0",)
    assert reasons(even, old) == old.reasons
    # a frame above the limit within the hysteresis does not unmake a fit surface
    assert reasons(steep, replace_struct(old, verdict="fit", reasons=())) == ()
    assert reasons(steep, None) == ()


def tracks(points: np.ndarray, inlier: np.ndarray) -> TrackView:
    return TrackView(points - 3, points, inlier, np.zeros(len(points)))


angles = st.floats(-89.9, 89.9)
maybe = st.one_of(st.just(math.nan), st.floats(-1e6, 1e6))


@given(angles, angles, maybe, maybe, st.floats(0, 90), maybe, st.sampled_from(list(COLOURS)), st.booleans())
@examples(40)
def test_any_estimate_can_be_drawn(x, y, roll, pitch, inclination, std, verdict, late):
    estimate = SurfaceEstimate(
        0, 0.0, "ok", "map", slope_x_deg=x, slope_y_deg=y, roll_deg=roll, pitch_deg=pitch,
        inclination_deg=inclination, inclination_std_deg=std, roughness=std, time_to_contact_s=roll,
        tracks=tracks(np.array([[-50.0, 5.0], [1e5, 3.0], [np.nan, 1.0]]), np.array([True, False, True])),
    )  # fmt: skip
    picture = draw(GREY, estimate, CAMERA, Scene(decision(verdict), 3.0, 2.0 if late else None))
    assert picture.shape == (720, 960, 3)
    assert picture.dtype == np.uint8
    assert tuple(picture[3, 955]) == COLOURS[verdict]


@pytest.mark.parametrize("size", [(16, 16), (160, 120), (640, 480), (1920, 1080)])
def test_any_size_can_be_drawn(size: tuple[int, int]):
    width, height = size
    camera = CameraModel.from_focal(width, height, 0.8 * width)
    estimate = SurfaceEstimate(0, 0.0, "motion_too_small", "map")
    picture = draw(np.zeros((height, width), np.uint8), estimate, camera, Scene(None, 0.0))
    assert picture.shape[0] / picture.shape[1] == height / width


def test_tracks_lie_on_their_pixels_in_their_colours():
    points = np.array([[40.0, 60.0], [280.0, 60.0]])
    estimate = SurfaceEstimate(0, 0.0, "no", "map", tracks=tracks(points, np.array([True, False])))
    picture = draw(GREY, estimate, CAMERA, Scene(None, 0.0)).astype(int)
    inlier, outlier = picture[181, 121], picture[181, 841]
    assert inlier[1] > inlier[2] + 60
    assert outlier[2] > outlier[1] + 60


def tinted(x_deg: float, y_deg: float) -> np.ndarray:
    """(n, 2) pixels of the enlarged picture that the grid covers."""
    estimate = SurfaceEstimate(0, 0.0, "ok", "map", slope_x_deg=x_deg, slope_y_deg=y_deg)
    picture = draw(GREY, estimate, CAMERA, Scene(decision("fit"), 0.0)).astype(int)
    return np.argwhere((picture[..., 1] - picture[..., 2] > 10)[70:650])[:, ::-1] + (0, 70)


def test_the_grid_is_a_square_when_level_and_narrows_with_the_distance():
    level = tinted(0, 0)
    assert np.allclose(level.mean(axis=0), (480, 360), atol=4)
    assert np.ptp(level[:, 0]) == pytest.approx(np.ptp(level[:, 1]), abs=4)

    down = tinted(0, -30)  # a < 0 down the image: the lower edge is nearer, so it looks wider
    upper, lower = down[down[:, 1] < 250], down[down[:, 1] > 470]
    assert np.ptp(lower[:, 0]) > 1.2 * np.ptp(upper[:, 0])
    right = tinted(30, 0)  # the right edge is further away
    assert np.ptp(right[right[:, 0] > 600][:, 1]) < np.ptp(right[right[:, 0] < 360][:, 1])


def test_a_video_of_fewer_frames_than_it_takes_to_know_the_rate(tmp_path):
    writer = OverlayWriter(tmp_path / "o.webm", CAMERA)
    writer.add(GREY, SurfaceEstimate(0, 0.0, "starting", "map"), 0.0)
    writer.close()
    assert (tmp_path / "o.webm").stat().st_size > 1000
    OverlayWriter(tmp_path / "none.webm", CAMERA).close()
    assert not (tmp_path / "none.webm").exists()
