"""Roughness: the relief that is there, whatever the height and the speed, and not the tracker's errors."""

from dataclasses import replace

import numpy as np
import pytest
import synthetic_flow

from landing.ground.roughness import Relief, ReliefMap, _Measured, heights
from landing.motion.motion import OverPlane
from landing.options import EstimatorOptions
from landing.plane.plane import Plane

OPTIONS = EstimatorOptions()
RATE_HZ = 30.0


def fly(
    relief: float,
    share: float = 0.3,
    height_m: float = 2.0,
    speed: float = 0.35,
    noise_px: float = 0.1,
    direction: tuple[float, float, float] = (1.0, 0.0, 0.0),
    gross: float = 0.0,
    frames: int = 24,
    seed: int = 1,
) -> tuple[Relief | None, np.ndarray]:
    """Relief over level ground where a share of the points stands up by ``relief`` of the height.

    ``speed`` is over the height. Returns the relief at the newest frame and the heights of all points.
    """
    rng = np.random.default_rng(seed)
    points = synthetic_flow.ground(rng, 0.0, 0.0, height_m, 1.5 * height_m, 250)
    up = (rng.random(len(points)) < share) * relief
    points[:, 2] -= up * height_m
    flight = synthetic_flow.Flight(points, rng, noise_px)
    found = ReliefMap(OPTIONS, flight.camera, len(points), 0.0)
    step = np.array(direction) * speed * height_m / RATE_HZ
    out = None
    wrong = rng.random(len(points)) < gross
    for k in range(frames):
        views = flight.step(k / RATE_HZ, step * (k - frames + 1))
        views.tracker.history[views.tracker.frame % views.tracker.HISTORY, wrong] += (
            rng.uniform(-6, 6, (int(wrong.sum()), 2)) / flight.camera.focal_px
        )
        found.memory.move(np.eye(3), np.eye(3))
        if k < 12:
            continue
        gap = 10
        slots = views.tracker.pair(gap).slots
        weight = ((up[slots] == 0) & ~wrong[slots]).astype(float)
        plane = replace(
            Plane("ok", 0.0, 0.0, np.eye(2) * 1e-6, gap=gap, slots=slots, weight=weight, noise=1.0),
            inlier=weight > 0,
        )
        out = found.step(views, plane)
    return out, up


def test_even_ground_is_smooth():
    found, _ = fly(0.0)
    assert found is not None
    assert found.roughness < 0.003
    assert found.roughness_std < 0.005
    assert found.obstacle_points == 0


@pytest.mark.parametrize("relief", [0.02, 0.05, 0.1])
def test_relief_of_a_minority_counts_in_full(relief: float):
    found, up = fly(relief)
    assert found is not None
    assert found.roughness == pytest.approx(np.sqrt((up**2).mean()), rel=0.3)


def test_heights_are_those_of_the_points():
    found, up = fly(0.05, noise_px=0.02)
    assert found is not None
    assert np.median(np.abs(found.height - up[found.slots])) < 0.004


def test_the_same_at_any_height_and_speed():
    reported = []
    for height_m, speed in ((8.0, 0.35), (1.5, 0.35), (2.0, 0.15), (2.0, 1.0)):
        found, _ = fly(0.05, height_m=height_m, speed=speed)
        assert found is not None
        reported.append(found.roughness)
    assert max(reported) < 1.25 * min(reported)


def test_along_the_axis_relief_is_seen_as_well():
    found, up = fly(0.08, noise_px=0.05, direction=(0.0, 0.0, 1.0), speed=0.5)
    assert found is not None
    if np.isfinite(found.roughness):
        assert found.roughness == pytest.approx(np.sqrt((up**2).mean()), rel=0.5)
    smooth, _ = fly(0.0, noise_px=0.05, direction=(0.0, 0.0, 1.0), speed=0.5)
    assert smooth is not None
    assert not smooth.roughness > 0.01


def test_gross_tracking_errors_do_not_count():
    found, _ = fly(0.0, gross=0.1)
    assert found is not None
    assert found.gross > 5
    clean, _ = fly(0.05, gross=0.0)
    assert clean is not None
    assert found.roughness < 0.5 * clean.roughness
    assert found.obstacle_points <= 2


def test_hardly_any_motion_leaves_it_unknown():
    found, _ = fly(0.05, speed=0.003)
    assert found is None or not found.roughness < 0.01


def test_without_a_plane_there_is_none():
    rng = np.random.default_rng(3)
    flight = synthetic_flow.Flight(synthetic_flow.ground(rng, 0, 0, 2.0, 2.0), rng)
    views = flight.step(0.0, np.zeros(3))
    assert ReliefMap(OPTIONS, flight.camera, 300, 8.0).step(views, Plane("motion_too_small")) is None


@pytest.mark.parametrize(
    ("along", "across", "wrong"),
    [(0.0, 0.0, False), (0.2, 0.0, False), (0.2, 0.03, False), (0.0, 0.03, True), (0.05, 0.05, True)],
)
def test_relief_that_goes_astray_a_little_is_no_gross_error(along: float, across: float, wrong: bool):
    """Shares of the plane's displacement by which one of many points goes along it and across."""
    rng = np.random.default_rng(2)
    new, t = rng.uniform(-0.4, 0.4, (60, 2)), np.array((0.1, 0.0, 0.0, 0.0, 0.0, 0.0))
    old = new - t[:2] + rng.normal(0, 2e-4, new.shape)
    old[0] = new[0] - t[:2] * (1 + along) + (0.0, across * t[0])
    whitener = np.array(((1 / 2e-4,), (0.0,), (1 / 2e-4,))) * np.ones(60)
    level = np.array((0.0, 0.0, 1.0))
    over = OverPlane(new, old[None], level, whitener, turns=True)
    height, std, gross = heights(*over.against(t[None], np.zeros(60, np.intp)), level)
    assert gross[0] == wrong
    assert height[0] == pytest.approx(along, abs=5 * std[0])
    assert not gross[1:].any()


def test_a_height_that_falls_with_the_way_is_an_error_of_place():
    """A point that stands out counts after two frames on end; one that is off by a constant way does not."""
    flight = synthetic_flow.Flight(
        synthetic_flow.ground(np.random.default_rng(1), 0, 0, 2.0, 3.0, 10), np.random.default_rng(1), 0.1
    )
    views = flight.step(0.0, np.zeros(3))
    counted = {}
    for name, heights_ in (("keeps", [0.1] * 6), ("falls", [0.3 / k for k in range(2, 8)])):
        found = ReliefMap(OPTIONS, flight.camera, 10, 0.0)
        counted[name] = 0
        for k, height in enumerate(heights_):
            views.tracker.frame = k
            now = np.full(10, np.nan)
            now[3] = height
            counted[name] += found._obstacle_points(views.tracker, np.array([3]), now[[3]], np.array([True]))
            found._measured[k] = _Measured(k, now, now, np.empty(0, np.intp), np.array((0.0, 0.0, 1.0)))
    assert counted == {"keeps": 5, "falls": 0}
