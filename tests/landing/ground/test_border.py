"""Relief that has just come into view: seen at the border before any track has a history there."""

import numpy as np
import pytest
from border_support import CAMERA, HEIGHT, KEPT_PX, RATE_HZ, RELIEF, STEP_PX, TURNS, WIDTH, pictures

from landing.ground.border import Border, BorderStep, _Before, _Place, _Strips
from landing.ground.roughness import Relief
from landing.motion.views import Views
from landing.observation import Observation
from landing.options import Options
from landing.pipeline import SurfacePipeline
from landing.plane.plane import Plane
from landing.reasons import Code, Reason
from landing.vision.camera import CameraModel


def watched(comes: int | None, turns: int = 0, step_px: int = STEP_PX) -> list[BorderStep | None]:
    """What a border of its own finds at each frame of a flight."""
    pipeline, border, found = (
        SurfacePipeline(CAMERA, Options()),
        Border(Options().estimator, CAMERA, KEPT_PX),
        [],
    )
    measure = pipeline.relief.step

    def step(views: Views, plane: Plane) -> Relief | None:
        found.append(border.step(views, plane) if plane.status == "ok" else None)
        return measure(views, plane)

    pipeline.relief.step = step  # type: ignore[method-assign]
    for k, image in enumerate(pictures(comes, turns, step_px)):
        pipeline.step(Observation(k, k / RATE_HZ, image, np.eye(3), 1e-5))
    return found


@pytest.mark.parametrize("side", TURNS)
def test_what_comes_in_is_seen_at_once(side: str):
    comes = 25
    found = watched(comes, TURNS[side])
    first = next(k for k, standing in enumerate(found) if standing)
    # as soon as it fills the strip behind what the older frame did not see
    assert comes + 2 <= first <= comes + 4
    standing, later = found[first : first + 2]
    assert standing is not None
    assert later is not None
    # its outermost line came from beyond the older picture and counts too much, until it is a little further in
    assert standing.height >= RELIEF - 0.12
    assert later.height == pytest.approx(RELIEF, abs=0.12)
    assert not standing.lasting
    assert later.lasting
    assert standing.mean_square > Options().decision.max_roughness ** 2
    axis, place = {"right": (0, WIDTH), "left": (0, 0), "bottom": (1, HEIGHT), "top": (1, 0)}[side]
    assert np.abs(standing.pixels[:, axis] - place).max() < 20


def test_level_ground_has_nothing_at_its_border():
    assert not any(watched(None))


def test_a_view_that_moves_slowly_is_looked_at_when_ground_has_come_in(monkeypatch: pytest.MonkeyPatch):
    """A pixel a frame: about every second frame, until something stands out; then at once again."""
    looked: dict[Border, list[int]] = {}
    look = Border._before

    def counted(border: Border, views: Views, *args: object) -> object:
        looked.setdefault(border, []).append(views.tracker.frame)
        return look(border, views, *args)  # type: ignore[arg-type]

    monkeypatch.setattr(Border, "_before", counted)
    assert not any(watched(None, step_px=1))
    # the pipeline's border and the one that is watched
    assert len(looked) == 2
    for frames in looked.values():
        assert set(np.diff([frame for frame in frames if frame > 20])) <= {2, 3}
    found = watched(20, step_px=1)
    first = next(k for k, standing in enumerate(found) if standing)
    assert any({first, first + 1} <= set(frames) for frames in list(looked.values())[2:])


def test_what_was_seen_at_the_border_makes_the_view_rough_until_tracks_have_measured_it(
    monkeypatch: pytest.MonkeyPatch,
):
    seen = 20
    standing = BorderStep(
        3, np.array(((WIDTH - 2.0, 60.0), (WIDTH - 2.0, 80.0))), 0.2, 0.02**2, sure=True, lasting=True
    )
    monkeypatch.setattr(
        Border, "step", lambda _, views, plane: standing if views.tracker.frame == seen else None
    )
    pipeline, rough = SurfacePipeline(CAMERA, Options()), []
    for k, image in enumerate(pictures(None, 0)):
        rough.append(pipeline.step(Observation(k, k / RATE_HZ, image, np.eye(3), 1e-5)).roughness)
    assert max(rough[12:seen]) < 0.01
    assert min(rough[seen : seen + 2]) > 0.015
    # the ground there is even after all
    assert max(rough[seen + 15 :]) < 0.01


