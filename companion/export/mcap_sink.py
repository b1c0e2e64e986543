"""A flight into one MCAP file: for exports, and to record live on board."""

import importlib.metadata
from pathlib import Path

import foxglove

from companion.core.approach import Ordered
from companion.core.core import LandRequest, Output, Processed
from companion.errors import LandslopeError
from companion.export.channels import VehicleChannels
from companion.messages.messages import Estimate, Event
from companion.messages.preview import jpeg, overlay
from drivers.samples import Attitude, Sample, Velocity
from landing.vision.camera import CameraModel

JPEG_QUALITY = 90


class McapSink:
    """Writes what a ``Core`` puts out, and heading and position of the samples that went in.

    The file appears under its name when it is complete; until then it is ``NAME.part``, which the
    ``mcap recover`` tool reads if the power fails. Raises LandslopeError when the file cannot be opened.
    """

    def __init__(
        self,
        path: Path,
        vehicle: str,
        camera: CameraModel,
        *,
        attachments: dict[str, bytes] | None = None,
        jpeg_quality: int = JPEG_QUALITY,
    ) -> None:
        self.frames = 0
        self.estimates = 0
        self.events = 0
        self._path = path
        self._part = path.with_name(f"{path.name}.part")
        self._quality = jpeg_quality
        self._newest: Estimate | None = None
        self._context = foxglove.Context()
        try:
            self._writer = foxglove.open_mcap(self._part, allow_overwrite=True, context=self._context)
        except OSError as error:
            raise LandslopeError(f"{path}: cannot be written: {error}; choose another path") from None
        self._channels = VehicleChannels(self._context, vehicle, camera)
        version = importlib.metadata.version("landslope")
        self._writer.write_metadata("landslope", {"version": version, "vehicle": vehicle})
        for name, data in (attachments or {}).items():
            self._writer.attach(log_time=0, create_time=0, name=name, media_type="text/plain", data=data)

    def sample(self, sample: Sample) -> None:
        """Take heading and position from what the autopilot says."""
        match sample:
            case Attitude():
                self._channels.moved(yaw=sample.yaw)
            case Velocity():
                self._channels.moved(position_ned=sample.position_ned)

    def put(self, output: Output) -> None:
        """Write one output: a message, or a frame that was processed."""
        match output:
            case Processed():
                self._picture(output)
            case LandRequest() | Ordered():
                pass  # the decision and the event that belong to it are messages of their own
            case _:
                self.estimates += isinstance(output, Estimate)
                self.events += isinstance(output, Event)
                if isinstance(output, Estimate):
                    self._newest = output
                self._channels.message(output)

    def close(self) -> None:
        """Complete the file and give it its name."""
        self._writer.close()
        self._channels.close()
        self._part.replace(self._path)

    def abandon(self) -> None:
        """Remove what was written so far."""
        self._writer.close()
        self._channels.close()
        self._part.unlink(missing_ok=True)

    def _picture(self, output: Processed) -> None:
        image = output.frame.image
        # The estimate's message comes just before its frame and carries the exposure's time.
        newest = self._newest
        same = newest is not None and newest.frame == output.frame.number
        time_us = newest.time_unix_us if newest is not None and same else output.frame.arrival_us
        tracks = 0 if output.estimate.tracks is None else len(output.estimate.tracks.current_px)
        drawn = overlay(output.frame, output.estimate, time_us, max(1, tracks))
        self._channels.picture(jpeg(image, image.shape[1], self._quality), drawn)
        self.frames += 1
