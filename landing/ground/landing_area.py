"""Whether the ground that the vehicle will land on is seen at all, and finely enough."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from landing.estimate import SurfaceEstimate
from landing.options import DecisionOptions, TrackingOptions
from landing.vision.camera import CameraModel

Array = NDArray[np.float64]

_RINGS = ((0.0, 1), (1 / 3, 6), (2 / 3, 12), (1.0, 18))
"""Places in a disc by rings: radius over that of the disc, how many."""
_DISC = np.array(
    [(r * math.cos(a), r * math.sin(a)) for r, n in _RINGS for a in np.arange(n) * 2 * math.pi / n]
)
_NEAR = 1.4
"""A place is measured when a track lies within this many times the usual distance between tracks."""


@dataclass(frozen=True, slots=True)
class AreaSeen:
    """``measured``: share of the landing area near tracks whose height over the plane is known.

    ``patch_m``: side of the ground that one track averages over, NaN where the height is unknown; what is smaller
    shows with less than its height.
    """

    measured: float
    patch_m: float


class LandingArea:
    """The disc of ``options.landing_radius_m`` on the ground straight below, as the camera sees it."""

    def __init__(self, camera: CameraModel, options: DecisionOptions, tracking: TrackingOptions) -> None:
        self.options, self._camera = options, camera
        self._window = tracking.window_px / camera.focal_px
        spacing_px = math.sqrt(camera.width * camera.height / tracking.max_features)
        self._margin_px = tracking.window_px / 2
        self._reach_px = max(_NEAR * spacing_px, self._margin_px)

    def look(self, estimate: SurfaceEstimate) -> AreaSeen:
        """What is seen of it at an estimate with status "ok" and an attitude.

        Without a height the size of the disc in the picture is unknown, and only its centre is asked for.
        """
        tracks, patch_m = estimate.tracks, self.patch_m(estimate.height_m)
        places = self._places(estimate)
        if places is None or tracks is None:
            return AreaSeen(0.0, patch_m)
        tracked = tracks.current_px[np.isfinite(tracks.height)]
        if not len(tracked):
            return AreaSeen(0.0, patch_m)
        away = places[:, None] - tracked
        near = np.einsum("ijk,ijk->ij", away, away).min(axis=1) <= self._reach_px**2
        return AreaSeen(float(near.mean()), patch_m)

    def patch_m(self, height_m: float) -> float:
        """Side of the ground under one track's window from ``height_m`` along the axis."""
        return self._window * height_m

    def in_view(self, estimate: SurfaceEstimate) -> float:
        """Share of the disc that lies where a track can be, whether there are any or not."""
        places = self._places(estimate)
        if places is None:
            return 0.0
        far_side = np.array((self._camera.width, self._camera.height)) - 1 - self._margin_px
        return float(((places >= self._margin_px) & (places <= far_side)).all(axis=1).mean())

    def _places(self, estimate: SurfaceEstimate) -> Array | None:
        """Pixels (n, 2) of the disc's places; None where the ground below does not lie before the camera."""
        roll, pitch = math.radians(estimate.roll_deg), math.radians(estimate.pitch_deg)
        in_body = (-math.sin(pitch), math.sin(roll) * math.cos(pitch), math.cos(roll) * math.cos(pitch))
        down = self._camera.body_from_camera.T @ np.array(in_body)
        a, b = (math.tan(math.radians(s)) for s in (estimate.slope_x_deg, estimate.slope_y_deg))
        # Z = h + aX + bY, met by the ray straight down after this way, over the distance h along the axis
        slant = float(down[2] - a * down[0] - b * down[1])
        if not (slant > 0 and down[2] > 0):
            return None
        below = down[None] / slant
        if math.isfinite(estimate.height_m):
            # any two axes across the vertical: y x down, and down x that
            x, _, z = down.tolist()
            length = math.hypot(x, z)
            first = np.array((z, 0.0, -x)) / length
            level = np.stack((first, down[[1, 2, 0]] * first[[2, 0, 1]] - down[[2, 0, 1]] * first[[1, 2, 0]]))
            below = below + self.options.landing_radius_m / estimate.height_m * (_DISC @ level)
        ahead = below[:, 2] > 0
        if not ahead.all():
            return None
        return self._camera.project(below[:, :2] / below[:, 2:])
