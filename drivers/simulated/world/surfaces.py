"""The surfaces of the simulated ground: ramps, stairs, steps, roofs, boxes, rubble, rolling terrain.

Each function returns the facets of one surface, flat polygons with a material (corners in the world frame NED, m).
Lengths in metres, bearings in degrees clockwise from north, heights positive upwards. ``texture_m``: side of the ground
that one texture image covers.
"""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from drivers.errors import DriverError
from drivers.simulated.world.facets import UP, Array, Facet, axes, facet, point
from drivers.simulated.world.pit import pit


def strip(
    profile: list[tuple[float, float]],
    *,
    north: float = 0.0,
    east: float = 0.0,
    bearing_deg: float = 0.0,
    width: float = 20.0,
    material: str = "concrete",
    riser_material: str = "",
    texture_m: float = 4.0,
) -> list[Facet]:
    """A section (distance, height) drawn out to both sides: ramps, stairs and steps are made of these.

    ``profile`` runs along the bearing from (north, east); distances may stay equal (a vertical face).
    """
    forward, right = axes(bearing_deg)
    start = point(north, east, 0.0)
    facets = []
    for (s0, h0), (s1, h1) in pairwise(profile):
        if s1 < s0 or (s1 == s0 and h1 == h0):
            raise DriverError(f"a profile must go on from point to point, got {(s0, h0)} then {(s1, h1)}")
        a = start + s0 * forward + h0 * UP
        b = start + s1 * forward + h1 * UP
        side = 0.5 * width * right
        vertical = s1 == s0
        outward = (forward if h1 < h0 else -forward) if vertical else UP
        name = riser_material if vertical and riser_material else material
        facets.append(facet(np.array([a - side, b - side, b + side, a + side]), outward, name, texture_m))
    return facets


def level(
    *,
    height: float = 0.0,
    size: float = 400.0,
    north: float = 0.0,
    east: float = 0.0,
    material: str = "grass",
    texture_m: float = 4.0,
) -> list[Facet]:
    """Level ground, a square about a place."""
    half = 0.5 * size
    profile = [(-half, height), (half, height)]
    return strip(profile, north=north, east=east, width=size, material=material, texture_m=texture_m)


def ramp(
    *,
    inclination_deg: float,
    uphill_deg: float = 0.0,
    north: float = 0.0,
    east: float = 0.0,
    height: float = 0.0,
    length: float = 400.0,
    width: float = 400.0,
    material: str = "concrete",
    texture_m: float = 4.0,
) -> list[Facet]:
    """A sloped plane that rises along ``uphill_deg``; (north, east, height) is its middle."""
    if not -89 < inclination_deg < 89:
        raise DriverError(f"inclination_deg must lie between -89 and 89, got {inclination_deg}")
    rise = math.tan(math.radians(inclination_deg))
    half = 0.5 * length
    return strip(
        [(-half, height - half * rise), (half, height + half * rise)],
        north=north,
        east=east,
        bearing_deg=uphill_deg,
        width=width,
        material=material,
        texture_m=texture_m,
    )


def stairs(
    *,
    north: float = 0.0,
    east: float = 0.0,
    bearing_deg: float = 0.0,
    count: int = 18,
    rise: float = 0.17,
    run: float = 0.29,
    height: float | None = None,
    platform: float = 100.0,
    floor: float = 100.0,
    width: float = 200.0,
    material: str = "concrete",
    riser_material: str = "",
    texture_m: float = 4.0,
) -> list[Facet]:
    """A platform, ``count`` steps and a floor along a bearing; the first edge is at (north, east).

    A positive ``rise`` goes down from the platform, a negative one up. ``height`` is the platform's; by
    default the floor lies at 0.
    """
    if count < 1 or run <= 0 or rise == 0:
        raise DriverError(f"stairs need count >= 1, run > 0 and rise != 0, got {count}, {run}, {rise}")
    top = count * rise if height is None else height
    profile = [(-platform, top), (0.0, top)]
    for k in range(1, count + 1):
        profile.append(((k - 1) * run, top - k * rise))
        profile.append((k * run if k < count else (k - 1) * run + floor, top - k * rise))
    return strip(
        profile,
        north=north,
        east=east,
        bearing_deg=bearing_deg,
        width=width,
        material=material,
        riser_material=riser_material,
        texture_m=texture_m,
    )


