"""Opens the camera that the text of ``camera.source`` names: a V4L2 device, picamera, a network stream, a file."""

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

from drivers.cameras.file import FileGrabber
from drivers.cameras.interface import Camera, CameraFormat, Grabber, Notify, ReaderLimits
from drivers.cameras.picamera import PicameraGrabber
from drivers.cameras.reader import ReaderCamera
from drivers.cameras.stream import SCHEMES, StreamGrabber
from drivers.cameras.v4l2 import V4l2Grabber
from drivers.errors import DriverError

SOURCES = (
    "/dev/video0 (or any path under /dev), picamera, picamera:1, rtsp://..., http://..., udp://..., tcp://..., "
    "an .sdp file, a video file, a folder of pictures or a recorded flight"
)


def open_camera(
    source: str,
    wanted: CameraFormat | None = None,
    limits: ReaderLimits | None = None,
    notify: Notify | None = None,
) -> Camera:
    """Start reading the camera named by ``source`` in a thread of its own; returns at once.

    ``wanted``: picture size and rate, None for the device's own; ``limits``: how long opening and reading may take.
    ``notify`` is called from that thread when the camera has something to take. Raises DriverError when the source is
    none of SOURCES. A device that is absent raises nothing: opening it is repeated until it appears.
    """
    wanted, limits = wanted or CameraFormat(), limits or ReaderLimits()
    name, make, limits = _grabber_of(source.strip(), wanted, limits)
    return ReaderCamera(name, make, limits, notify)


def _grabber_of(
    source: str, wanted: CameraFormat, limits: ReaderLimits
) -> tuple[str, Callable[[], Grabber], ReaderLimits]:
    """Name of the source, the function that opens it, and its limits: a file may pause between frames as it likes."""
    if not source:
        raise DriverError(f"camera.source is empty; it may be {SOURCES}")
    if source.isdecimal():
        source = f"/dev/video{source}"
    if source.startswith("/dev/"):
        return source, lambda: V4l2Grabber(source, wanted), limits
    if source.lower().startswith(SCHEMES) or source.endswith(".sdp"):
        return source, lambda: StreamGrabber(source, wanted, limits), limits
    kind, _, number = source.partition(":")
    if kind == "picamera" and (number or "0").isdecimal():
        return source, lambda: PicameraGrabber(int(number or "0"), wanted), limits
    if Path(source).exists():
        patient = dataclasses.replace(limits, read_timeout_s=math.inf)
        return source, lambda: FileGrabber(Path(source)), patient
    raise DriverError(f"camera.source '{source}' is no camera and no file; it may be {SOURCES}")
