"""The lateness of the frames' stamps, found where the vehicle turns unevenly, and taken out."""

import dataclasses
import math

import numpy as np
import pytest
import synthetic_flow

from landing.options import EstimatorOptions
from landing.plane.map_estimator import MapEstimator
from landing.plane.plane import Plane, RotationError, RowsError
from landing.plane.time_offset import TimeOffsetFilter
from landing.rotations import log_so3, matrix_from_euler

RATE_HZ = 30.0
OPTIONS = EstimatorOptions()
STD_S, DRIFT = OPTIONS.time_offset_std_s, OPTIONS.time_offset_drift


def swinging(t: float):
    """Attitude and body rates of a vehicle that swings by 6 degrees at 0.7 Hz, roll and pitch out of step."""
    swing, w = math.radians(6), 2 * math.pi * 0.7

    def attitude(at: float):
        return matrix_from_euler(swing * math.sin(w * at), swing * math.cos(w * at), 0.1 * at)

    return attitude(t), log_so3(attitude(t - 1e-4).T @ attitude(t + 1e-4)) / 2e-4


def turning(t: float):
    """The same for a steady turn about the vertical."""
    return matrix_from_euler(0, 0, 0.5 * t), np.array((0.0, 0.0, 0.5))


def flown(motion, late_s: float, frames: int = 60, std_s: float = STD_S):
    """A camera 2 m over level ground at 0.6 m/s, its stamps late; what is found goes into the next frame."""
    rng = np.random.default_rng(4)
    points = synthetic_flow.ground(rng, 0.0, 0.0, 2.0, 6.0, 600)
    flight = synthetic_flow.Flight(points, rng)
    estimator = MapEstimator(OPTIONS, flight.camera.focal_px, len(points))
    found = TimeOffsetFilter(std_s, DRIFT, 7e-4)
    planes = []
    for k in range(frames):
        stamp_s = k / RATE_HZ
        reported, rate = motion(stamp_s - found.late_s)
        true, _ = motion(stamp_s - late_s)
        position = np.array((0.6 * (stamp_s - late_s), 0.0, 0.0))
        late = found.late_s
        flight.step(stamp_s, position, true, reported, body_rate=rate, late_s=late)
        planes.append(estimator.step(flight.views))
        found.step(flight.views, planes[-1])
    return found, flight.views, planes


@pytest.mark.parametrize("late_s", [0.0, 0.015, -0.02, 0.05])
def test_a_vehicle_that_swings_shows_how_late_its_frames_are(late_s: float):
    found, views, planes = flown(swinging, late_s)
    assert found.late_s == pytest.approx(late_s, abs=max(4 * found.std_s, 1e-4))
    assert found.std_s < 0.002
    assert planes[-1].status == "ok"
    # and the attitude that the last frame is given is the one it was taken in
    newest = views.newest
    true = swinging(newest.time_s - late_s)[0] @ views.camera.body_from_camera
    assert np.linalg.norm(log_so3(true.T @ newest.ned_from_camera)) < 1e-3


def test_what_is_found_puts_earlier_attitudes_right():
    """The first frames were taken with an attitude that was up to 14 mrad off."""
    found, views, _ = flown(swinging, 0.03, frames=24)
    assert abs(found.late_s - 0.03) < 0.003
    mount = views.camera.body_from_camera
    for gap in (5, 12, 18, 23):
        new, old = (swinging(views.view(k).time_s - 0.03)[0] @ mount for k in (0, gap))
        measured = views.rotation(gap)
        assert measured is not None
        assert np.linalg.norm(log_so3((old.T @ new).T @ measured)) < 0.003


def test_a_steady_turn_tells_nothing():
    found, _, _ = flown(turning, 0.02)
    assert found.late_s == pytest.approx(0, abs=1e-3)
    assert found.std_s > 0.9 * STD_S


def test_a_lateness_that_is_known_is_left_alone():
    found, _, _ = flown(swinging, 0.0, std_s=0.0)
    assert (found.late_s, found.std_s) == (0.0, 0.0)


class Seen:
    """As much of ``Views`` as the lateness asks for."""

    ned_from_camera = None

    def __init__(self, time_s: float, change=(0.5, 0.2, 0.0)):
        self.newest = self
        self.time_s, self.change = time_s, np.array(change)

    def turn_change(self, gap: int):
        return self.change, np.zeros(3)


def plane_of(error, std: float = 1e-4):
    """A plane whose tracks tell the rotation's error nearly exactly."""
    prior = np.full(3, 1e-3)
    return Plane("ok", gap=4, rotation_error=RotationError(np.array(error), np.eye(3) * std**2, prior))


def test_one_wrong_fit_moves_what_many_have_shown_by_little():
    found = TimeOffsetFilter(0.01, 0.0, 7e-4)
    for k in range(100):
        found.step(Seen(k / RATE_HZ), plane_of(Seen(0).change * 0.005))
    late_s, std_s = found.late_s, found.std_s
    assert late_s == pytest.approx(0.005, rel=0.05)
    found.step(Seen(100 / RATE_HZ), plane_of(Seen(0).change * 0.2))
    assert 0 < found.late_s - late_s < 2 * std_s


def rocking(t: float):
    """Attitude and body rates of a vehicle in gusts: swings of several periods, so that no shift looks like another."""

    def attitude(at: float):
        roll = 0.06 * math.sin(4.4 * at) + 0.04 * math.sin(7.1 * at + 1)
        pitch = 0.06 * math.cos(3.3 * at) + 0.03 * math.sin(9.7 * at)
        return matrix_from_euler(roll, pitch, 0.05 * math.sin(2 * at))

    return attitude(t), log_so3(attitude(t - 1e-4).T @ attitude(t + 1e-4)) / 2e-4


