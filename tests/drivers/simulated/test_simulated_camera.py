"""The simulated camera: the sensor's faults and the truth of every frame."""

import csv
import math
from dataclasses import astuple
from pathlib import Path

import cv2
import numpy as np
import pytest
from places import REPOSITORY

from drivers.errors import DriverError
from drivers.simulated.world import surfaces
from drivers.simulated.world.camera import Pose, SensorOptions, SimulatedCamera
from drivers.simulated.world.lens import DOWN, Lens
from drivers.simulated.world.render import Renderer
from drivers.simulated.world.truth import frame_truth, quaternion, write_truth
from drivers.simulated.world.world import World

FLIGHTS = REPOSITORY / "sitl_logs"
LENS = Lens.from_fov(160, 120, 64)


def forward(t: float) -> Pose:
    """North at 2 m/s, 2 m up, level."""
    return Pose(np.array([2 * t, 0.0, -2.0]), np.eye(3), np.array([2.0, 0.0, 0.0]))


def still(t: float) -> Pose:
    return Pose(np.array([0.0, 0.0, -2.0]), np.eye(3), np.zeros(3))


def camera(**options: float) -> SimulatedCamera:
    renderer = Renderer(World(surfaces.level(material="gravel")), LENS)
    return SimulatedCamera(renderer, SensorOptions(**{"noise_sigma": 0.0, **options}), seed=4)


def matrix(q: list[float]) -> np.ndarray:
    a, b, c, d = np.array(q) / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (c * c + d * d), 2 * (b * c - a * d), 2 * (b * d + a * c)],
            [2 * (b * c + a * d), 1 - 2 * (b * b + d * d), 2 * (c * d - a * b)],
            [2 * (b * d - a * c), 2 * (c * d + a * b), 1 - 2 * (b * b + c * c)],
        ]
    )


def test_frames_are_the_same_whenever_they_are_taken() -> None:
    one, two = camera(noise_sigma=3.0), camera(noise_sigma=3.0)
    first = [one.expose(k, k / 30, forward) for k in range(3)]
    assert np.array_equal(two.expose(2, 2 / 30, forward), first[2])
    assert not np.array_equal(first[0], first[1])
    frames = list(one.frames(forward, 0.0, 2, latency_s=0.02))
    assert np.array_equal(frames[1][0].image, first[1])
    assert frames[1][0].arrival_us - frames[1][0].stamp_us == 20_000
    assert frames[1][1].time_boot_s == pytest.approx(1 / 30)


def test_noise_has_its_deviation() -> None:
    clean, noisy = camera(), camera(noise_sigma=4.0)
    difference = noisy.expose(0, 0.0, still).astype(float) - clean.expose(0, 0.0, still)
    assert difference.std() == pytest.approx(4.0, rel=0.05)


def test_vignetting_darkens_the_corners_and_drift_the_whole_in_time() -> None:
    clean = camera().expose(0, 0.0, still).astype(float)
    dark = camera(vignetting=0.5).expose(0, 0.0, still).astype(float)
    assert dark[:4, :4].mean() / clean[:4, :4].mean() == pytest.approx(0.5, abs=0.05)
    assert dark[58:62, 78:82].mean() / clean[58:62, 78:82].mean() == pytest.approx(1.0, abs=0.02)
    means = [
        camera(exposure_drift=0.2).expose(0, t, still).mean() / clean.mean() for t in np.arange(0, 7, 0.5)
    ]
    assert max(means) == pytest.approx(1.2, abs=0.03)
    assert min(means) == pytest.approx(0.8, abs=0.03)


def test_motion_blur_smears_along_the_motion_only() -> None:
    sharp = camera().expose(0, 0.0, forward).astype(float)
    smeared = camera(exposure_s=0.02, blur_samples=8).expose(0, 0.0, forward).astype(float)
    along = [np.abs(np.diff(p, axis=0)).mean() for p in (sharp, smeared)]
    across = [np.abs(np.diff(p, axis=1)).mean() for p in (sharp, smeared)]
    assert along[1] < 0.6 * along[0]
    assert along[1] / along[0] < across[1] / across[0] - 0.1


def test_rolling_shutter_shows_every_row_at_its_own_time() -> None:
    """Rows move by readout times speed: the flow against a global shutter grows from row to row."""
    readout = 0.02
    still_picture = camera().expose(0, 0.0, forward)
    rolled = camera(readout_s=readout).expose(0, 0.0, forward)
    corners = cv2.goodFeaturesToTrack(
        still_picture, 150, 0.01, 6, mask=np.pad(np.ones((90, 130), np.uint8), 15)
    )
    tracked, status, _ = cv2.calcOpticalFlowPyrLK(
        still_picture, rolled, corners, None, winSize=(15, 15), maxLevel=2
    )
    good = status.ravel() == 1
    y = corners[good, 0, 1]
    moved = (tracked - corners)[good, 0]
    slope, offset = np.polyfit(y, moved[:, 1], 1)
    pixels_a_second = 2.0 / 2.0 * LENS.focal_px
    # A point at row y is seen at row y' at time (y'/(h-1) - 1/2) readout, having moved down by v times that.
    rate = pixels_a_second * readout / (LENS.height - 1)
    assert slope == pytest.approx(rate / (1 - rate), rel=0.1)
    assert offset + slope * 59.5 == pytest.approx(0, abs=0.1)
    assert np.abs(np.median(moved[:, 0])) < 0.05


