"""What the simulated ground is truly like where somebody lands, or says that one may."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drivers.simulated.vehicle.quaternion import to_euler, to_matrix
from drivers.simulated.world.truth import FrameTruth
from drivers.simulated.world.world import World
from landing.estimate import SurfaceEstimate
from landing.ground.block_match import SUPPORT
from landing.ground.ground import stopping_distance
from landing.ground.landing_area import LandingArea
from landing.vision.camera import CameraModel

Array = NDArray[np.float64]

Fitness = Literal["fit", "unfit", "between"]

EVEN, UNEVEN = 0.003, 0.015
"""Relief over distance of ground that is clearly even, and clearly not."""
SLOPE_MARGIN_DEG = 2.0
"""Clearly fit is gentler than the limit by this, clearly unfit steeper by this."""
PATCH_M = 0.5
"""Radius of the ground that is looked at under a vehicle: it stands on that, however it is turned."""
PATCH_POINTS = 11
_RIM = np.arange(8) * (math.pi / 4)
KNOWN_IN_S = 0.5
"""Ground that has been in view for so long can be measured: the longest baseline."""
UNEVEN_M = 0.1
"""A vehicle tips over something that rises this far out of the ground it stands on."""


@dataclass(frozen=True, slots=True)
class Patch:
    """The ground below a place: its best-fit plane's inclination, the largest height over or under that plane."""

    north_m: float
    east_m: float
    inclination_deg: float
    deviation_m: float


def unsafe(patch: Patch, max_inclination_deg: float) -> bool:
    """Whether the ground below a place is clearly no ground to land on."""
    return patch.inclination_deg >= max_inclination_deg + SLOPE_MARGIN_DEG or patch.deviation_m >= UNEVEN_M


def patch(world: World, north: float, east: float, radius_m: float = PATCH_M) -> Patch:
    """The ground within a circle about a place."""
    axis = np.linspace(-radius_m, radius_m, PATCH_POINTS)
    inside = [(n, e) for n in axis for e in axis if math.hypot(n, e) <= radius_m * (1 + 1e-9)]
    points = [(n, e, world.height_at(north + n, east + e)) for n, e in inside]
    table = np.array(points)
    design = np.column_stack([table[:, :2], np.ones(len(table))])
    plane, *_ = np.linalg.lstsq(design, table[:, 2], rcond=None)
    rest = float(np.abs(table[:, 2] - design @ plane).max())
    return Patch(north, east, math.degrees(math.atan(math.hypot(plane[0], plane[1]))), rest)


def fitness(truth: FrameTruth, max_inclination_deg: float) -> Fitness:
    """Whether the ground in view at a frame is clearly fit for landing, clearly unfit, or neither."""
    if not math.isfinite(truth.relief):
        return "unfit"
    if truth.relief >= UNEVEN or truth.fit_inclination_deg >= max_inclination_deg + SLOPE_MARGIN_DEG:
        return "unfit"
    if truth.relief <= EVEN and truth.fit_inclination_deg <= max_inclination_deg - SLOPE_MARGIN_DEG:
        return "fit"
    return "between"


def measurable(truth: FrameTruth, area: LandingArea, camera: CameraModel) -> bool:
    """Whether the ground where it would land can be known: from straight below to the stopping point in view now and
    half a second ago, from low enough for what the settings ask for."""
    o = area.options
    if o.touchdown_known and not _stop_in_view(truth, camera, o.landing_radius_m):
        return False
    roll, pitch, _ = to_euler((truth.qw, truth.qx, truth.qy, truth.qz))
    known = SurfaceEstimate(
        truth.frame,
        truth.time_boot_s,
        "ok",
        "truth",
        slope_x_deg=math.degrees(math.atan(truth.slope_a)),
        slope_y_deg=math.degrees(math.atan(truth.slope_b)),
        roll_deg=math.degrees(roll),
        pitch_deg=math.degrees(pitch),
        height_m=truth.axis_distance_m,
    )
    low = area.patch_m(truth.axis_distance_m) <= o.max_patch_m
    return low and area.in_view(known) >= o.min_area_measured


def _stop_in_view(truth: FrameTruth, camera: CameraModel, radius_m: float) -> bool:
    """Whether the disc at the stopping point has been in view for ``KNOWN_IN_S``."""
    velocity = np.array((truth.vn, truth.ve))
    speed = math.hypot(truth.vn, truth.ve)
    stop = velocity * (stopping_distance(speed) / speed if speed > 0 else 0.0)
    places = np.stack((stop, stop + velocity * KNOWN_IN_S))
    ned_from_camera = np.array(to_matrix((truth.qw, truth.qx, truth.qy, truth.qz))) @ camera.body_from_camera
    normal = np.array((-truth.slope_a, -truth.slope_b, 1.0))
    margin_px = SUPPORT / 2
    inside = discs_in_view(
        camera, ned_from_camera, normal, truth.axis_distance_m, places, radius_m, margin_px
    )
    return bool(inside.all())


def discs_in_view(
    camera: CameraModel,
    ned_from_camera: Array,
    normal: Array,
    distance_m: float,
    places: Array,
    radius_m: float,
    margin_px: float,
) -> NDArray[np.bool_]:
    """Whether each disc (n,) lies whole in the picture, ``margin_px`` from its border or more.

    ``places`` (n, 2) are the discs' middles, north and east of the camera in m. The surface is the plane
    normal . X = distance_m in the camera frame, ``normal`` (-a, -b, 1).
    """
    rim = places[:, None, :] + radius_m * np.stack((np.cos(_RIM), np.sin(_RIM)), axis=1)
    towards = ned_from_camera @ normal
    if not towards[2] > 0:
        return np.zeros(len(places), bool)
    down = (distance_m - rim @ towards[:2]) / towards[2]
    rays = np.concatenate((rim, down[..., None]), axis=-1) @ ned_from_camera
    ahead = rays[..., 2] > 0
    there = rays[..., :2] / np.where(ahead, rays[..., 2], 1.0)[..., None]
    pixels = camera.project(there.reshape(-1, 2))
    far = np.array((camera.width, camera.height)) - 1 - margin_px
    inside = ((pixels >= margin_px) & (pixels <= far)).all(axis=1).reshape(ahead.shape)
    return np.asarray((inside & ahead).all(axis=1))
