"""One vehicle's channels: every message of ours as JSON with its schema, and what tools draw, by Foxglove's."""

import json
import math
from typing import Any

import foxglove
from foxglove import channels as fox

from companion.export import shapes
from companion.messages.ground import Ground
from companion.messages.messages import TOPICS, Decision, Estimate, Event, Message, encode, topic_of
from companion.messages.preview import Preview
from companion.messages.schema import schema_of
from landing.vision.camera import CameraModel

NANOSECONDS = 1000
Position = tuple[float, float, float]
ORIGIN: Position = (0.0, 0.0, 0.0)


class VehicleChannels:
    """Logs one vehicle into a Foxglove context (a file, a live server or both), topics ``/<vehicle>/...``.

    Times are the companion's clock. What the messages do not carry (heading, position) comes by ``moved``.
    """

    def __init__(self, context: foxglove.Context, vehicle: str, camera: CameraModel | None = None) -> None:
        self._vehicle = vehicle
        self._camera = camera
        self._verdict = "unknown"
        self._yaw = 0.0
        self._position = ORIGIN
        top = f"/{vehicle}"
        self._json = {
            topic.name: foxglove.Channel(
                f"{top}/{topic.name}",
                message_encoding="json",
                schema=foxglove.Schema(
                    name=f"landslope.{topic.type.__name__}",
                    encoding="jsonschema",
                    data=json.dumps(schema_of(topic.name)).encode(),
                ),
                context=context,
            )
            for topic in TOPICS
            if topic.type is not None
        }
        self._image = fox.CompressedImageChannel(f"{top}/camera/image", context=context)
        self._tracks = fox.ImageAnnotationsChannel(f"{top}/camera/tracks", context=context)
        self._calibration = fox.CameraCalibrationChannel(f"{top}/camera/calibration", context=context)
        self._transforms = fox.FrameTransformsChannel(f"{top}/transforms", context=context)
        self._pose = fox.PoseInFrameChannel(f"{top}/pose", context=context)
        self._surface = fox.SceneUpdateChannel(f"{top}/surface", context=context)
        self._map = fox.GridChannel(f"{top}/ground/map", context=context)
        self._discs = fox.SceneUpdateChannel(f"{top}/ground/discs", context=context)
        self._level_m: float | None = None
        self._log = fox.LogChannel(f"{top}/log", context=context)
        self._calibrated = False

    @property
    def pictures_wanted(self) -> bool:
        """Whether a file or an onlooker takes images or tracks now."""
        return bool(self._image.has_sinks() or self._tracks.has_sinks())

    def moved(self, *, yaw: float | None = None, position_ned: Position | None = None) -> None:
        """The newest heading (radians) and position (m)."""
        self._yaw = self._yaw if yaw is None else yaw
        self._position = self._position if position_ned is None else position_ned

    def message(self, message: Message) -> None:
        """Log one message, and what is drawn of it."""
        time_ns = message.time_unix_us * NANOSECONDS
        self._json[topic_of(message)].log(encode(message), log_time=time_ns)
        match message:
            case Estimate():
                self._estimate(message, time_ns)
            case Ground():
                self._ground(message, time_ns)
            case Decision():
                self._verdict = message.verdict
            case Event():
                self._log.log(shapes.log(message), log_time=time_ns)

    def picture(self, jpeg: bytes, preview: Preview) -> None:
        """Log a frame's JPEG, which must have the size that the overlay counts in, and its tracks."""
        time_ns = preview.time_unix_us * NANOSECONDS
        if self._camera is not None and not self._calibrated:
            self._calibrated = True
            found = shapes.calibration(preview.time_unix_us, self._vehicle, self._camera)
            self._calibration.log(found, log_time=time_ns)
        self._image.log(shapes.image(preview.time_unix_us, self._vehicle, jpeg), log_time=time_ns)
        self._tracks.log(shapes.annotations(preview), log_time=time_ns)

    def close(self) -> None:
        """Take the channels away."""
        drawn: tuple[Any, ...] = (
            self._image,
            self._tracks,
            self._calibration,
            self._transforms,
            self._pose,
            self._surface,
            self._map,
            self._discs,
            self._log,
        )
        for channel in (*self._json.values(), *drawn):
            channel.close()

    def _estimate(self, estimate: Estimate, time_ns: int) -> None:
        at = estimate.time_unix_us
        if estimate.roll_deg is not None and estimate.pitch_deg is not None:
            roll, pitch = math.radians(estimate.roll_deg), math.radians(estimate.pitch_deg)
            attitude = (roll, pitch, self._yaw)
            tree = shapes.transforms(at, self._vehicle, self._position, attitude, self._camera)
            self._transforms.log(tree, log_time=time_ns)
            self._pose.log(shapes.pose(at, self._vehicle, self._position, attitude), log_time=time_ns)
        self._surface.log(shapes.surface(estimate, self._vehicle, self._verdict), log_time=time_ns)

    def _ground(self, ground: Ground, time_ns: int) -> None:
        drawn = shapes.ground_map(ground, self._vehicle, self._position)
        if drawn is not None:
            self._map.log(drawn, log_time=time_ns)
            self._level_m = shapes.ground_level(ground)
        if self._level_m is not None:
            discs = shapes.landing_discs(ground, self._vehicle, self._position, self._level_m)
            self._discs.log(discs, log_time=time_ns)
