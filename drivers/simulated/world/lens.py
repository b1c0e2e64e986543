"""The simulated camera's geometry: the exact viewing ray of every point of the image."""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.errors import DriverError

Array = NDArray[np.float64]

DOWN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""body_from_camera of a camera that looks down, the image's top towards the nose."""

FIXED_POINT = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 1e-9)


WIDEST = float(np.radians(85))
"""Largest distance from the axis, as an angle over the focal length, that an equidistant lens may show."""


@dataclass(frozen=True)
class Lens:
    """A camera as it is calibrated: ``matrix`` (3, 3) in px, ``distortion`` OpenCV's coefficients (plumb_bob: 5).

    ``equidistant``: a wide lens, its distortion the four coefficients of cv2.fisheye. ``body_from_camera`` (3, 3) is
    the mount. Pixel (0, 0) is the middle of the first pixel.
    """

    width: int
    height: int
    matrix: Array
    distortion: Array = field(default_factory=lambda: np.zeros(5))
    body_from_camera: Array = field(default_factory=lambda: DOWN.copy())
    equidistant: bool = False

    def __post_init__(self) -> None:
        if self.width < 8 or self.height < 8:
            raise DriverError(f"a simulated image needs at least 8 x 8 px, got {self.width} x {self.height}")
        if np.shape(self.matrix) != (3, 3) or min(self.matrix[0, 0], self.matrix[1, 1]) <= 0:
            raise DriverError("the camera matrix must be 3 x 3 with positive focal lengths")
        if self.equidistant and np.size(self.distortion) != 4:
            raise DriverError(
                f"an equidistant lens has 4 distortion coefficients, got {np.size(self.distortion)}"
            )

    @classmethod
    def from_fov(
        cls,
        width: int,
        height: int,
        fov_deg: float,
        body_from_camera: Array | None = None,
        *,
        equidistant: bool = False,
    ) -> "Lens":
        """A lens without distortion, ``fov_deg`` across, its axis through the image's middle."""
        if not 1 < fov_deg < 170:
            raise DriverError(f"the field of view must lie between 1 and 170 deg, got {fov_deg}")
        half = float(np.radians(fov_deg) / 2)
        focal = 0.5 * width / (half if equidistant else float(np.tan(half)))
        matrix = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
        mount = DOWN.copy() if body_from_camera is None else body_from_camera
        distortion = np.zeros(4 if equidistant else 5)
        return cls(width, height, matrix, distortion, mount, equidistant)

    @property
    def straight(self) -> bool:
        """Whether straight lines stay straight in the image."""
        return not self.equidistant and not np.any(self.distortion)

    @property
    def focal_px(self) -> float:
        """Focal length along the rows."""
        return float(self.matrix[0, 0])

    def rays(self, samples: int = 1) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """x and y = X/Z, each (height * samples, width * samples), of a ``samples`` x ``samples`` grid in every pixel.

        The inverse of the distortion by Newton's iteration, to 1e-7 px; a lens whose distortion has no
        inverse in the image is refused.
        """
        u = (np.arange(self.width * samples) + 0.5) / samples - 0.5
        v = (np.arange(self.height * samples) + 0.5) / samples - 0.5
        pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
        points = self.undistort(pixels)
        shape = (self.height * samples, self.width * samples)
        x, y = points.astype(np.float32).T
        return np.ascontiguousarray(x.reshape(shape)), np.ascontiguousarray(y.reshape(shape))

    def project(self, points: Array) -> Array:
        """Normalised (n, 2) to pixels (n, 2), with distortion."""
        solid = np.concatenate([points, np.ones((len(points), 1))], axis=1)
        zero = np.zeros(3)
        if self.equidistant:
            pixels, _ = cv2.fisheye.projectPoints(
                solid[:, None], zero, zero, self.matrix, np.asarray(self.distortion, np.float64)
            )
        else:
            pixels, _ = cv2.projectPoints(solid, zero, zero, self.matrix, self.distortion)
        return np.asarray(pixels, dtype=np.float64).reshape(-1, 2)

    def undistort(self, pixels: Array) -> Array:
        """Pixels (n, 2) to normalised (n, 2): the inverse of ``project``."""
        inverse = np.linalg.inv(self.matrix)
        points = pixels @ inverse[:2, :2].T + inverse[:2, 2]
        if self.straight:
            return points
        start = np.ascontiguousarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
        if self.equidistant:
            far = float(np.hypot(*points.T).max())
            if far > WIDEST:
                raise DriverError(
                    f"an equidistant lens of {self.focal_px:.1f} px shows {np.degrees(far):.0f} degrees off the axis "
                    f"in the corners of {self.width} x {self.height}, {np.degrees(WIDEST):.0f} at most: choose a "
                    "smaller field of view"
                )
            rough = cv2.fisheye.undistortPoints(
                start, self.matrix, np.asarray(self.distortion, np.float64), criteria=FIXED_POINT
            )
        else:
            rough = cv2.undistortPoints(start, self.matrix, self.distortion, None, None, None, FIXED_POINT)
        points = np.asarray(rough, dtype=np.float64).reshape(-1, 2)
        epsilon = 1e-6
        left = np.arange(len(points))
        for _ in range(15):
            here = self.project(points[left])
            error = here - pixels[left]
            open_ = ~(np.abs(error).max(axis=1) < 1e-7)
            if not open_.any():
                return points
            left, here, error = left[open_], here[open_], error[open_]
            right = (self.project(points[left] + np.array([epsilon, 0.0])) - here) / epsilon
            below = (self.project(points[left] + np.array([0.0, epsilon])) - here) / epsilon
            determinant = right[:, 0] * below[:, 1] - right[:, 1] * below[:, 0]
            if not np.abs(determinant).min() > 1e-9:
                break
            points[left] -= np.stack(
                [
                    (below[:, 1] * error[:, 0] - below[:, 0] * error[:, 1]) / determinant,
                    (right[:, 0] * error[:, 1] - right[:, 1] * error[:, 0]) / determinant,
                ],
                axis=1,
            )
        raise DriverError(
            f"the lens distortion {np.ravel(self.distortion).tolist()} has no inverse over the whole "
            f"{self.width} x {self.height} image; check the coefficients"
        )
