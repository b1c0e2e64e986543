"""Raspberry Pi cameras through picamera2, which Raspberry Pi OS installs as python3-picamera2."""

import importlib
import time
from typing import Any

from drivers.cameras.grey import grey_of
from drivers.cameras.interface import CameraFormat, Grab
from drivers.errors import DriverError
from drivers.system.host_clock import from_monotonic_us

DEFAULT_SIZE = (640, 480)
DEFAULT_RATE_HZ = 30.0


class PicameraGrabber:
    """One libcamera sensor; frames carry SensorTimestamp, the start of the frame on CLOCK_BOOTTIME."""

    def __init__(self, number: int, wanted: CameraFormat) -> None:
        self._number = number
        self._wanted = wanted
        self._camera: Any = None
        self._width, self._height = DEFAULT_SIZE

    def open(self) -> None:
        """Start the sensor; raises DriverError when picamera2 or the sensor is missing."""
        try:
            picamera2 = importlib.import_module("picamera2")
        except ImportError as error:
            raise DriverError(
                "picamera2 is not installed: 'apt install python3-picamera2', and make the virtual environment with "
                "--system-site-packages"
            ) from error
        try:
            self._camera = picamera2.Picamera2(self._number)
            self._start(self._camera)
        except (RuntimeError, IndexError, OSError) as error:
            raise DriverError(
                f"Raspberry Pi camera {self._number}: {error}; is its cable in place?"
            ) from error

    def grab(self) -> Grab:
        """The next completed request."""
        try:
            request = self._camera.capture_request()
        except RuntimeError as error:
            raise DriverError(f"Raspberry Pi camera {self._number}: {error}") from error
        try:
            image = grey_of(request.make_array("main"), self._height)[:, : self._width]
            stamp_ns = request.get_metadata()["SensorTimestamp"]
        finally:
            request.release()
        asleep_ns = time.clock_gettime_ns(time.CLOCK_BOOTTIME) - time.monotonic_ns()
        return Grab(image.copy(), from_monotonic_us((stamp_ns - asleep_ns) // 1000))

    def close(self) -> None:
        """Stop the sensor."""
        if self._camera is not None:
            self._camera.stop()
            self._camera.close()

    def _start(self, camera: Any) -> None:
        wanted = self._wanted
        self._width, self._height = (wanted.width, wanted.height) if wanted.width else DEFAULT_SIZE
        frame_us = round(1e6 / (wanted.rate_hz or DEFAULT_RATE_HZ))
        controls: dict[str, Any] = {"FrameDurationLimits": (frame_us, frame_us)}
        if wanted.exposure_us:
            controls |= {"AeEnable": False, "ExposureTime": wanted.exposure_us}
        if wanted.gain >= 0:
            controls["AnalogueGain"] = wanted.gain
        camera.configure(
            camera.create_video_configuration(
                main={"size": (self._width, self._height), "format": "YUV420"},
                controls=controls,
                buffer_count=4,
            )
        )
        camera.start()