def box(
    *,
    north: float,
    east: float,
    length: float,
    width: float,
    top: float,
    base: float = 0.0,
    yaw_deg: float = 0.0,
    tilt_deg: float = 0.0,
    tilt_bearing_deg: float = 0.0,
    material: str = "concrete",
    texture_m: float = 1.0,
) -> list[Facet]:
    """A box from ``base`` to ``top`` (heights); its top may be tilted about its middle, rising along a bearing."""
    if min(length, width) <= 0 or top <= base:
        raise DriverError(f"a box needs a size and top over base, got {length} x {width}, {base} to {top}")
    forward, right = axes(yaw_deg)
    uphill, _ = axes(tilt_bearing_deg)
    middle = point(north, east, 0.0)
    corners = [
        middle + 0.5 * (i * length * forward + j * width * right)
        for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    climb = math.tan(math.radians(tilt_deg))
    upper = [c + (top + climb * float((c - middle) @ uphill)) * UP for c in corners]
    lower = [c + base * UP for c in corners]
    if min(-c[2] for c in upper) < base:
        raise DriverError(f"the box's top, tilted by {tilt_deg} deg, dips under its base at {base} m")
    facets = [facet(np.array(upper), UP, material, texture_m)]
    for k in range(4):
        n = (k + 1) % 4
        outward = 0.5 * (corners[k] + corners[n]) - middle
        side = np.array([lower[k], lower[n], upper[n], upper[k]])
        facets.append(facet(side, outward, material, texture_m))
    return facets


def rubble(
    *,
    seed: int = 1,
    count: int = 90,
    north: float = 0.0,
    east: float = 0.0,
    length: float = 10.0,
    width: float = 10.0,
    smallest: float = 0.15,
    largest: float = 0.5,
    ground: float = 0.0,
    tilt_deg: float = 15.0,
    material: str = "concrete",
    texture_m: float = 1.0,
    clear_m: float = 0.0,
    clear_north: float = 0.0,
    clear_east: float = 0.0,
) -> list[Facet]:
    """Boxes of random size, place, yaw and tilt on ground of height ``ground``, in a rectangle about a place.

    A circle of the diameter ``clear_m`` about another place is left free.
    """
    rng = np.random.default_rng(seed)
    facets = []
    for _ in range(count):
        sides = rng.uniform(smallest, largest, 3)
        tilt = rng.uniform(0, tilt_deg)
        # The tilted top must stay over the ground on its low side.
        tilt = min(tilt, math.degrees(math.atan(0.9 * sides[2] / (0.5 * math.hypot(sides[0], sides[1])))))
        at = north + rng.uniform(-0.5, 0.5) * length, east + rng.uniform(-0.5, 0.5) * width
        yaw_deg, bearing_deg = rng.uniform(0, 360), rng.uniform(0, 360)
        free_m = math.dist(at, (clear_north, clear_east)) - math.hypot(sides[0], sides[1]) / 2
        if 0 < clear_m > 2 * free_m:
            continue
        facets += box(
            north=at[0],
            east=at[1],
            length=sides[0],
            width=sides[1],
            top=ground + sides[2],
            base=ground,
            yaw_deg=yaw_deg,
            tilt_deg=tilt,
            tilt_bearing_deg=bearing_deg,
            material=material,
            texture_m=texture_m,
        )
    return facets


def step(
    *,
    height: float,
    low: float = 0.0,
    north: float = 0.0,
    east: float = 0.0,
    bearing_deg: float = 0.0,
    length: float = 200.0,
    width: float = 400.0,
    material: str = "concrete",
    texture_m: float = 4.0,
) -> list[Facet]:
    """A vertical face at (north, east): the ground is ``low`` before it and higher by ``height`` after it."""
    profile = [(-length, low), (0.0, low), (0.0, low + height), (length, low + height)]
    return strip(
        profile,
        north=north,
        east=east,
        bearing_deg=bearing_deg,
        width=width,
        material=material,
        texture_m=texture_m,
    )


def roof(
    *,
    north: float = 0.0,
    east: float = 0.0,
    ridge_bearing_deg: float = 90.0,
    length: float = 12.0,
    width: float = 8.0,
    eaves: float = 3.0,
    pitch_deg: float = 30.0,
    base: float = 0.0,
    material: str = "roof",
    wall_material: str = "concrete",
    texture_m: float = 4.0,
) -> list[Facet]:
    """A house with a gable roof; ``width`` is across the ridge, ``eaves`` the height of the walls."""
    if not 0 < pitch_deg < 80 or eaves <= base:
        raise DriverError(
            f"a roof needs a pitch of 0 to 80 deg and eaves over its base, got {pitch_deg}, {eaves}"
        )
    along, across = axes(ridge_bearing_deg)
    ridge = eaves + 0.5 * width * math.tan(math.radians(pitch_deg))
    middle = point(north, east, 0.0)

    def at(i: float, j: float, height: float) -> Array:
        return middle + 0.5 * i * length * along + 0.5 * j * width * across + height * UP

    facets = []
    for j in (-1, 1):
        plane = np.array([at(-1, j, eaves), at(1, j, eaves), at(1, 0, ridge), at(-1, 0, ridge)])
        facets.append(facet(plane, UP, material, texture_m))
        wall = np.array([at(-1, j, base), at(1, j, base), at(1, j, eaves), at(-1, j, eaves)])
        facets.append(facet(wall, j * across, wall_material, texture_m))
    for i in (-1, 1):
        wall = np.array([at(i, -1, base), at(i, 1, base), at(i, 1, eaves), at(i, -1, eaves)])
        facets.append(facet(wall, i * along, wall_material, texture_m))
        gable = np.array([at(i, -1, eaves), at(i, 1, eaves), at(i, 0, ridge)])
        facets.append(facet(gable, i * along, wall_material, texture_m))
    return facets


def rolling(
    *,
    seed: int = 1,
    north: float = 0.0,
    east: float = 0.0,
    size: float = 40.0,
    cell: float = 1.0,
    wavelength: float = 8.0,
    amplitude: float = 0.5,
    height: float = 0.0,
    material: str = "grass",
    texture_m: float = 4.0,
) -> list[Facet]:
    """Rolling terrain: a triangle mesh over a square, a sum of seeded waves about ``wavelength`` long.

    ``amplitude`` is the standard deviation of the height. Within the outer eighth the waves die away to
    ``height``, where level ground may go on.
    """
    steps = max(2, round(size / cell))
    if steps > 200:
        raise DriverError(
            f"rolling terrain of {size} m in cells of {cell} m is {steps} cells wide; at most 200"
        )
    rng = np.random.default_rng(seed)
    axis = np.linspace(-0.5 * size, 0.5 * size, steps + 1)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    waves = np.zeros_like(x)
    for _ in range(12):
        k = 2 * math.pi / (wavelength * rng.uniform(0.7, 1.6))
        angle, phase = rng.uniform(0, 2 * math.pi, 2)
        waves += math.sqrt(2 / 12) * np.cos(k * (x * math.cos(angle) + y * math.sin(angle)) + phase)
    edge = np.clip((0.5 * size - np.maximum(np.abs(x), np.abs(y))) / (size / 8), 0, 1)
    z = height + amplitude * waves * edge * edge * (3 - 2 * edge)
    points = np.stack([north + x, east + y, -z], axis=-1)
    facets = []
    for i in range(steps):
        for j in range(steps):
            a, b, c, d = points[i, j], points[i + 1, j], points[i + 1, j + 1], points[i, j + 1]
            facets.append(facet(np.array([a, b, c]), UP, material, texture_m, draped=True))
            facets.append(facet(np.array([a, c, d]), UP, material, texture_m, draped=True))
    return facets


SURFACES: dict[str, Callable[..., list[Facet]]] = {
    "level": level,
    "ramp": ramp,
    "stairs": stairs,
    "strip": strip,
    "box": box,
    "pit": pit,
    "rubble": rubble,
    "step": step,
    "roof": roof,
    "rolling": rolling,
}
"""What a world's description may name, by ``kind``."""
