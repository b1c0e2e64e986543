"""The simulated ground: all facets together, and its height as a function of place."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from drivers.errors import DriverError
from drivers.simulated.world.facets import Array, Facet
from drivers.simulated.world.surfaces import SURFACES


class World:
    """All facets of a world, and its height as a function of place."""

    def __init__(self, facets: list[Facet]) -> None:
        if not facets:
            raise DriverError("a world needs at least one surface")
        self.facets = tuple(facets)
        self.vertices = np.stack([np.concatenate([f.vertices, f.vertices[-1:]])[:4] for f in facets])
        """(n, 4, 3) NED; a triangle repeats its last vertex."""
        self.normals = np.stack([f.normal for f in facets])
        self.offsets = np.einsum("ij,ij->i", self.normals, self.vertices[:, 0])
        self._velocity = np.array([(*f.velocity, 0.0) for f in facets])
        self._stops_s = np.array([[f.stops_s] for f in facets])
        self.moving = bool(self._velocity.any())
        self.shift = np.zeros((len(facets), 3))
        """How far each facet has moved."""
        self._upper = np.flatnonzero(self.normals[:, 2] < -1e-9)
        corners = self.vertices[self._upper, :, :2]
        following = np.roll(corners, -1, axis=1)
        self._edges = following - corners
        self._starts = corners

    def advance(self, time_s: float) -> None:
        """Let what moves be where it is at a time; at zero everything is where it was built."""
        if not self.moving:
            return
        shift = self._velocity * np.minimum(time_s, self._stops_s)
        change = shift - self.shift
        self.shift = shift
        self.vertices = self.vertices + change[:, None]
        self.offsets = self.offsets + np.einsum("ij,ij->i", self.normals, change)
        self._starts = self._starts + change[self._upper, None, :2]

    def surface_at(self, north: float, east: float) -> tuple[float, Array]:
        """The highest surface under the sky at a place: (down in m, outward normal (3,)); (inf, up) where none."""
        relative = np.array([north, east]) - self._starts
        side = self._edges[:, :, 0] * relative[:, :, 1] - self._edges[:, :, 1] * relative[:, :, 0]
        # Seen from above (along +down) an anticlockwise facet about its upward normal runs clockwise in
        # north-east coordinates or the other way round; one sign for all edges means inside.
        inside = np.all(side >= -1e-9, axis=1) | np.all(side <= 1e-9, axis=1)
        hit = self._upper[inside]
        if not len(hit):
            return math.inf, np.array([0.0, 0.0, -1.0])
        normal = self.normals[hit]
        down = (self.offsets[hit] - normal[:, 0] * north - normal[:, 1] * east) / normal[:, 2]
        best = int(np.argmin(down))
        return float(down[best]), normal[best]

    def height_at(self, north: float, east: float) -> float:
        """Height of the highest surface in m over NED's origin; -inf where there is none."""
        return -self.surface_at(north, east)[0]


def build_world(surfaces: list[Mapping[str, Any]]) -> World:
    """A world from descriptions such as ``{"kind": "ramp", "inclination_deg": 20}``, all surfaces together.

    Each may move: ``moves_m_s`` along the bearing ``moves_deg``, until ``moves_s``.
    """
    facets: list[Facet] = []
    for number, description in enumerate(surfaces, 1):
        arguments = dict(description)
        kind = arguments.pop("kind", None)
        speed, bearing = (float(arguments.pop(key, 0.0)) for key in ("moves_m_s", "moves_deg"))
        stops_s = float(arguments.pop("moves_s", math.inf))
        if kind not in SURFACES:
            raise DriverError(f"surface {number}: kind must be one of {', '.join(SURFACES)}, got {kind!r}")
        try:
            made = SURFACES[kind](**arguments)
        except TypeError as error:
            raise DriverError(f"surface {number} ({kind}): {error}") from error
        if speed:
            towards = math.radians(bearing)
            velocity = (speed * math.cos(towards), speed * math.sin(towards))
            made = [replace(f, velocity=velocity, stops_s=stops_s) for f in made]
        facets += made
    return World(facets)
