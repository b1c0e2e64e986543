"""The camera model: pinhole with Brown-Conrady ("plumb_bob") or rational distortion, and its mount."""

import cv2
import numpy as np
from numpy.typing import NDArray

from landing.errors import LandingError
from landing.rotations import matrix_from_euler

DOWN: NDArray[np.float64] = np.array(((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
"""body_from_camera of a camera that looks down, the top of its image towards the nose."""

_UNDISTORT = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 1e-9)


def body_from_camera(mount_roll: float, mount_pitch: float, mount_yaw: float) -> NDArray[np.float64]:
    """body_from_camera (3, 3) of a downward camera turned in the body frame by angles in radians."""
    return matrix_from_euler(mount_roll, mount_pitch, mount_yaw) @ DOWN


class CameraModel:
    """Pixels to normalised image coordinates and back. Camera frame: x right, y down in the image, z out."""

    def __init__(
        self,
        width: int,
        height: int,
        matrix: NDArray[np.float64],
        distortion: NDArray[np.float64] | None = None,
        body_from_camera: NDArray[np.float64] = DOWN,
    ) -> None:
        """``matrix`` (3, 3) and ``distortion`` (4, 5, 8, 12 or 14,) as OpenCV and ROS have them."""
        self.width, self.height = int(width), int(height)
        self.matrix = np.asarray(matrix, np.float64).reshape(3, 3)
        self.distortion = np.zeros(5) if distortion is None else np.asarray(distortion, np.float64).ravel()
        self.body_from_camera = np.asarray(body_from_camera, np.float64).reshape(3, 3)
        if self.width < 16 or self.height < 16:
            raise LandingError(f"an image of {width} x {height} is too small: at least 16 x 16")
        if not (self.matrix[0, 0] > 0 and self.matrix[1, 1] > 0 and np.isfinite(self.matrix).all()):
            raise LandingError(f"focal lengths {self.matrix[0, 0]}, {self.matrix[1, 1]} must be positive")
        if self.distortion.size not in (4, 5, 8, 12, 14) or not np.isfinite(self.distortion).all():
            raise LandingError(f"{self.distortion.size} distortion coefficients: must be 4, 5, 8, 12 or 14")

        given = np.zeros(12)
        given[: min(12, self.distortion.size)] = self.distortion[:12]
        self._coefficients = tuple(map(float, given))
        self._distorted = bool(given.any())
        self._rational, self._prismatic = bool(given[5:8].any()), bool(given[8:].any())

    @classmethod
    def from_focal(
        cls, width: int, height: int, focal_px: float, body_from_camera: NDArray[np.float64] = DOWN
    ) -> "CameraModel":
        """A camera without distortion whose axis meets the middle of the image."""
        matrix = np.array(
            ((focal_px, 0, (width - 1) / 2), (0, focal_px, (height - 1) / 2), (0, 0, 1)), np.float64
        )
        return cls(width, height, matrix, None, body_from_camera)

    @property
    def focal_px(self) -> float:
        """Geometric mean of the two focal lengths."""
        return float(np.sqrt(self.matrix[0, 0] * self.matrix[1, 1]))

    def undistort(self, points_px: NDArray[np.floating]) -> NDArray[np.float64]:
        """Normalised coordinates (n, 2) of pixels (n, 2)."""
        if len(points_px) == 0:
            return np.empty((0, 2))
        points = np.ascontiguousarray(points_px, np.float64).reshape(-1, 1, 2)
        found = cv2.undistortPoints(points, self.matrix, self.distortion, None, None, None, _UNDISTORT)
        return np.asarray(found, np.float64).reshape(-1, 2)

    def project(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Pixels (n, 2) of normalised coordinates (n, 2)."""
        points = np.asarray(points, np.float64)
        if len(points) and self.distortion[12:].any():
            # a tilted sensor is rare: OpenCV's slower way
            space = np.column_stack((points, np.ones(len(points))))
            pixels, _ = cv2.projectPoints(space, np.zeros(3), np.zeros(3), self.matrix, self.distortion)
            return np.asarray(pixels, np.float64).reshape(-1, 2)
        x, y = points.T
        xd, yd = x, y
        if self._distorted:
            k = self._coefficients
            r2 = x * x + y * y
            radial = 1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))
            if self._rational:
                radial = radial / (1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7])))
            xy2 = 2 * x * y
            xd = x * radial + k[2] * xy2 + k[3] * (r2 + 2 * x * x)
            yd = y * radial + k[2] * (r2 + 2 * y * y) + k[3] * xy2
            if self._prismatic:
                xd, yd = xd + r2 * (k[8] + r2 * k[9]), yd + r2 * (k[10] + r2 * k[11])
        out = np.empty((len(points), 2))
        np.multiply(xd, self.matrix[0, 0], out=out[:, 0])
        np.multiply(yd, self.matrix[1, 1], out=out[:, 1])
        if self.matrix[0, 1]:
            out[:, 0] += self.matrix[0, 1] * yd
        out += self.matrix[:2, 2]
        return out