@pytest.mark.parametrize("late_s", [0.15, 0.3, 0.45])
def test_a_network_camera_is_found_by_the_coarse_search(late_s: float):
    found, views, planes = flown(rocking, late_s, frames=130)
    assert found.confirmed
    assert found.late_s == pytest.approx(late_s, abs=max(4 * found.std_s, 1e-3))
    assert found.std_s < 0.003
    assert not found.at_bound
    assert planes[-1].status == "ok"
    true = rocking(views.newest.time_s - late_s)[0] @ views.camera.body_from_camera
    assert np.linalg.norm(log_so3(true.T @ views.newest.ned_from_camera)) < 2e-3


def test_a_lateness_beyond_the_search_is_at_least_so_much_or_none():
    found, _, _ = flown(rocking, 0.75, frames=110)
    assert found.at_bound or not found.confirmed
    if found.at_bound:
        assert found.std_s == pytest.approx(STD_S, rel=0.01)


def test_the_coarse_search_leaves_a_camera_that_is_in_time_alone():
    found, _, _ = flown(rocking, 0.01, frames=100)
    assert found.confirmed
    assert found.late_s == pytest.approx(0.01, abs=max(4 * found.std_s, 1e-4))


def test_at_the_bound_the_doubt_does_not_shrink():
    found = TimeOffsetFilter(0.01, 0.0, 7e-4)
    for k in range(300):
        found.step(Seen(k / RATE_HZ), plane_of(Seen(0).change * 0.5))
    assert found.at_bound
    assert found.late_s == pytest.approx(0.1)
    assert found.std_s == pytest.approx(0.01)


@pytest.mark.parametrize("error", [(math.nan, 0, 0), (math.inf, 0, 0)])
def test_what_is_no_number_is_left_out(error):
    found = TimeOffsetFilter(0.01, 0.0, 7e-4)
    found.step(Seen(0.0), plane_of(error))
    found.step(Seen(0.1, (math.nan, 0, 0)), plane_of((0, 0, 0)))
    assert (found.late_s, found.std_s) == (0.0, 0.01)


def test_it_does_not_run_away():
    found = TimeOffsetFilter(0.01, 0.0, 7e-4)
    for k in range(1000):
        found.step(Seen(k / RATE_HZ), plane_of(Seen(0).change * 3.0))
    assert found.late_s == pytest.approx(0.1)


def test_doubt_grows_with_time_but_never_beyond_what_it_was_at_first():
    found = TimeOffsetFilter(0.01, 0.001, 7e-4)
    found.step(Seen(0.0), plane_of((0, 0, 0)))
    found.std_s = 0.001
    found.step(Seen(3.0), Plane("too_few_tracks"))
    assert found.std_s == pytest.approx(0.002)
    found.step(Seen(1000.0), Plane("too_few_tracks"))
    assert found.std_s == 0.01
    found.std_s = 0.001
    found.loosen()
    assert found.std_s == 0.01


def test_the_error_of_a_rotation_is_the_turn_at_both_ends():
    """Stamps late by s make old_from_new wrong by (old_from_new^T w_old - w_new) s."""
    _, views, _ = flown(swinging, 0.0, frames=12)
    measured, change = views.rotation(8), views.turn_change(8)
    assert measured is not None
    assert change is not None
    s = 1e-3
    mount = views.camera.body_from_camera
    old, new = (swinging(views.view(k).time_s - s)[0] @ mount for k in (8, 0))
    error = log_so3(measured.T @ (old.T @ new))
    np.testing.assert_allclose(change[0] * s - change[1], error, atol=0.05 * np.linalg.norm(error))


def rows_error(readout_s: float, applied_s: float = 0.0) -> RowsError:
    """A fit whose residuals alone tell the readout to a millisecond, off by what is not applied yet."""
    information = 1e6
    score = information * (readout_s - applied_s)
    nothing = np.zeros((2, 2))
    return RowsError(
        np.zeros(8), np.eye(8) * 1e-8, np.zeros(8), information, score, np.zeros(2), nothing, np.zeros(2)
    )


class Rolled(Seen):
    """The same with a readout that has been applied to the tracks."""

    def __init__(self, time_s: float, applied_s: float = 0.0):
        super().__init__(time_s)
        self.rows, self.readout_s = self, applied_s


@pytest.mark.parametrize("applied_s", [0.0, 0.015])
def test_residuals_tell_the_readout_and_the_rotation_the_lateness(applied_s: float):
    found = TimeOffsetFilter(0.01, 0.0, 7e-4, 0.0, 0.016)
    for k in range(200):
        plane = dataclasses.replace(plane_of(Seen(0).change * 0.005), rows_error=rows_error(0.02, applied_s))
        found.step(Rolled(k / RATE_HZ, applied_s), plane)
    assert found.readout_s == pytest.approx(0.02, abs=3 * found.readout_std_s)
    assert found.readout_std_s < 1e-3
    assert found.late_s == pytest.approx(0.005, abs=1e-3)


def test_a_readout_that_is_known_stays():
    found = TimeOffsetFilter(0.01, 0.0, 7e-4, 0.018)
    for k in range(50):
        found.step(Rolled(k / RATE_HZ), dataclasses.replace(plane_of((0, 0, 0)), rows_error=rows_error(0.03)))
    assert (found.readout_s, found.readout_std_s) == (0.018, 0.0)
