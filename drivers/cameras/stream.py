"""Network streams through OpenCV's FFmpeg: RTSP, HTTP and MJPEG, MPEG-TS or raw H.264 over UDP, RTP by an .sdp file."""

import contextlib
import os
from collections.abc import Iterator

import cv2
import numpy as np
from cv2.utils import logging as cv2_logging

from drivers.cameras.grey import MOST_BROKEN, grey_of, grey_of_jpeg
from drivers.cameras.interface import CameraFormat, Grab, ReaderLimits
from drivers.cameras.stamping import MinimumDelayStamper
from drivers.errors import DriverError
from drivers.system.host_clock import now_us

SCHEMES = ("rtsp://", "rtsps://", "http://", "https://", "udp://", "tcp://", "rtp://", "srt://")

MJPEG = cv2.VideoWriter.fourcc(*"MJPG")

SENDERS_TIME = ("rtsp://", "rtsps://", "udp://", "rtp://", "srt://")
"""Schemes whose presentation times are the sender's; MJPEG over HTTP has none, FFmpeg makes them up."""

STREAM_TIMES = (
    "the stream's presentation times do not keep the pace of its frames (the sender counts frames at a rate that the "
    "camera does not have); frames are stamped by their arrival: set the sender to the camera's true rate"
)

OPTIONS_VARIABLE = "OPENCV_FFMPEG_CAPTURE_OPTIONS"
"""OpenCV takes FFmpeg's options from this variable alone; what the user has put there stays."""


def ffmpeg_options(transport: str) -> str:
    """Options for the least delay: nothing buffered, nothing reordered, the format known after half a second."""
    return (
        f"rtsp_transport;{transport}|fflags;nobuffer|flags;low_delay|analyzeduration;500000|max_delay;100000"
        "|reorder_queue_size;0|protocol_whitelist;file,rtp,udp,tcp,http,https,tls,rtsp,rtsps,srt,crypto"
    )


@contextlib.contextmanager
def _options(options: str) -> Iterator[None]:
    """FFmpeg's options while a stream is opened; a video file opened later must not find them."""
    if OPTIONS_VARIABLE in os.environ:
        yield
        return
    os.environ[OPTIONS_VARIABLE] = options
    try:
        yield
    finally:
        os.environ.pop(OPTIONS_VARIABLE, None)


class StreamGrabber:
    """One stream, read as fast as it comes, so that nothing old waits in a buffer."""

    def __init__(self, url: str, wanted: CameraFormat, limits: ReaderLimits) -> None:
        self._url = url
        self._wanted = wanted
        self._limits = limits
        self._capture: cv2.VideoCapture | None = None
        self._stamper = MinimumDelayStamper() if url.lower().startswith(SENDERS_TIME) else None
        self._jpeg = False
        """Whether the pictures are taken as the JPEGs that came; the times of the sender are lost with that."""

    def open(self) -> None:
        """Connect; raises DriverError when nothing answers in time or no video is in it."""
        # FFmpeg prints every failed attempt on stderr; here they come as events and in the status.
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
        cv2_logging.setLogLevel(cv2_logging.LOG_LEVEL_ERROR)
        timeouts = [
            cv2.CAP_PROP_OPEN_TIMEOUT_MSEC,
            round(self._limits.open_timeout_s * 1000),
            cv2.CAP_PROP_READ_TIMEOUT_MSEC,
            round(self._limits.read_timeout_s * 1000),
            cv2.CAP_PROP_N_THREADS,  # frame threads would each hold a frame back
            1,
        ]
        with _options(ffmpeg_options(self._wanted.transport)):
            self._capture = cv2.VideoCapture(self._url, cv2.CAP_FFMPEG, timeouts)
        if not self._capture.isOpened():
            raise DriverError(f"{self._url}: no video there; is the address right and the sender running?")
        if self._stamper is None and round(self._capture.get(cv2.CAP_PROP_FOURCC)) == MJPEG:
            self._jpeg = self._capture.set(cv2.CAP_PROP_FORMAT, -1)

    def grab(self) -> Grab:
        """The next decoded frame."""
        for _ in range(MOST_BROKEN):
            found = self._next()
            if found is not None:
                return found
        raise DriverError(f"{self._url}: {MOST_BROKEN} frames in a row are broken")

    def _next(self) -> Grab | None:
        capture = self._capture
        if capture is None or not capture.grab():
            raise DriverError(f"{self._url}: the stream stopped")
        captured_us, remark = now_us(), None
        if self._stamper is not None:
            held = not self._stamper.made_up
            captured_us = self._stamper.stamp(round(capture.get(cv2.CAP_PROP_POS_MSEC) * 1000), captured_us)
            if held and self._stamper.made_up:
                remark = "stream_times_made_up", STREAM_TIMES
        taken, image = capture.retrieve()
        if not taken:
            raise DriverError(f"{self._url}: a frame could not be decoded")
        if self._jpeg:
            grey = grey_of_jpeg(np.asarray(image, np.uint8))
            return None if grey is None else Grab(grey, captured_us)
        return Grab(grey_of(image), captured_us, remark)

    def close(self) -> None:
        """Leave the stream."""
        if self._capture is not None:
            self._capture.release()
