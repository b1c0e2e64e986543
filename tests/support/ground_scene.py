"""Pictures of textured ground with boxes and pits, ray-cast straight down, for known answers of the ground map."""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from landing.observation import Observation
from landing.vision.camera import DOWN, CameraModel

Array = NDArray[np.float64]
CAMERA = CameraModel.from_focal(160, 120, 130.0)
TEXELS_A_METRE = 60
TEXTURE_M = 8.0
WALL = 60.0


@dataclass(frozen=True)
class Patch:
    """Ground at another height: a box (``top`` over 0) or a pit (under 0), sides along the axes."""

    north: float
    east: float
    length: float
    width: float
    top: float
    smooth: bool = False
    grey: float = 120.0
    """Of a smooth one."""

    def holds(self, north: Array, east: Array) -> NDArray[np.bool_]:
        """Whether places lie on it."""
        return (np.abs(north - self.north) <= self.length / 2) & (np.abs(east - self.east) <= self.width / 2)


@dataclass(frozen=True)
class Scene:
    """Level ground with patches; ``smooth`` ground has no texture, ``slope`` lets it rise to the north."""

    patches: tuple[Patch, ...] = ()
    smooth: bool = False
    slope: float = 0.0
    noise: float = 3.0
    seed: int = 1
    texture: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        size = round(TEXTURE_M * TEXELS_A_METRE)
        rng = np.random.default_rng(self.seed)
        fine, coarse = (cv2.GaussianBlur(rng.normal(size=(size, size)), (0, 0), s) * s for s in (1.5, 5.0))
        object.__setattr__(self, "texture", 120 + 90 * fine + 60 * coarse)

    def picture(self, position: Array, camera: CameraModel = CAMERA, frame: int = 0) -> NDArray[np.uint8]:
        """From ``position`` (north, east, up), level, nose to the north."""
        u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
        points = camera.undistort(np.stack((u, v), -1).reshape(-1, 2).astype(np.float64))
        rays = np.column_stack((points, np.ones(len(points)))) @ DOWN.T
        # the plane z = slope n: up - s d = slope (n0 + s r)
        s = (position[2] - self.slope * position[0]) / (rays[:, 2] + self.slope * rays[:, 0])
        north, east = position[0] + s * rays[:, 0], position[1] + s * rays[:, 1]
        grey = self._grey(north, east, self.smooth)
        for patch in self.patches:
            there = (position[2] - patch.top) / rays[:, 2]
            top_north, top_east = position[0] + there * rays[:, 0], position[1] + there * rays[:, 1]
            on_ground, on_top = patch.holds(north, east), patch.holds(top_north, top_east)
            shown = self._grey(
                top_north - patch.north + 1.7, top_east - patch.east + 0.9, patch.smooth, patch.grey
            )
            # a pit's bottom shows within its rim only
            seen = on_top if patch.top > 0 else on_top & on_ground
            grey = np.where(seen, shown, np.where(on_ground, WALL, grey))
        rng = np.random.default_rng((self.seed, frame))
        noisy = grey + rng.normal(0, self.noise, grey.shape)
        return np.clip(np.rint(noisy), 0, 255).astype(np.uint8).reshape(camera.height, camera.width)

    def _grey(self, north: Array, east: Array, smooth: bool, grey: float = 120.0) -> Array:
        if smooth:
            return np.full(north.shape, grey)
        # by hand: OpenCV's own interpolation rounds its places
        size = len(self.texture)
        row, column = (north + 4) * TEXELS_A_METRE, (east + 4) * TEXELS_A_METRE
        i, j = np.floor(row).astype(int), np.floor(column).astype(int)
        y, x = row - i, column - j
        t = self.texture
        i, j, below, right = i % size, j % size, (i + 1) % size, (j + 1) % size
        upper = t[i, j] * (1 - x) + t[i, right] * x
        lower = t[below, j] * (1 - x) + t[below, right] * x
        return np.asarray(upper * (1 - y) + lower * y)


def flown(
    scene: Scene,
    seconds: float,
    *,
    start: tuple[float, float, float] = (0.0, 0.0, 2.0),
    velocity_ned: tuple[float, float, float] = (0.8, 0.0, 0.0),
    measured: tuple[float, float, float] | None = None,
    rate_hz: float = 20.0,
) -> list[Observation]:
    """A level flight over it; ``measured`` is the velocity that the vehicle reports, if not the true one."""
    out = []
    v = np.array(velocity_ned)
    for k in range(round(seconds * rate_hz)):
        at = np.array(start) + v * (1, 1, -1) * (k / rate_hz)
        said = v if measured is None else np.array(measured)
        image = scene.picture(at, frame=k)
        out.append(Observation(k, k / rate_hz, image, np.eye(3), 2e-4, said, 0.05))
    return out