def test_what_stands_out_in_one_frame_alone_is_not_remembered(monkeypatch: pytest.MonkeyPatch):
    seen = 20
    standing = BorderStep(3, np.array(((WIDTH - 2.0, 60.0), (WIDTH - 2.0, 80.0))), 0.2, 0.02**2, sure=True)
    monkeypatch.setattr(
        Border, "step", lambda _, views, plane: standing if views.tracker.frame == seen else None
    )
    pipeline, flat = SurfacePipeline(CAMERA, Options()), []
    for k, image in enumerate(pictures(None, 0)[: seen + 3]):
        flat.append(pipeline.step(Observation(k, k / RATE_HZ, image, np.eye(3), 1e-5)).flat)
    assert flat[-4:] == [True, False, True, True]


def suspects(monkeypatch: pytest.MonkeyPatch, stands: set[int], sure: bool) -> tuple[list[bool], list[str]]:
    """Whether each frame of level ground is flat, and why not, when a side is said to stand out at some frames."""
    look = Border._steps
    frame = 0

    def standing(border: Border, strips: object) -> list[BorderStep]:
        found = look(border, strips)  # type: ignore[arg-type]
        return [*found, BorderStep(3, np.zeros((1, 2)), 0.2, 0.02**2, sure)] if frame in stands else found

    monkeypatch.setattr(Border, "_steps", standing)
    pipeline, flat, why = SurfacePipeline(CAMERA, Options()), [], []
    for frame, image in enumerate(pictures(None, 0)):
        estimate = pipeline.step(Observation(frame, frame / RATE_HZ, image, np.eye(3), 1e-5))
        flat.append(estimate.flat)
        why += estimate.against_flat if frame > 28 else ()
    return flat[27:], why


def test_after_something_stood_out_nothing_is_flat_until_ground_has_passed(monkeypatch: pytest.MonkeyPatch):
    """At 4 px a frame a baseline of 14.4 px has passed in the fourth frame after it."""
    flat, why = suspects(monkeypatch, {28}, sure=True)
    assert flat[:6] == [True, False, False, False, False, True]
    assert why[:2] == 2 * [Reason(Code.ROUGHNESS_AT_BORDER)]


def test_a_side_that_may_stand_out_is_not_flat_while_it_does(monkeypatch: pytest.MonkeyPatch):
    flat, _ = suspects(monkeypatch, {28, 30}, sure=False)
    assert flat[:6] == [True, False, True, False, True, True]


@pytest.mark.parametrize(("away", "sure"), [(4.5, []), (6.0, [False]), (8.0, [True])])
def test_a_whole_side_is_suspected_before_it_is_sure(away: float, sure: list[bool]):
    """Of blocks that all stand out alike a run knows less than the side, and it takes ``border_sigmas`` to count."""
    border, sigma = Border(Options().estimator, CAMERA, KEPT_PX), 0.01
    blocks = border._sides[3].blocks
    place = _Place(3, 4, _Before(1, np.eye(3), np.eye(3)), np.zeros((2, blocks, 2), np.float32))
    height = np.full((1, blocks), away * sigma / np.sqrt(blocks))
    found = border._steps(_Strips([place], height, np.full((1, blocks), 1 / sigma**2)))
    assert [standing.sure for standing in found] == sure
    assert all(len(standing.pixels) == blocks for standing in found)


def test_blocks_that_scatter_ask_for_more(monkeypatch: pytest.MonkeyPatch):
    """Where blocks beside each other contradict one another, as in badly compressed pictures, none stands out."""
    monkeypatch.setattr(Border, "_learn", lambda border, strip: setattr(border, "_scatter", 50.0))
    assert not any(watched(25))


@pytest.mark.parametrize(("width", "height"), [(240, 60), (60, 180), (240, 18)])
def test_a_view_without_room_for_strips_is_left_alone(width: int, height: int):
    camera = CameraModel.from_focal(width, height, 200.0)
    pipeline, border = SurfacePipeline(camera, Options()), Border(Options().estimator, camera, KEPT_PX)
    for k, image in enumerate(pictures(None, 0)[:12]):
        pipeline.step(Observation(k, k / RATE_HZ, image[:height, :width].copy(), np.eye(3), 1e-5))
    moving = Plane("ok", 0.0, 0.0, np.eye(2) * 1e-6, np.array((0.6, 0.0, 0.0)))
    assert border.step(pipeline.views, moving) is None


def test_without_motion_or_attitude_nothing_is_looked_at():
    image = pictures(None, 0)[0]
    pipeline = SurfacePipeline(CAMERA, Options())
    for k in range(4):
        estimate = pipeline.step(Observation(k, k / RATE_HZ, image, np.eye(3) if k % 2 else None))
        assert not estimate.flat
