"""The ground below, from frame to frame: relief into the map, and at its own rate what of it can be landed on."""

import math
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from landing.estimate import SurfaceEstimate
from landing.ground.ground_velocity import GroundVelocity
from landing.ground.map import CELL_M, CELLS, GroundMap
from landing.ground.relief import DenseRelief
from landing.ground.scale import Scale, along_normal
from landing.ground.spots import UNKNOWN, Disc, Discs, GroundCode, Spot
from landing.motion.views import Views
from landing.observation import Observation
from landing.options import GroundOptions
from landing.plane.plane import Plane
from landing.vision.camera import CameraModel

Array = NDArray[np.float64]

_STEP_M = 0.1
"""Places of the way to the stopping point are so far apart."""
_DISPUTED = 0.5
"""Share of the recent looks that differ from which a cell is shown as disputed."""
_NO_STOP = Disc(UNKNOWN, (GroundCode.NO_STOPPING_POINT,))


@dataclass(frozen=True, slots=True)
class GroundReport:
    """What can be landed on at one frame: the discs ``below`` and at ``touchdown`` (from the vehicle), and spots."""

    frame: int
    time_s: float
    place_ned: Array
    below: Disc
    touchdown: Disc
    touchdown_north_m: float
    touchdown_east_m: float
    spots: tuple[Spot, ...]


@dataclass(frozen=True, slots=True)
class Sight:
    """The vehicle over the ground: its place in the map's axes (north, east, down), velocity NED by the view (by the
    autopilot where the view has none), height with its standard deviation, and sink over height (1/s). ``seen_m`` and
    ``seen_std_m``: the height of this frame alone, NaN where nothing measured it."""

    place_ned: tuple[float, float, float]
    velocity_ned: tuple[float, float, float] | None
    height_m: float
    height_std_m: float
    approach: float
    seen_m: float
    seen_std_m: float


class CellState(IntEnum):
    """Of a cell as it is shown: LANDABLE is measured with a landable disc about it; the looks at DISPUTED disagree."""

    UNKNOWN = 0
    MEASURED = 1
    LANDABLE = 2
    DISPUTED = 3


@dataclass(frozen=True, slots=True)
class MapView:
    """The known part of the map: ``height_m`` (rows, columns), NaN where unknown, and ``state`` (rows, columns), a
    ``CellState``. The corner is north and east."""

    north0_m: float
    east0_m: float
    height_m: Array
    state: NDArray[np.uint8]


