"""What the simulated ground is made of: textured convex planar facets in world NED."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DriverError
from drivers.simulated.world.textures import MATERIALS

Array = NDArray[np.float64]


UP = np.array([0.0, 0.0, -1.0])


def axes(bearing_deg: float) -> tuple[Array, Array]:
    """Unit vectors forward along a bearing and to its right, NED."""
    angle = math.radians(bearing_deg)
    return np.array([math.cos(angle), math.sin(angle), 0.0]), np.array(
        [-math.sin(angle), math.cos(angle), 0.0]
    )


def point(north: float, east: float, height: float) -> Array:
    """NED of a place at a height."""
    return np.array([north, east, -height])


@dataclass(frozen=True)
class Facet:
    """A convex planar polygon, textured, seen from its outer side only.

    ``vertices`` (k, 3) with k of 3 or 4, NED, anticlockwise about ``normal`` (3,), which points outwards.
    A point X (3,) has the texture's coordinates ``u_axis @ X`` and ``v_axis @ X``; one repetition is ``texture_m``.
    """

    vertices: Array
    normal: Array
    u_axis: Array
    v_axis: Array
    material: str
    texture_m: float
    velocity: tuple[float, float] = (0.0, 0.0)
    """North and east, m/s; the texture goes along."""
    stops_s: float = math.inf
    """When it stands still."""


def facet(
    vertices: Array, outward: Array, material: str, texture_m: float = 4.0, draped: bool = False
) -> Facet:
    """A facet through ``vertices`` whose outer side looks towards ``outward`` (3,), NED.

    ``draped`` lays the texture on from above, so that it goes on over the edges between facets.
    """
    if material not in MATERIALS:
        raise DriverError(f"there is no material '{material}'; there are {', '.join(MATERIALS)}")
    points = np.asarray(vertices, dtype=np.float64)
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    length = float(np.linalg.norm(normal))
    if length < 1e-12:
        raise DriverError(f"a facet needs three points that are not on one line, got {points.tolist()}")
    normal /= length
    if float(np.abs((points - points[0]) @ normal).max()) > 1e-9 * max(1.0, float(np.abs(points).max())):
        raise DriverError(f"the points of a facet must lie in one plane, got {points.tolist()}")
    if normal @ outward < 0:
        points, normal = points[::-1].copy(), -normal
    if draped:
        return Facet(
            points, normal, np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]), material, texture_m
        )
    # The texture's v axis runs down the slope, so that boards and roof tiles lie as they do in life.
    steepest = np.array([0.0, 0.0, 1.0]) - normal[2] * normal
    if np.linalg.norm(steepest) < 1e-6:
        steepest = np.array([1.0, 0.0, 0.0]) - normal[0] * normal
    v_axis = steepest / np.linalg.norm(steepest)
    return Facet(points, normal, np.cross(normal, v_axis), v_axis, material, texture_m)
