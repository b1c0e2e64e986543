"""What is in the picture beside the ground: the vehicle's skids, its shadow, dirt on the lens, a person who walks by.

Skids and dirt stay where they are in the picture, out of focus at their edges. The shadow lies on the ground in the
sun's direction, however high the vehicle flies: it stands still in the picture while the heading and the attitude do.
A person moves over the ground.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.errors import DriverError
from drivers.simulated.world.lens import Lens

Array = NDArray[np.float64]
Image = NDArray[np.float32]

IN_VIEW = ("nothing", "skids", "shadow", "dirt", "person")

_SKID_AT, _SKID_WIDTH, _SKID_SLANT = 0.07, 0.045, 0.04
"""Middle of a skid from the side, its width, and how much its ends lean inwards, over the picture's width."""
_SKID_GREY, _SKID_GRAIN = 38.0, 14.0
_DIRT_SPOTS, _DIRT_RADIUS, _DIRT_OPAQUE, _DIRT_GREY = 7, (0.02, 0.05), (0.6, 0.95), 70.0
_SUN_FROM_ZENITH, _SHADE = 0.22, 0.45
"""Angle of the sun, rad, so that the shadow is in view of most lenses; light that is left in it."""
_ARM_M, _ARM_WIDTH_M, _ROTOR_M, _HULL_M = 0.3, 0.06, 0.14, 0.13
"""A quadrotor of 0.85 m from tip to tip: its arms, its rotors' discs, its hull."""
_ROTOR_SHADE = 0.5
"""Of the shadow's depth: a turning rotor lets half of the light through."""
_PERSON_M, _PERSON_SPEED, _PERSON_FROM_M = 0.26, 1.2, 3.0


@dataclass(frozen=True, slots=True)
class Seen:
    """Where the camera is: ``position`` (3,) NED m, ``ned_from_camera`` (3, 3), heading rad, height over ground m."""

    position: Array
    ned_from_camera: Array
    heading: float
    height_m: float


