"""What stands between the lens and the ground: skids, dirt on the lens, and the vehicle's own shadow on the ground."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.simulated.world.lens import Lens
from drivers.simulated.world.shading import AMBIENT, SUN
from drivers.simulated.world.world import World

Array = NDArray[np.float64]
Image = NDArray[np.float32]

_SKID_GREY, _DIRT_GREY = 32.0, 30.0
_SKID_SHARE = 0.07
"""Width of a skid over that of the picture."""
_SOFT = 0.008
"""Blur of what is close to the lens, over the picture's width."""
_ARM_M, _ROTOR_M, _HUB_M = 0.22, 0.13, 0.12
"""The vehicle from above: its arms' length, the radius of a rotor and of its body."""


@dataclass(frozen=True)
class Obstruction:
    """``skids``: two bars along the sides. ``dirt``: specks on the lens. ``shadow``: the sun shines on the vehicle."""

    skids: bool = False
    dirt: int = 0
    shadow: bool = False


class Obstructed:
    """Puts an obstruction into the light of one lens (height, width)."""

    def __init__(self, what: Obstruction, lens: Lens, seed: int) -> None:
        self.what, self._lens = what, lens
        cover = np.zeros((lens.height, lens.width), np.float32)
        grey = np.full_like(cover, _SKID_GREY)
        rng = np.random.default_rng([seed, 77])
        if what.skids:
            self._skids(cover, rng)
        for _ in range(what.dirt):
            speck = np.zeros_like(cover)
            middle = rng.uniform((0, 0), (lens.width, lens.height))
            radius = rng.uniform(0.02, 0.05) * lens.width
            cv2.circle(speck, tuple(np.rint(middle).astype(int).tolist()), round(radius), 1.0, -1)
            speck = cv2.GaussianBlur(speck, (0, 0), radius / 3) * np.float32(rng.uniform(0.6, 0.95))
            grey = np.where(speck > cover, np.float32(_DIRT_GREY), grey)
            cover = np.maximum(cover, speck)
        self._cover = cv2.GaussianBlur(cover, (0, 0), max(0.5, _SOFT * lens.width))
        self._grey = grey

    def _skids(self, cover: Image, rng: np.random.Generator) -> None:
        """Bars along the body's forward axis at both sides, a little skew."""
        height, width = cover.shape
        forward = self._lens.body_from_camera[0, :2]
        along_x = abs(forward[0]) > abs(forward[1])
        long, short = (width, height) if along_x else (height, width)
        for side in (0.12, 0.88):
            ends = (side + rng.uniform(-0.03, 0.03, 2)) * short
            points = np.array([(-1, ends[0]), (long + 1, ends[1])])
            points = points if along_x else points[:, ::-1]
            first, last = (tuple(np.rint(p).astype(int).tolist()) for p in points)
            cv2.line(cover, first, last, 1.0, max(2, round(_SKID_SHARE * width)))

    def apply(self, light: Image, world: World, position: Array, ned_from_body: Array) -> Image:
        """The light (height, width) that arrives, from a vehicle at a place (3,) NED and an attitude (3, 3)."""
        if self.what.shadow:
            light = light * self._shade(world, position, ned_from_body)
        if self.what.skids or self.what.dirt:
            light = light + self._cover * (self._grey - light)
        return np.asarray(light, np.float32)

    def _shade(self, world: World, position: Array, ned_from_body: Array) -> Image:
        """Share of the light (height, width) that the vehicle leaves; its ground counts as level there."""
        ground = -world.height_at(float(position[0]), float(position[1]))
        shade = np.ones((self._lens.height, self._lens.width), np.float32)
        if not math.isfinite(ground) or ground <= position[2]:
            return shade
        camera = (ned_from_body @ self._lens.body_from_camera).T
        arms = [(math.pi / 4 + k * math.pi / 2) for k in range(4)]
        parts = [(0.0, 0.0, _HUB_M)] + [(_ARM_M * math.cos(a), _ARM_M * math.sin(a), _ROTOR_M) for a in arms]
        around = np.linspace(0, 2 * math.pi, 16, endpoint=False)
        for x, y, radius in parts:
            rim = np.stack(
                [x + radius * np.cos(around), y + radius * np.sin(around), np.zeros_like(around)], axis=1
            )
            from_vehicle = rim @ ned_from_body.T
            down = ground - position[2] - from_vehicle[:, 2]
            # away from the sun, down to the ground
            rays = (from_vehicle + SUN * (down / SUN[2])[:, None]) @ camera.T
            if (rays[:, 2] <= 0.01).any() or np.abs(rays[:, :2] / rays[:, 2:]).max() > 2:
                continue
            pixels = self._lens.project(rays[:, :2] / rays[:, 2:])
            cv2.fillConvexPoly(shade, np.rint(pixels * 16).astype(np.int32), AMBIENT, cv2.LINE_AA, 4)
        return np.asarray(cv2.GaussianBlur(shade, (0, 0), 0.8), np.float32)
