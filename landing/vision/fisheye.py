"""The equidistant ("fisheye") lens of Kannala and Brandt (2006), as cv2.fisheye and ROS have it.

A ray at the angle theta off the axis meets the image at theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 +
k4 theta^8) focal lengths from the principal point.
"""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LARGEST_ANGLE = math.radians(85.0)
"""Rays further off the axis than this have no useful normalised coordinates: they are moved to this angle."""

_NEWTON = 3
"""Steps from a table's angle to the exact one."""
_FLAT = 1e-3
"""Least slope of theta_d that a step divides by."""
_STEPS = 2000
_SMALL = 1e-8


class Fisheye:
    """The lens by its camera matrix (3, 3), without skew, and k1 to k4."""

    def __init__(self, matrix: Array, distortion: Array) -> None:
        self._matrix, self._distortion = matrix, distortion
        self._focal, self._centre = np.diag(matrix)[:2], matrix[:2, 2]
        self._k1, self._k2, self._k3, self._k4 = map(float, distortion)
        theta = np.linspace(0, LARGEST_ANGLE, _STEPS)
        falls = np.flatnonzero(np.diff(self._distorted(theta)) <= 0)
        self.largest_angle = float(theta[falls[0]]) if len(falls) else LARGEST_ANGLE
        """Up to this angle, in rad, the image moves outwards with the ray."""
        self._largest = float(self._distorted(np.array(self.largest_angle)))
        self._angles = np.linspace(0, self.largest_angle, _STEPS)
        self._radii = self._distorted(self._angles)

    def undistort(self, points_px: NDArray[np.floating]) -> Array:
        """Normalised coordinates (n, 2) of pixels (n, 2); those beyond ``largest_angle`` are moved there."""
        across = (np.asarray(points_px, np.float64) - self._centre) / self._focal
        radius = np.hypot(*across.T)
        beyond = radius > self._largest
        # cv2.fisheye.undistortPoints ends at theta_d = pi / 2, which wide lenses exceed
        wanted = np.minimum(radius, self._largest)
        theta: Array = np.asarray(np.interp(wanted, self._radii, self._angles), np.float64)
        for _ in range(_NEWTON):
            step = (self._distorted(theta) - wanted) / np.maximum(self._slope(theta), _FLAT)
            theta = np.asarray(np.clip(theta - step, 0.0, self.largest_angle), np.float64)
        theta[beyond] = self.largest_angle
        scale = np.ones_like(radius)
        np.divide(np.tan(theta), radius, out=scale, where=radius > _SMALL)
        return np.asarray(across * scale[:, None], np.float64)

    def project(self, points: NDArray[np.floating]) -> Array:
        """Pixels (n, 2) of normalised coordinates (n, 2)."""
        radius = np.hypot(*points.T)
        scale = np.ones_like(radius)
        np.divide(self._distorted(np.arctan(radius)), radius, out=scale, where=radius > _SMALL)
        return np.asarray(points * scale[:, None] * self._focal + self._centre, np.float64)

    def scales(self, points: Array) -> tuple[Array, Array, Array]:
        """Direction (n, 2) away from the axis, and pixels a normalised unit (n,) along it and across it."""
        radius = np.hypot(*points.T)
        away = np.zeros_like(points)
        away[:, 0] = 1.0
        np.divide(points, radius[:, None], out=away, where=radius[:, None] > _SMALL)
        theta = np.arctan(radius)
        slope = self._slope(theta)
        across = np.ones_like(radius)
        np.divide(self._distorted(theta), radius, out=across, where=radius > _SMALL)
        focal = float(np.sqrt(self._focal.prod()))
        return away, focal * np.maximum(slope, 0.0) * np.cos(theta) ** 2, focal * across

    def _slope(self, theta: Array) -> Array:
        """Change of theta_d with theta."""
        t2 = theta * theta
        return np.asarray(
            1 + t2 * (3 * self._k1 + t2 * (5 * self._k2 + t2 * (7 * self._k3 + t2 * 9 * self._k4))),
            np.float64,
        )

    def _distorted(self, theta: Array) -> Array:
        t2 = theta * theta
        return np.asarray(
            theta * (1 + t2 * (self._k1 + t2 * (self._k2 + t2 * (self._k3 + t2 * self._k4)))), np.float64
        )


def whitened(whitener_px: Array, away: Array, along: Array, across: Array) -> Array:
    """C (3, n) of matches in normalised units from that in pixels, both as in ``TrackPair``.

    The information in pixels is turned by the Jacobian of the projection: ``along`` px a unit in the direction
    ``away`` (n, 2), ``across`` px at right angles to it.
    """
    c11, c12, c22 = whitener_px
    x, y = away.T
    jxx, jyy = along * x * x + across * y * y, along * y * y + across * x * x
    jxy = (along - across) * x * y
    m11, m12 = c11 * jxx + c12 * jxy, c11 * jxy + c12 * jyy
    m21, m22 = c22 * jxy, c22 * jyy
    out = np.empty_like(whitener_px)
    np.sqrt(m11 * m11 + m21 * m21, out=out[0])
    np.divide(m11 * m12 + m21 * m22, np.maximum(out[0], 1e-12), out=out[1])
    np.sqrt(np.maximum(m12 * m12 + m22 * m22 - out[1] * out[1], 1e-12), out=out[2])
    return out
