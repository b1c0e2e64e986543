"""What a report needs beside the history: the overlay video, the path, the autopilot's mode, the ground maps."""

import math
import tempfile
from pathlib import Path
from typing import Any

import msgspec

from companion.messages.ground import Ground
from companion.messages.messages import Decision, Message
from companion.replay.overlay import OverlayWriter
from drivers.samples import Frame, Heartbeat, Sample, Velocity
from landing.estimate import SurfaceEstimate
from landing.vision.camera import CameraModel

VIDEO_WIDTH_PX = 640
"""Width of the embedded video: the overlay's words are legible, and half a minute stays under about 8 MB."""
PATH_STEP_S = 0.1


class ReportRecorder:
    """Is given everything of one replay in order; times are seconds since the first frame."""

    def __init__(self, camera: CameraModel, radius_m: float = math.nan) -> None:
        """``radius_m``: of the disc that the vehicle stands on."""
        self.radius_m = radius_m
        self.path: list[tuple[float, float, float, float]] = []
        """(time_s, north_m, east_m, down_m) of the vehicle in the autopilot's local frame."""
        self.modes: list[tuple[float, str, bool]] = []
        """(time_s, mode, armed) at every change."""
        self.grounds: list[tuple[float, dict[str, Any]]] = []
        """(time_s, ground message)."""
        self.frames = 0
        self._directory = tempfile.TemporaryDirectory(prefix="landslope-report-")
        self._file = Path(self._directory.name) / "overlay.webm"
        self._writer = OverlayWriter(self._file, camera, VIDEO_WIDTH_PX, radius_m)

    def sample(self, sample: Sample, time_s: float) -> None:
        """A sample as it went into the core."""
        if isinstance(sample, Velocity):
            if not self.path or time_s - self.path[-1][0] >= PATH_STEP_S:
                self.path.append((time_s, *sample.position_ned))
        elif isinstance(sample, Heartbeat):
            now = (sample.mode, sample.armed)
            if not self.modes or self.modes[-1][1:] != now:
                self.modes.append((time_s, *now))

    def message(self, message: Message, time_s: float) -> None:
        """A message of the core."""
        if isinstance(message, Decision):
            self._writer.decided(message)
        elif isinstance(message, Ground):
            self._writer.mapped(message)
            self.grounds.append((time_s, msgspec.to_builtins(message)))

    def requested(self, time_s: float) -> None:
        """A landing was requested."""
        self._writer.requested(time_s)

    def picture(self, frame: Frame, estimate: SurfaceEstimate, time_s: float) -> None:
        """A frame with its estimate."""
        self._writer.add(frame.image, estimate, time_s)
        self.frames += 1

    @property
    def fps(self) -> float:
        """Pictures a second of the video."""
        return self._writer.fps

    def video(self) -> bytes:
        """The finished WebM file; empty when there was no picture."""
        self._writer.close()
        return self._file.read_bytes() if self._file.exists() else b""

    def close(self) -> None:
        """Remove what was written on the way."""
        self._writer.close()
        self._directory.cleanup()