def test_wrong_options_are_refused() -> None:
    with pytest.raises(DriverError, match="vignetting must lie between 0 and 1, got 2"):
        SensorOptions(vignetting=2)
    with pytest.raises(DriverError, match="frame rate"):
        next(camera().frames(still, 0.0, 1, rate_hz=0))


@pytest.mark.parametrize("flight", ["agile_a", "descent_a"])
def test_truth_has_the_meaning_of_the_recorded_flights(flight: str) -> None:
    """Columns computed at a recorded pose are the recorded ones: same frames, signs and units."""
    with (FLIGHTS / flight / "truth.csv").open() as file:
        rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)][::60]
    compared = 0
    for row in rows:
        attitude = matrix([row[k] for k in ("qw", "qx", "qy", "qz")])
        position = np.array([row["pn"], row["pe"], row["pd"]])
        if row["plane_fraction"] < 1:
            continue
        if flight == "descent_a" and abs(row["inclination_deg"] - 15) > 0.01:
            continue
        # The ground under the axis, put where the recording has it; its plane from the recorded slopes.
        ned_from_camera = attitude @ DOWN
        point = position + ned_from_camera[:, 2] * row["axis_distance_m"]
        normal = ned_from_camera @ np.array([-row["slope_a"], -row["slope_b"], 1.0])
        normal /= np.linalg.norm(normal)
        uphill = math.degrees(math.atan2(normal[1], normal[0]))
        surface = surfaces.ramp(
            inclination_deg=math.degrees(math.acos(normal[2])),
            uphill_deg=uphill,
            north=point[0],
            east=point[1],
            height=-point[2],
        )
        renderer = Renderer(World(surface), LENS, texture_size=64)
        velocity = np.array([row["vn"], row["ve"], row["vd"]])
        truth = frame_truth(renderer, int(row["frame"]), row["time_boot_s"], position, attitude, velocity)
        for name, tolerance in (
            ("axis_distance_m", 1e-4),
            ("slope_a", 1e-4),
            ("slope_b", 1e-4),
            ("inclination_deg", 0.02),
            ("cam_wx", 1e-4),
            ("cam_wy", 1e-4),
            ("cam_wz", 1e-4),
            ("plane_fraction", 1e-6),
            ("relief", 1e-4),
            ("fit_inclination_deg", 0.05),
        ):
            assert getattr(truth, name) == pytest.approx(row[name], abs=tolerance), (name, row["frame"])
        assert quaternion(attitude) == pytest.approx([row[k] for k in ("qw", "qx", "qy", "qz")], abs=1e-4)
        compared += 1
    assert compared >= 3


def test_truth_over_stairs_tells_relief_and_fitted_slope(tmp_path: Path) -> None:
    world = World(surfaces.stairs(count=30, rise=0.17, run=0.29))
    renderer = Renderer(world, LENS)
    pose = Pose(
        np.array([4.0, 0.0, -(world.height_at(4.0, 0.0) + 1.7)]), np.eye(3), np.array([0.6, 0.0, 0.0])
    )
    truth = frame_truth(renderer, 0, 1.0, pose.position, pose.ned_from_body, pose.velocity)
    assert truth.axis_distance_m == pytest.approx(1.7)
    assert truth.inclination_deg == 0
    assert truth.plane_fraction < 0.4
    assert truth.fit_inclination_deg == pytest.approx(30.4, abs=4)
    # A saw-tooth of 0.17 by 0.29 m seen from straight above: RMS 0.17 cos(30.4 deg) / sqrt(12) m.
    assert truth.relief == pytest.approx(0.17 * math.cos(math.radians(30.4)) / math.sqrt(12) / 1.7, rel=0.25)
    assert truth.cam_wy == pytest.approx(-0.6 / 1.7)
    nothing = frame_truth(renderer, 1, 1.0, np.array([0.0, 0.0, -9.0]), np.diag([1.0, -1, -1]), pose.velocity)
    assert math.isnan(nothing.axis_distance_m)
    write_truth(tmp_path / "truth.csv", [truth, nothing])
    with (tmp_path / "truth.csv").open() as file:
        rows = list(csv.reader(file))
    assert rows[0] == (FLIGHTS / "stairs_a" / "truth.csv").read_text().splitlines()[0].split(",")
    assert [float(v) for v in rows[1]] == pytest.approx(astuple(truth), abs=1e-5)
