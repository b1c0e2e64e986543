"""The one interface of every camera."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.events import DriverEvent
from drivers.samples import Frame, Refusal


@dataclass(frozen=True, slots=True)
class CameraFormat:
    """What is asked of a camera; 0 (gain: -1) leaves the camera's own choice."""

    width: int = 0
    height: int = 0
    rate_hz: float = 0.0
    exposure_us: int = 0
    gain: float = -1.0
    pixel_format: str = ""
    """Four characters, as "GREY", "YUYV" or "MJPG"; V4L2 only."""
    transport: str = "tcp"
    """"tcp" or "udp"; RTSP only."""


@dataclass(frozen=True, slots=True)
class ReaderLimits:
    """How patient the reader of a camera is, in seconds."""

    open_timeout_s: float = 8.0
    read_timeout_s: float = 2.0
    first_retry_s: float = 0.2
    longest_retry_s: float = 1.0
    max_hanging_reads: int = 4
    """Abandoned reads that may hang in a driver at once before no new one is started."""
    stuck_after_s: float = 20.0
    """How long all of them must hang until the camera counts as stuck."""


@dataclass(frozen=True, slots=True)
class CameraStatus:
    """A camera's health. Every frame that came in is in exactly one of delivered, skipped, waiting and refused."""

    state: str
    """"opening", "ok", "lost", "ended" or "closed"."""
    problem: str
    width: int
    height: int
    grabbed: int
    delivered: int
    skipped: int
    waiting: int
    refused: dict[str, int] = field(default_factory=dict)
    reopened: int = 0
    hanging_reads: int = 0
    stuck: bool = False
    """Whether all reads hang, for so long that only a new process can open the camera."""
    remedy: str = ""
    """What to do about the problem, where it is known."""


@dataclass(frozen=True, slots=True)
class Grab:
    """One picture as a grabber got it: (height, width) uint8 grey, captured at ``captured_us`` on the host clock."""

    image: NDArray[np.uint8]
    captured_us: int


class Grabber(Protocol):
    """A device as its reader thread sees it: opened once, read until it fails, closed once, all in one thread."""

    def open(self) -> None:
        """Open the device; raises DriverError with the reason and the remedy."""

    def grab(self) -> Grab | None:
        """Wait for the next picture; None at the end of a recording; raises DriverError when the device is lost."""

    def close(self) -> None:
        """Give the device back."""


Notify = Callable[[], None]


class Camera(ABC):
    """Frames of one camera, the newest first and only: who comes late finds the skipped ones counted."""

    @abstractmethod
    def take(self) -> list[Frame | Refusal]:
        """What came since the last call, without waiting: refusals, then at most one frame, the newest."""

    @abstractmethod
    def read(self, timeout_s: float) -> list[Frame | Refusal]:
        """As ``take``, but waits up to ``timeout_s`` for something to come."""

    @abstractmethod
    def status(self) -> CameraStatus:
        """The camera's health at this moment."""

    @abstractmethod
    def events(self) -> list[DriverEvent]:
        """What happened since the last call: camera lost, back, its stamps unusable."""

    @abstractmethod
    def close(self) -> None:
        """Stop reading and give the device back; returns within about a second, whatever the device does."""

    def frames(self, poll_s: float = 0.5) -> Iterator[Frame | Refusal]:
        """All samples until the camera ends or is closed."""
        while True:
            over = self.status().state in ("ended", "closed")
            samples = self.take() if over else self.read(poll_s)
            yield from samples
            if over and not samples:
                return

    def __enter__(self) -> "Camera":
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()
