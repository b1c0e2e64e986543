"""The camera model: pinhole with Brown-Conrady ("plumb_bob") or rational distortion, or equidistant, and its mount."""

import cv2
import numpy as np
from numpy.typing import NDArray

from landing.errors import LandingError
from landing.rotations import matrix_from_euler
from landing.vision.fisheye import Fisheye, whitened

DOWN: NDArray[np.float64] = np.array(((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
"""body_from_camera of a camera that looks down, the top of its image towards the nose."""

_UNDISTORT = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 1e-6)

_FEW = 32
_NOWHERE = np.zeros(3)


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
        readout_s: float | None = 0.0,
        *,
        equidistant: bool = False,
        intrinsics_covariance: NDArray[np.float64] | None = None,
        mask: NDArray[np.bool_] | None = None,
    ) -> None:
        """``matrix`` (3, 3) and ``distortion`` (4, 5, 8, 12 or 14,) as OpenCV and ROS have them.

        ``mask`` (height, width): pixels that never show the ground.

        ``equidistant``: a wide lens, ``distortion`` (4,) as of cv2.fisheye. ``readout_s``: time from the first row's
        exposure to the last's; 0: global shutter, negative: the last row is exposed first, None: not known.
        ``intrinsics_covariance``: of the errors of fx, fy, cx, cy and the distortion (4 + k, 4 + k), None: not known.
        """
        self.readout_s = readout_s
        self.intrinsics_covariance = intrinsics_covariance
        self.width, self.height = int(width), int(height)
        self.mask = None if mask is None else np.asarray(mask, bool)
        if self.mask is not None and self.mask.shape != (self.height, self.width):
            raise LandingError(
                f"the mask is {self.mask.shape[1]} x {self.mask.shape[0]}, the camera gives {width} x {height}"
            )
        self.matrix = np.asarray(matrix, np.float64).reshape(3, 3)
        self.distortion = np.zeros(5) if distortion is None else np.asarray(distortion, np.float64).ravel()
        self.body_from_camera = np.asarray(body_from_camera, np.float64).reshape(3, 3)
        if intrinsics_covariance is not None:
            size = 4 + self.distortion.size
            if intrinsics_covariance.shape != (size, size) or not np.isfinite(intrinsics_covariance).all():
                raise LandingError(
                    f"the intrinsics' covariance is {intrinsics_covariance.shape}: must be ({size}, {size}), finite"
                )
        if self.width < 16 or self.height < 16:
            raise LandingError(f"an image of {width} x {height} is too small: at least 16 x 16")
        if not (self.matrix[0, 0] > 0 and self.matrix[1, 1] > 0 and np.isfinite(self.matrix).all()):
            raise LandingError(f"focal lengths {self.matrix[0, 0]}, {self.matrix[1, 1]} must be positive")
        if self.distortion.size not in (4, 5, 8, 12, 14) or not np.isfinite(self.distortion).all():
            raise LandingError(f"{self.distortion.size} distortion coefficients: must be 4, 5, 8, 12 or 14")
        self.fisheye: Fisheye | None = None
        """The lens, where it is an equidistant one."""
        if equidistant:
            if distortion is None:
                self.distortion = np.zeros(4)
            if self.distortion.size != 4 or self.matrix[0, 1] != 0:
                raise LandingError(
                    f"an equidistant lens with {self.distortion.size} distortion coefficients and skew "
                    f"{self.matrix[0, 1]:g}: must be 4 coefficients and no skew"
                )
            self.fisheye = Fisheye(self.matrix, self.distortion)

        given = np.zeros(12)
        given[: min(12, self.distortion.size)] = self.distortion[:12]
        self._coefficients = tuple(map(float, given))
        self._distorted = bool(given.any())
        self._rational, self._prismatic = bool(given[5:8].any()), bool(given[8:].any())
        k = self._coefficients
        self._tangential = np.array((2 * k[3], 2 * k[2]))
        # pixels of (x, y, r2, 1) of the distorted points
        of_r2 = np.array((k[3] + k[8], k[2] + k[10], 0.0))
        self._pixel_from_distorted = np.column_stack(
            (self.matrix[:, :2], self.matrix @ of_r2, self.matrix[:, 2])
        )[:2]

    @classmethod
    def from_focal(
        cls,
        width: int,
        height: int,
        focal_px: float,
        body_from_camera: NDArray[np.float64] = DOWN,
        readout_s: float | None = 0.0,
        mask: NDArray[np.bool_] | None = None,
    ) -> "CameraModel":
        """A camera without distortion whose axis meets the middle of the image."""
        matrix = np.array(
            ((focal_px, 0, (width - 1) / 2), (0, focal_px, (height - 1) / 2), (0, 0, 1)), np.float64
        )
        return cls(width, height, matrix, None, body_from_camera, readout_s, mask=mask)

    def barred(self, margin_px: int) -> NDArray[np.bool_] | None:
        """Pixels (height, width) with one of the mask within ``margin_px`` in rows and columns; None without a mask."""
        if self.mask is None:
            return None
        side = 2 * margin_px + 1
        return cv2.dilate(self.mask.astype(np.uint8), np.ones((side, side), np.uint8)).view(bool)

    def resized(self, width: int, height: int) -> "CameraModel":
        """The same camera with pictures of another size; a pixel that holds any of the mask is of the mask."""
        sx, sy = width / self.width, height / self.height
        # the middle of the first pixel is (0, 0)
        scaled = np.array(((sx, 0, (sx - 1) / 2), (0, sy, (sy - 1) / 2), (0, 0, 1)))
        mask = self.mask
        if mask is not None:
            shares = cv2.resize(mask.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
            mask = np.asarray(shares > 0, np.bool_)
        return CameraModel(
            width,
            height,
            scaled @ self.matrix,
            self.distortion,
            self.body_from_camera,
            self.readout_s,
            equidistant=self.equidistant,
            mask=mask,
        )

    def changed(self, change: NDArray[np.float64]) -> "CameraModel":
        """The same camera with fx, fy, cx, cy and the distortion changed by ``change`` (4 + k,)."""
        matrix = self.matrix.copy()
        matrix[(0, 1, 0, 1), (0, 1, 2, 2)] += change[:4]
        return CameraModel(
            self.width, self.height, matrix, self.distortion + change[4:], equidistant=self.equidistant
        )

    @property
    def equidistant(self) -> bool:
        """Whether it is a wide lens, with the distortion of cv2.fisheye."""
        return self.fisheye is not None

    @property
    def focal_px(self) -> float:
        """Geometric mean of the two focal lengths."""
        return float(np.sqrt(self.matrix[0, 0] * self.matrix[1, 1]))

    def undistort(self, points_px: NDArray[np.floating]) -> NDArray[np.float64]:
        """Normalised coordinates (n, 2) of pixels (n, 2)."""
        if len(points_px) == 0:
            return np.empty((0, 2))
        if self.fisheye is not None:
            return self.fisheye.undistort(points_px)
        points = np.ascontiguousarray(points_px, np.float64).reshape(-1, 1, 2)
        found = cv2.undistortPoints(points, self.matrix, self.distortion, None, None, None, _UNDISTORT)
        return np.asarray(found, np.float64).reshape(-1, 2)

    def project(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Pixels (n, 2) of normalised coordinates (n, 2)."""
        points = np.asarray(points, np.float64)
        if self.fisheye is not None:
            return self.fisheye.project(points)
        if 0 < len(points) <= _FEW or (len(points) and self.distortion[12:].any()):
            # OpenCV's own way is the slower one for many points; it alone knows a tilted sensor
            space = np.ones((len(points), 1, 3))
            space[:, 0, :2] = points
            pixels, _ = cv2.projectPoints(space, _NOWHERE, _NOWHERE, self.matrix, self.distortion)
            return np.asarray(pixels, np.float64).reshape(-1, 2)
        n, p = len(points), self._pixel_from_distorted
        if not self._distorted:
            return np.dot(points, p[:, :2].T) + p[:, 3]
        k = self._coefficients
        # of each point: its distorted x and y but for what grows with r2 alone, r2 and one
        parts = np.empty((4, n))
        xy, r2 = parts[:2], parts[2]
        np.multiply(points.T, points.T, out=xy)
        np.add(xy[0], xy[1], out=r2)
        parts[3] = 1.0
        xy[:] = points.T
        # the tangential terms are x times f and y times f, and r2
        factor = np.dot(self._tangential, xy)
        radial = _polynomial(r2, k[0], k[1], k[4])
        if self._rational:
            radial /= _polynomial(r2, k[5], k[6], k[7])
        factor += radial
        xy *= factor
        if self._prismatic:
            xy += np.multiply.outer((k[9], k[11]), r2 * r2)
        return np.dot(parts.T, p.T)

    def whitener(self, whitener_px: NDArray[np.float64], pixels: NDArray[np.floating]) -> NDArray[np.float64]:
        """C (3, n) of matches at ``pixels`` (n, 2), as in ``TrackPair``, from that in pixels.

        A wide lens shows the same angle in far fewer normalised units at its axis than at the border.
        """
        if self.fisheye is None:
            return whitener_px * self.focal_px
        return whitened(whitener_px, *self.fisheye.scales(self.fisheye.undistort(pixels)))


def _polynomial(r2: NDArray[np.float64], first: float, second: float, third: float) -> NDArray[np.float64]:
    """1 + first r2 + second r2^2 + third r2^3."""
    out = r2 * third if third else np.zeros_like(r2)
    for factor in (second, first):
        out += factor
        out *= r2
    out += 1.0
    return out
