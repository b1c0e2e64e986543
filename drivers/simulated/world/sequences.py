"""Short exact picture sequences over one plane, for tests and experiments."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DriverError
from drivers.simulated.world.lens import DOWN, Lens
from drivers.simulated.world.render import Renderer
from drivers.simulated.world.surfaces import ramp
from drivers.simulated.world.world import World

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PlaneSequence:
    """Pictures of a plane Z = h + aX + bY by a camera that looks straight down, without rotation.

    ``images`` (n, height, width) uint8; ``positions`` (n, 3) NED; ``ned_from_camera`` (n, 3, 3);
    ``distance`` (n,) along the axis; ``omega`` (n, 3): the displacement to the next frame over the distance, camera
    frame, per frame (the last row: that of the step before it, at its own distance); ``a`` and ``b`` the slopes.
    """

    images: NDArray[np.uint8]
    lens: Lens
    positions: Array
    ned_from_camera: Array
    distance: Array
    omega: Array
    a: float
    b: float

    @property
    def slope_deg(self) -> tuple[float, float]:
        """atan(a) and atan(b)."""
        return math.degrees(math.atan(self.a)), math.degrees(math.atan(self.b))

    @property
    def time_to_contact(self) -> Array:
        """(n,) 2 over the divergence, in frames (design: divergence = 2 wz + a wx + b wy)."""
        w = self.omega
        divergence = 2 * w[:, 2] + self.a * w[:, 0] + self.b * w[:, 1]
        with np.errstate(divide="ignore"):
            return 2 / divergence


def plane_sequence(
    texture: str = "noise",
    slope_deg: float = 0.0,
    axis: Literal["x", "y"] = "y",
    motion: Literal["x", "y", "z"] = "y",
    n: int = 30,
    width: int = 256,
    height: int = 256,
    fov_deg: float = 50.0,
    noise_sigma: float = 2.0,
    seed: int = 1,
    omega: float = 0.011,
    tau: float = 65.0,
    distance: float = 2.0,
    texture_m: float = 4.0,
    fine: bool = True,
    samples: int | None = None,
) -> PlaneSequence:
    """A sequence over a plane of ``slope_deg`` along the camera's ``axis``.

    Sideways (``motion`` "x" or "y") the ventral flow is ``omega`` a frame at every frame; along the axis the camera
    approaches at a constant speed with ``tau`` frames to contact at the first picture (needs n < tau). ``fine`` and
    ``samples`` are the renderer's.
    """
    if motion == "z" and n >= tau:
        raise DriverError(f"{n} frames along the axis need more than {tau} frames to contact at the start")
    slope = math.tan(math.radians(slope_deg))
    a, b = (slope, 0.0) if axis == "x" else (0.0, slope)
    # Camera x is east, y south, z down; Z = h + aX + bY goes down with a to the east, with b to the south.
    bearing = 270.0 if axis == "x" else 0.0
    world = World(ramp(inclination_deg=slope_deg, uphill_deg=bearing, material=texture, texture_m=texture_m))
    lens = Lens.from_fov(width, height, fov_deg)
    renderer = Renderer(world, lens, fine=fine, samples=samples, texture_seed=seed)
    rng = np.random.default_rng([seed, 77])
    # Start anywhere on the texture: repetitions (and so seeds) differ.
    east, south = rng.uniform(-0.5, 0.5, 2) * texture_m
    place = np.array([east, south, -distance + a * east + b * south])
    images, positions, distances, omegas = [], [], [], []
    h = distance
    speed = distance / tau
    for _ in range(n):
        direction = np.array([motion == "x", motion == "y", motion == "z"], dtype=float)
        shift = direction * (speed if motion == "z" else omega * h)
        ned = np.array([-place[1], place[0], place[2]])
        light = renderer.image(ned, DOWN)
        picture = light + noise_sigma * rng.standard_normal(light.shape)
        images.append(np.clip(np.rint(picture), 0, 255).astype(np.uint8))
        positions.append(ned)
        distances.append(h)
        omegas.append(shift / h)
        place = place + shift
        h = h - shift[2] + a * shift[0] + b * shift[1]
    return PlaneSequence(
        np.stack(images),
        lens,
        np.stack(positions),
        np.repeat(DOWN[None], n, axis=0),
        np.array(distances),
        np.stack(omegas),
        a,
        b,
    )
