"""An MCAP file read back with the mcap library, and held against a replay of the same flight."""

import json
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import jsonschema
import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader
from mcap.records import Channel, Message, Schema

FOXGLOVE = {
    "camera/image": "foxglove.CompressedImage",
    "camera/tracks": "foxglove.ImageAnnotations",
    "camera/calibration": "foxglove.CameraCalibration",
    "transforms": "foxglove.FrameTransforms",
    "pose": "foxglove.PoseInFrame",
    "surface": "foxglove.SceneUpdate",
    "log": "foxglove.Log",
}
OURS = {
    "estimate": "landslope.Estimate",
    "decision": "landslope.Decision",
    "health": "landslope.Health",
    "event": "landslope.Event",
}


class Recording:
    """Everything in an MCAP file, by topic without the vehicle's name, in the order of the file."""

    def __init__(self, path: Path) -> None:
        self.schemas: dict[str, Schema] = {}
        self.channels: dict[str, Channel] = {}
        self.messages: dict[str, list[Message]] = defaultdict(list)
        self.vehicles: set[str] = set()
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            for schema, channel, message in reader.iter_messages(log_time_order=False):
                _, vehicle, topic = channel.topic.split("/", 2)
                assert schema is not None
                self.vehicles.add(vehicle)
                self.schemas[topic], self.channels[topic] = schema, channel
                self.messages[topic].append(message)
            self.attachments = {a.name: a.data for a in reader.iter_attachments()}
            self.metadata = {m.name: m.metadata for m in reader.iter_metadata()}

    def json(self, topic: str) -> list[dict[str, Any]]:
        """Our own messages of a topic, each held against the schema in the file."""
        schema = json.loads(self.schemas[topic].data)
        assert self.schemas[topic].encoding == "jsonschema"
        assert self.channels[topic].message_encoding == "json"
        jsonschema.Draft202012Validator.check_schema(schema)
        validator = jsonschema.Draft202012Validator(schema)
        found = [json.loads(message.data) for message in self.messages[topic]]
        for one in found:
            validator.validate(one)
        return found

    def protobuf(self, topic: str) -> Iterator[tuple[int, Any]]:
        """(log time in ns, message) decoded by the schema that stands in the file itself."""
        schema = self.schemas[topic]
        assert schema.encoding == "protobuf"
        files = descriptor_pb2.FileDescriptorSet.FromString(schema.data)
        pool = descriptor_pool.DescriptorPool()
        for file in files.file:
            pool.Add(file)
        kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
        for message in self.messages[topic]:
            yield message.log_time, kind.FromString(message.data)


def check_against_replay(recording: Recording, flight: Path, out: Path, events: Path) -> dict[str, int]:
    """Assert that the file holds every frame, estimate and event of the flight, and what Foxglove's tools need."""
    frames = len((flight / "frames.csv").read_text().strip().splitlines()) - 1
    lines = out.read_bytes().splitlines()
    assert [m.data for m in recording.messages["estimate"]] == lines
    assert len(lines) == frames
    estimates = recording.json("estimate")
    happened = [json.loads(line) for line in events.read_text().splitlines()]
    own = [e for e in happened if e["event"] != "decision"]
    assert recording.json("event") == own
    changes = [{k: v for k, v in e.items() if k != "event"} for e in happened if e["event"] == "decision"]
    decisions = recording.json("decision")
    assert all(change in decisions for change in changes)
    recording.json("health")
    for topic, schema in {**FOXGLOVE, **OURS}.items():
        if topic in recording.schemas:
            assert recording.schemas[topic].name == schema
    assert set(FOXGLOVE) - set(recording.schemas) <= (set() if own else {"log"})
    times = [e["time_unix_us"] * 1000 for e in estimates]
    images = list(recording.protobuf("camera/image"))
    assert [time for time, _ in images] == times
    size = cv2.imdecode(np.frombuffer(images[-1][1].data, np.uint8), cv2.IMREAD_GRAYSCALE).shape
    _, calibration = next(recording.protobuf("camera/calibration"))
    assert size == (calibration.height, calibration.width)
    for (time, tracks), estimate in zip(recording.protobuf("camera/tracks"), estimates, strict=True):
        assert time == estimate["time_unix_us"] * 1000
        drawn = sum(len(points.points) for points in tracks.points) // 2
        assert (drawn > 0) == (estimate["features"] > 0) or estimate["status"] != "ok"
    surfaces = [len(update.entities) == 1 for _, update in recording.protobuf("surface")]
    known = [
        None not in (e["surface_pitch_deg"], e["surface_roll_deg"], e["inclination_deg"]) for e in estimates
    ]
    assert surfaces == known
    attitudes = sum(e["roll_deg"] is not None for e in estimates)
    assert len(recording.messages["transforms"]) == len(recording.messages["pose"]) == attitudes
    logged = [log.message for _, log in recording.protobuf("log")] if own else []
    assert logged == [e["text"] for e in own]
    return {
        "frames": len(images),
        "estimates": len(estimates),
        "events": len(own),
        "decisions": len(decisions),
        "surfaces": sum(surfaces),
    }