class InView:
    """Draws one of ``IN_VIEW`` into pictures. Deterministic by its seed."""

    def __init__(self, kind: str, lens: Lens, seed: int) -> None:
        if kind not in IN_VIEW:
            raise DriverError(f"in view there may be {', '.join(IN_VIEW)}, got {kind!r}")
        self.kind, self._lens = kind, lens
        self._random = np.random.Generator(np.random.SFC64([seed, 77]))
        self._cover: Image | None = None
        self._colour: Image | None = None
        if kind in ("skids", "dirt"):
            self._cover, self._colour = self._skids() if kind == "skids" else self._dirt()
        x, y = lens.rays()
        self._rays = np.stack((x, y, np.ones_like(x)), axis=-1).astype(np.float64)
        self._walk: tuple[Array, Array] | None = None
        self._walk_from_s = 0.0
        self._sun_bearing, self._walk_bearing, self._walk_aside = self._random.uniform(-math.pi, math.pi, 3)

    def draw(self, light: Image, seen: Seen, time_s: float) -> Image:
        """The picture (height, width), grey without noise, with what is in view."""
        if self._cover is not None and self._colour is not None:
            return light + self._cover * (self._colour - light)
        if self.kind == "shadow":
            return light * (1 - np.float32(1 - _SHADE) * self._shadow(seen))
        if self.kind == "person":
            cover = self._person(seen, time_s)
            return light + cover * (np.float32(45.0) - light)
        return light

    @property
    def cover(self) -> Image | None:
        """How opaque what stays in the picture is (height, width), 0 to 1; None where nothing stays."""
        return self._cover

    def _skids(self) -> tuple[Image, Image]:
        """Two tubes from the bottom to the top of the picture."""
        height, width = self._lens.height, self._lens.width
        cover, colour = np.zeros((height, width), np.float32), np.zeros((height, width), np.float32)
        scale = 4
        for mirrored in (False, True):
            big = np.zeros((height * scale, width * scale), np.float32)
            at, lean, half = (part * width * scale for part in (_SKID_AT, _SKID_SLANT, _SKID_WIDTH / 2))
            bottom, top = height * scale, 0.12 * height * scale
            corners = [
                (at - half, bottom),
                (at + half, bottom),
                (at + half + lean, top),
                (at - half + lean, top),
            ]
            cv2.fillPoly(big, [np.rint(np.array(corners)).astype(np.int32)], 1.0)
            small = cv2.resize(big, (width, height), interpolation=cv2.INTER_AREA)
            cover = np.maximum(cover, small[:, ::-1] if mirrored else small)
        grain = self._random.standard_normal((height, width)).astype(np.float32)
        colour[:] = _SKID_GREY + _SKID_GRAIN * cv2.GaussianBlur(grain, (0, 0), 1.5) * 3
        blur = max(0.6, width / 320)
        return np.asarray(cv2.GaussianBlur(cover, (0, 0), blur)), colour

    def _dirt(self) -> tuple[Image, Image]:
        """Drops on the lens: out of focus, and some more opaque than others."""
        height, width = self._lens.height, self._lens.width
        y, x = np.mgrid[0:height, 0:width].astype(np.float32)
        cover = np.zeros((height, width), np.float32)
        for _ in range(_DIRT_SPOTS):
            at = self._random.uniform((0.05, 0.05), (0.95, 0.95)) * (width, height)
            radius = self._random.uniform(*_DIRT_RADIUS) * width
            edge = 0.35 * radius
            away = np.hypot(x - at[0], (y - at[1]) * self._random.uniform(0.7, 1.4))
            cover = np.maximum(
                cover, self._random.uniform(*_DIRT_OPAQUE) * np.clip((radius - away) / edge + 0.5, 0, 1)
            )
        grain = cv2.GaussianBlur(self._random.standard_normal((height, width)), (0, 0), 2.0)
        return cover.astype(np.float32), (_DIRT_GREY + 60 * grain).astype(np.float32)

    def _on_ground(self, seen: Seen) -> Array:
        """Places (height, width, 2) of level ground, north and east of the vehicle, m."""
        rays = self._rays @ seen.ned_from_camera.T
        down = np.maximum(rays[..., 2], 1e-3)
        return np.asarray(rays[..., :2] * (seen.height_m / down)[..., None])

    def _shadow(self, seen: Seen) -> Image:
        """How much of the sun is covered (height, width)."""
        ground = self._on_ground(seen)
        way = seen.height_m * math.tan(_SUN_FROM_ZENITH)
        ground = ground - way * np.array((math.cos(self._sun_bearing), math.sin(self._sun_bearing)))
        c, s = math.cos(seen.heading), math.sin(seen.heading)
        ahead, right = ground[..., 0] * c + ground[..., 1] * s, ground[..., 1] * c - ground[..., 0] * s
        penumbra = max(0.0093 * seen.height_m, seen.height_m / self._lens.focal_px)

        def inside(distance: Array, size: float) -> Array:
            return np.asarray(np.clip((size - distance) / penumbra + 0.5, 0, 1))

        cover = inside(np.hypot(ahead, right), _HULL_M)
        for angle in (math.pi / 4, -math.pi / 4):
            along = ahead * math.cos(angle) + right * math.sin(angle)
            across = right * math.cos(angle) - ahead * math.sin(angle)
            bar = np.minimum(inside(np.abs(across), _ARM_WIDTH_M / 2), inside(np.abs(along), _ARM_M))
            cover = np.maximum(cover, bar)
            for end in (_ARM_M, -_ARM_M):
                disc = _ROTOR_SHADE * inside(np.hypot(along - end, across), _ROTOR_M)
                cover = np.maximum(cover, disc)
        return cover.astype(np.float32)

    def _person(self, seen: Seen, time_s: float) -> Image:
        """Head and shoulders from above: an ellipse that walks across below where the vehicle was first seen."""
        direction = np.array((math.cos(self._walk_bearing), math.sin(self._walk_bearing)))
        if self._walk is None:
            aside = np.array((-direction[1], direction[0])) * self._walk_aside / math.pi
            self._walk = seen.position[:2] + aside - _PERSON_FROM_M * direction, direction
            self._walk_from_s = time_s
        start, direction = self._walk
        gone = _PERSON_SPEED * (time_s - self._walk_from_s)
        # to and fro, so that somebody is there for the whole of a flight
        way = _PERSON_FROM_M - abs(gone % (4 * _PERSON_FROM_M) - 2 * _PERSON_FROM_M) + _PERSON_FROM_M
        at = start + way * direction - seen.position[:2]
        off = self._on_ground(seen) - at
        along, across = off @ direction, off @ np.array((-direction[1], direction[0]))
        edge = seen.height_m / self._lens.focal_px
        away = np.hypot(along / 0.6, across)
        return np.clip((_PERSON_M - away) / edge + 0.5, 0, 1).astype(np.float32)