class Ground:
    """Feed it every frame; ``report`` says what it comes to."""

    def __init__(self, options: GroundOptions, camera: CameraModel) -> None:
        self.options = options
        self.relief = DenseRelief(options, camera)
        self.map = GroundMap(options, camera.focal_px)
        self.scale = Scale()
        self.motion = GroundVelocity()
        self._last_s = math.nan
        self._velocity: Array | None = None
        self._delay_s = 0.0
        self._tilt_std_deg = math.nan
        self._approach = math.nan
        self._moved: Array | None = None
        self._level = math.nan
        self._seen = math.nan, math.nan

    def step(self, views: Views, plane: Plane, observation: Observation, estimate: SurfaceEstimate) -> None:
        """Take the frame that ``views`` and ``plane`` are of; ``estimate`` has its height."""
        interval_s = observation.time_s - self._last_s
        self._last_s = observation.time_s
        ned_from_camera = views.newest.ned_from_camera
        normal, known = plane.normal, bool(np.isfinite(plane.omega).all())
        length = float(np.linalg.norm(normal))
        approach = float(normal @ plane.omega) if known else math.nan
        self._seen = along_normal(estimate.height_m, normal), estimate.height_std_m / length
        self.scale.step(interval_s, approach if known else 0.0, *self._seen)
        distance_m = self.scale.distance_m * length
        self._velocity = observation.velocity_ned
        self._delay_s = max(0.0, observation.delay_s)
        self._tilt_std_deg = estimate.inclination_std_deg
        self._approach = approach / length if known else math.nan
        # the way down to the plane straight below, over the distance along its normal
        self._level = math.nan
        if ned_from_camera is not None:
            self._level = length / abs(float((ned_from_camera @ normal)[2]))
        self._moved = None
        way = None
        if known and math.isfinite(distance_m) and ned_from_camera is not None:
            way = ned_from_camera @ plane.omega * (distance_m * interval_s)
            self._moved = ned_from_camera @ plane.omega * distance_m
        elif observation.velocity_ned is not None:
            way = observation.velocity_ned * interval_s
        self.map.move(observation.time_s, way if math.isfinite(interval_s) else np.zeros(3))
        relief = self.relief.step(views, plane, observation.image, self.map.resolution(distance_m))
        if relief is None or ned_from_camera is None:
            return
        self.map.look(relief, ned_from_camera, distance_m)
        self.relief.ask_for(relief, self.options.max_step_m / 2 / distance_m)

    def limit(self, max_inclination_deg: float, sigmas: float) -> None:
        """Other limits of the decision from now on."""
        self.options = replace(self.options, max_inclination_deg=max_inclination_deg, sigmas=sigmas)

    def forget(self) -> None:
        """What was seen does not hold: the pictures are not of what is below."""
        self.map.forget()
        self.scale.forget()
        self.motion.forget()

    def report(self, frame: int) -> GroundReport:
        """What can be landed on, at the newest frame."""
        discs = self._discs()
        north, east, up = self.map.place.tolist()
        below = discs.at(*self.map.cell_of(north, east))
        way = self._way()
        if way is None:
            touchdown, stop = _NO_STOP, (math.nan, math.nan)
        else:
            touchdown = discs.along(self.map, way)
            stop = float(way[-1, 0] - north), float(way[-1, 1] - east)
        return GroundReport(
            frame,
            self._last_s,
            np.array((north, east, -up)),
            below,
            touchdown,
            *stop,
            discs.spots(self.map, 0.0),
        )

    def view(self) -> MapView | None:
        """The known part of the map; None where there is none."""
        rows, columns = (self.map.looks > 0).nonzero()
        if not len(rows):
            return None
        part = slice(int(rows.min()), int(rows.max()) + 1), slice(int(columns.min()), int(columns.max()) + 1)
        known = self.map.known[part]
        state = known.astype(np.uint8)
        state[known & self._discs().landable[part]] = CellState.LANDABLE
        state[self.map.disputed[part] > _DISPUTED] = CellState.DISPUTED
        north, east = self.map.corner_m
        return MapView(
            north + part[0].start * CELL_M,
            east + part[1].start * CELL_M,
            np.where(known, self.map.height[part], math.nan),
            state,
        )

    def under_way(self) -> tuple[Disc, Disc]:
        """At the newest frame: the disc straight below, and the worst from there to the stopping point."""
        way = self._way()
        places = self.map.place[None, :2] if way is None else way
        cells = [
            row * CELLS + column for row, column in (self.map.cell_of(*place) for place in places.tolist())
        ]
        inside = np.unique([cell for cell in cells if 0 <= cell < CELLS * CELLS]).astype(np.intp)
        discs = self._discs(inside)
        below = discs.at(*self.map.cell_of(*places[0].tolist()))
        if way is None:
            return below, _NO_STOP
        return below, discs.along(self.map, way)

    def spots(self, drift_m: tuple[float, float] = (0.0, 0.0)) -> tuple[Spot, ...]:
        """Landable discs, best first, from the vehicle; ``drift_m`` as in ``Discs.spots``."""
        return self._discs().spots(self.map, 0.0, drift_m)

    def at(self, north_m: float, east_m: float) -> Disc:
        """The disc about a place in the map's axes."""
        row, column = self.map.cell_of(north_m, east_m)
        if not (0 <= row < CELLS and 0 <= column < CELLS):
            return Disc(UNKNOWN, (GroundCode.NOT_SEEN,))
        return self._discs(np.array([row * CELLS + column], np.intp)).at(row, column)

    def clear_m(self, reach_m: float) -> float:
        """Height over the highest known cell within ``reach_m``, m; NaN where none is known."""
        north, east, up = self.map.place.tolist()
        row, column = self.map.cell_of(north, east)
        size = math.ceil(reach_m / CELL_M)
        part = (
            slice(max(row - size, 0), max(row + size + 1, 0)),
            slice(max(column - size, 0), max(column + size + 1, 0)),
        )
        heights = self.map.height[part][self.map.known[part]]
        return up - float(heights.max()) if heights.size else math.nan

    @property
    def sight(self) -> Sight:
        """The vehicle over the ground at the newest frame."""
        north, east, up = self.map.place.tolist()
        moved = self._velocity if self._moved is None else self._moved
        velocity = None if moved is None else (float(moved[0]), float(moved[1]), float(moved[2]))
        height = self.scale.distance_m * self._level
        seen_m, seen_std_m = (value * self._level for value in self._seen)
        height_std_m = height * self.scale.relative_std
        return Sight((north, east, -up), velocity, height, height_std_m, self._approach, seen_m, seen_std_m)

    def _discs(self, cells: NDArray[np.intp] | None = None) -> Discs:
        return Discs(self.map, self.options, self._tilt_std_deg, self.scale.relative_std, cells)

    def _way(self) -> Array | None:
        """Places (n, 2) from the vehicle to its stopping point, in the map's axes; None without a velocity."""
        stop = self._stopping_point()
        if stop is None:
            return None
        north, east = self.map.place[:2].tolist()
        count = max(2, math.ceil(math.hypot(*stop) / _STEP_M) + 1)
        return np.linspace((north, east), (north + stop[0], east + stop[1]), count)

    def _stopping_point(self) -> tuple[float, float] | None:
        """Where ArduCopter's LAND stops, north and east of the vehicle, m; None without a velocity.

        By the view's motion in the map's own metres where there is one: the noise of a velocity moves the point about.
        The frame is ``delay_s`` old: the vehicle has flown on by so much already.
        """
        velocity = self._velocity if self._moved is None else self._moved
        if velocity is None:
            return None
        north, east = velocity[:2].tolist()
        speed = math.hypot(north, east)
        way = stopping_distance(speed) + speed * self._delay_s
        if not math.isfinite(way):
            return None
        return (north * way / speed, east * way / speed) if speed > 0 else (0.0, 0.0)


_GAIN, _BRAKING = 1.0, 2.5


def stopping_distance(speed: float) -> float:
    """How far ArduCopter's position controller goes on from a speed in m/s (PSC_POSXY_P 1, WPNAV_ACCEL 250)."""
    linear = _BRAKING / _GAIN
    if speed <= linear:
        return speed / _GAIN
    return linear / (2 * _GAIN) + speed * speed / (2 * _BRAKING)
