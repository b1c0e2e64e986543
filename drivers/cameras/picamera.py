"""Raspberry Pi cameras through picamera2, which Raspberry Pi OS installs as python3-picamera2.

It runs in a process of the system's own Python: built for the system's numpy, it does not import beside ours.
"""

import json
import subprocess
import time
from pathlib import Path
from typing import IO

import numpy as np

from drivers.cameras import picamera_helper as helper
from drivers.cameras.interface import CameraFormat, Grab
from drivers.errors import DriverError
from drivers.system.host_clock import from_monotonic_us

SYSTEM_PYTHON = Path("/usr/bin/python3")
DEFAULT_SIZE = (640, 480)
DEFAULT_RATE_HZ = 30.0
CLOSE_S = 2.0
LARGEST_BYTES = 100_000_000
ABI_WORDS = ("numpy.dtype size changed", "_ARRAY_API", "multiarray", "compiled using NumPy", "numpy.core")
"""What an extension says that was compiled for another numpy."""


class PicameraGrabber:
    """One libcamera sensor; frames carry SensorTimestamp, the start of the frame on CLOCK_BOOTTIME."""

    def __init__(self, number: int, wanted: CameraFormat) -> None:
        self._number = number
        self._wanted = wanted
        self._process: subprocess.Popen[bytes] | None = None
        self._first: Grab | None = None
        self._width = 0

    def open(self) -> None:
        """Start the sensor and await its first frame; raises DriverError when picamera2 or the sensor is missing."""
        wanted = self._wanted
        width, height = (wanted.width, wanted.height) if wanted.width else DEFAULT_SIZE
        self._width = width
        frame_us = round(1e6 / (wanted.rate_hz or DEFAULT_RATE_HZ))
        numbers = (self._number, width, height, frame_us, wanted.exposure_us, wanted.gain)
        # -I: neither the user's packages nor this folder's modules come in the way of the system's.
        command = [str(SYSTEM_PYTHON), "-I", helper.__file__, *map(str, numbers)]
        try:
            self._process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE)
        except OSError as error:
            remedy = "'apt install python3 python3-picamera2'"
            raise DriverError(f"{SYSTEM_PYTHON}: {error.strerror}: {remedy}", remedy) from error
        try:
            self._first = self._read()
        except DriverError:
            self.close()
            raise

    def grab(self) -> Grab:
        """The next frame."""
        first, self._first = self._first, None
        return first or self._read()

    def close(self) -> None:
        """Stop the sensor."""
        process, self._process, self._first = self._process, None, None
        if process is None:
            return
        process.terminate()
        try:
            process.wait(CLOSE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        if process.stdout is not None:
            process.stdout.close()

    def _read(self) -> Grab:
        process = self._process
        if process is None or process.stdout is None:
            raise DriverError(f"Raspberry Pi camera {self._number}: it is closed")
        pipe = process.stdout
        kind = self._bytes(pipe, len(helper.MAGIC))
        if kind == helper.FAULT:
            (length,) = helper.LENGTH.unpack(self._bytes(pipe, helper.LENGTH.size))
            raise _refusal(self._number, json.loads(self._bytes(pipe, length)))
        stamp_ns, rows, stride = helper.FRAME.unpack(self._bytes(pipe, helper.FRAME.size))
        if kind != helper.MAGIC or rows * stride > LARGEST_BYTES or stride < self._width:
            raise DriverError(f"Raspberry Pi camera {self._number}: {kind!r} is no frame of its process")
        image = np.frombuffer(self._bytes(pipe, rows * stride), np.uint8).reshape(rows, stride)
        asleep_ns = time.clock_gettime_ns(time.CLOCK_BOOTTIME) - time.monotonic_ns()
        return Grab(image[:, : self._width].copy(), from_monotonic_us((stamp_ns - asleep_ns) // 1000))

    def _bytes(self, pipe: IO[bytes], count: int) -> bytes:
        try:
            data = pipe.read(count)
        except ValueError:  # closed while it was read
            data = b""
        if len(data) < count:
            raise DriverError(
                f"Raspberry Pi camera {self._number}: its process ended; 'journalctl' has what it said"
            )
        return data


def _refusal(number: int, refusal: dict[str, str]) -> DriverError:
    """What the process could not do, and what to do."""
    if refusal["where"] == "camera":
        return DriverError(f"Raspberry Pi camera {number}: {refusal['text']}; is its cable in place?")
    text, remedy = _import_trouble(refusal["kind"], refusal["missing"], refusal["text"])
    return DriverError(f"{text}: {remedy}", remedy)


def _import_trouble(kind: str, missing: str, said: str) -> tuple[str, str]:
    """What is wrong with the system's import of picamera2, and what to do."""
    if missing == "picamera2":
        return f"picamera2 is not installed for {SYSTEM_PYTHON}", "'apt install python3-picamera2'"
    if missing:
        return (
            f"picamera2 needs the package '{missing}'",
            f"'apt install python3-{missing.partition('.')[0]}'",
        )
    if any(word in said for word in ABI_WORDS):
        remedy = (
            "'apt install --reinstall python3-numpy python3-picamera2'; remove a numpy below /usr/local/lib"
        )
        return "the system's picamera2 was built for another numpy than the one it finds", remedy
    return (
        f"picamera2 cannot be imported ({kind}: {said})",
        "'apt install --reinstall python3-picamera2'",
    )
