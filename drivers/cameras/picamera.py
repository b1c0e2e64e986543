"""Raspberry Pi cameras through picamera2, which Raspberry Pi OS installs as python3-picamera2."""

import importlib
import time
from typing import Any

import numpy

from drivers.cameras.grey import grey_of
from drivers.cameras.interface import CameraFormat, Grab
from drivers.errors import DriverError
from drivers.system.host_clock import from_monotonic_us

DEFAULT_SIZE = (640, 480)
DEFAULT_RATE_HZ = 30.0
ABI_WORDS = ("numpy.dtype size changed", "_ARRAY_API", "multiarray", "compiled using NumPy", "numpy.core")
"""What an extension says that was compiled for another numpy."""


class PicameraGrabber:
    """One libcamera sensor; frames carry SensorTimestamp, the start of the frame on CLOCK_BOOTTIME."""

    def __init__(self, number: int, wanted: CameraFormat) -> None:
        self._number = number
        self._wanted = wanted
        self._camera: Any = None
        self._width, self._height = DEFAULT_SIZE

    def open(self) -> None:
        """Start the sensor; raises DriverError when picamera2 or the sensor is missing."""
        picamera2 = _imported()
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


def _imported() -> Any:
    """picamera2, or a DriverError that says which package is in the way and what to do."""
    try:
        return importlib.import_module("picamera2")
    except Exception as error:  # foreign packages fail to import in any way they like
        text, remedy = _import_trouble(error)
        raise DriverError(f"{text}: {remedy}", remedy) from error


def _import_trouble(error: Exception) -> tuple[str, str]:
    """What is wrong with an import of picamera2, and what to do."""
    missing = error.name or "" if isinstance(error, ModuleNotFoundError) else ""
    said = " ".join(str(error).split())[:200]
    if missing == "picamera2":
        remedy = (
            "'apt install python3-picamera2', and make the virtual environment with --system-site-packages"
        )
        return "picamera2 is not installed", remedy
    if missing:
        return (
            f"picamera2 needs the package '{missing}'",
            f"'apt install python3-{missing.partition('.')[0]}'",
        )
    if any(word in said for word in ABI_WORDS):
        remedy = (
            'take the frames from the system\'s own program: camera.source = "rtsp://..." or "tcp://127.0.0.1:8888" '
            "of 'rpicam-vid --listen', or use a system whose python3-numpy has this major version"
        )
        version = numpy.__version__
        return (
            f"the system's picamera2 was built for another numpy than the {version} of this environment",
            remedy,
        )
    return (
        f"picamera2 cannot be imported ({type(error).__name__}: {said})",
        "'apt install --reinstall python3-picamera2'",
    )
