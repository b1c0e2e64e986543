"""Level ground with a hole in it: a pit, or a ditch when it is long and narrow."""

import numpy as np

from drivers.errors import DriverError
from drivers.simulated.world.facets import UP, Array, Facet, axes, facet, point


def pit(
    *,
    depth: float = 0.4,
    length: float = 1.0,
    width: float = 1.0,
    north: float = 0.0,
    east: float = 0.0,
    bearing_deg: float = 0.0,
    size: float = 200.0,
    material: str = "grass",
    inside: str = "",
    texture_m: float = 4.0,
) -> list[Facet]:
    """Level ground with a rectangular hole about (north, east), ``length`` along the bearing."""
    if min(depth, length, width) <= 0 or max(length, width) >= size:
        raise DriverError(f"a pit needs a depth and a size below {size} m, got {depth}, {length} x {width}")
    forward, right = axes(bearing_deg)
    middle = point(north, east, 0.0)
    inner = inside or material

    def at(along: float, aside: float, height: float = 0.0) -> Array:
        return middle + along * forward + aside * right + height * UP

    a, b, far = length / 2, width / 2, size / 2
    rim = [((-far, -far), (-a, far)), ((a, -far), (far, far)), ((-a, -far), (a, -b)), ((-a, b), (a, far))]
    facets = []
    for (s0, w0), (s1, w1) in rim:
        corners = np.array([at(s0, w0), at(s1, w0), at(s1, w1), at(s0, w1)])
        facets.append(facet(corners, UP, material, texture_m))
    floor = np.array([at(-a, -b, -depth), at(a, -b, -depth), at(a, b, -depth), at(-a, b, -depth)])
    facets.append(facet(floor, UP, inner, texture_m))
    for (s0, w0), (s1, w1), inwards in (
        ((-a, -b), (-a, b), forward),
        ((a, -b), (a, b), -forward),
        ((-a, -b), (a, -b), right),
        ((-a, b), (a, b), -right),
    ):
        wall = np.array([at(s0, w0, -depth), at(s1, w1, -depth), at(s1, w1), at(s0, w0)])
        facets.append(facet(wall, inwards, inner, texture_m))
    return facets
