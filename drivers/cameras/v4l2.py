"""V4L2 devices through OpenCV, with the kernel's own time stamps.

OpenCV keeps the stamp of the buffer it dequeued last and gives it as CAP_PROP_POS_MSEC (its cap_v4l.cpp). Nearly every
driver stamps with CLOCK_MONOTONIC; one that does not is noticed, and the arrival stands in for its stamps.
"""

import logging
import os
from pathlib import Path

import cv2
import numpy as np

from drivers.cameras.grey import MOST_BROKEN, grey_of, grey_of_jpeg
from drivers.cameras.interface import CameraFormat, Grab
from drivers.errors import DriverError
from drivers.system.host_clock import from_monotonic_us, now_us

log = logging.getLogger(__name__)

MAX_STAMP_AGE_US = 1_000_000
"""A stamp older than this at its arrival, or from the future, is not one of CLOCK_MONOTONIC."""

MANUAL_EXPOSURE = 1
"""V4L2_EXPOSURE_MANUAL."""

EXPOSURE_UNIT_US = 100
"""V4L2_CID_EXPOSURE_ABSOLUTE counts in these."""

LUMA_FIRST = ("GREY", "YUYV", "NV12", "NV21", "YU12", "YV12")
"""Pixel formats whose grey is taken as it is, without a way through BGR."""


JPEG = ("MJPG", "JPEG")


class V4l2Grabber:
    """One video device, opened with what can be fixed fixed."""

    def __init__(self, device: str, wanted: CameraFormat) -> None:
        self._device = device
        self._wanted = wanted
        self._capture: cv2.VideoCapture | None = None
        self._grey_rows = 0
        self._stamps_usable = True

    def open(self) -> None:
        """Open and set up; raises DriverError when the device is missing, busy or not permitted."""
        path = Path(self._device)
        if not path.exists():
            raise DriverError(
                f"{self._device}: no such camera; is it plugged in? ('v4l2-ctl --list-devices')"
            )
        if not os.access(path, os.R_OK | os.W_OK):
            raise DriverError(f"{self._device}: no permission; the user must be in the group 'video'")
        capture = cv2.VideoCapture(self._device, cv2.CAP_V4L2)
        self._capture = capture
        if not capture.isOpened():
            raise DriverError(f"{self._device}: cannot be opened; another program may hold it")
        self._set_up(capture)

    def grab(self) -> Grab:
        """The next buffer; OpenCV waits 10 s for one at most."""
        for _ in range(MOST_BROKEN):
            found = self._next()
            if found is not None:
                return found
        raise DriverError(f"{self._device}: {MOST_BROKEN} frames in a row are broken")

    def _next(self) -> Grab | None:
        capture = self._capture
        if capture is None or not capture.grab():
            raise DriverError(f"{self._device}: gives no frames any more; unplugged?")
        arrival_us = now_us()
        stamp_us = from_monotonic_us(round(capture.get(cv2.CAP_PROP_POS_MSEC) * 1000))
        taken, image = capture.retrieve()
        if not taken:
            raise DriverError(f"{self._device}: a frame could not be decoded")
        captured_us = self._checked(stamp_us, arrival_us)
        if self._wanted.pixel_format not in JPEG or (image.ndim == 3 and image.shape[2] == 3):
            return Grab(grey_of(image, self._grey_rows), captured_us)
        grey = grey_of_jpeg(np.asarray(image, np.uint8))
        return None if grey is None else Grab(grey, captured_us)

    def close(self) -> None:
        """Give the device back."""
        if self._capture is not None:
            self._capture.release()

    def _checked(self, stamp_us: int, arrival_us: int) -> int:
        if self._stamps_usable and not 0 <= arrival_us - stamp_us <= MAX_STAMP_AGE_US:
            self._stamps_usable = False
            log.warning(
                "%s stamps its frames %.3f s away from the monotonic clock; their arrival counts instead",
                self._device,
                (stamp_us - arrival_us) * 1e-6,
            )
        return stamp_us if self._stamps_usable else arrival_us

    def _set_up(self, capture: cv2.VideoCapture) -> None:
        wanted = self._wanted
        if wanted.pixel_format:
            self._ask(
                capture, cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*wanted.pixel_format), "pixel format"
            )
        if wanted.width and wanted.height:
            capture.set(cv2.CAP_PROP_FRAME_WIDTH, wanted.width)
            capture.set(cv2.CAP_PROP_FRAME_HEIGHT, wanted.height)
            size = capture.get(cv2.CAP_PROP_FRAME_WIDTH), capture.get(cv2.CAP_PROP_FRAME_HEIGHT)
            if size != (wanted.width, wanted.height):
                raise DriverError(
                    f"{self._device}: gives {size[0]:g} x {size[1]:g}, not the {wanted.width} x {wanted.height} of "
                    "camera.width and camera.height; 'v4l2-ctl --list-formats-ext' shows its sizes"
                )
        if wanted.rate_hz:
            self._ask(capture, cv2.CAP_PROP_FPS, wanted.rate_hz, "rate")
        if wanted.exposure_us:
            self._ask(capture, cv2.CAP_PROP_AUTO_EXPOSURE, MANUAL_EXPOSURE, "manual exposure")
            units = max(1, round(wanted.exposure_us / EXPOSURE_UNIT_US))
            self._ask(capture, cv2.CAP_PROP_EXPOSURE, units, "exposure")
        if wanted.gain >= 0:
            self._ask(capture, cv2.CAP_PROP_GAIN, wanted.gain, "gain")
        if wanted.pixel_format in JPEG:
            capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        elif wanted.pixel_format in LUMA_FIRST:
            capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
            self._grey_rows = round(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))

    def _ask(self, capture: cv2.VideoCapture, prop: int, value: float, name: str) -> None:
        capture.set(prop, value)
        got = capture.get(prop)
        if got != value:
            log.warning("%s: asked for %s %g, the camera has %g", self._device, name, value, got)
