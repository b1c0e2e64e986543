"""MCAP exports read back: every frame, estimate and event, valid schemas, and frames that fit together."""

import json
import math
import socket
import struct
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import replay_support
from export_support import OURS, Recording, check_against_replay
from monitor_support import Vehicle, decision, estimate, event, eventually, health, surface
from ports import free_endpoint, free_tcp_port
from websockets.sync.client import ClientConnection, connect

from companion.cli import main
from companion.core.core import Processed
from companion.errors import LandslopeError
from companion.export import shapes
from companion.export.mcap_sink import McapSink
from companion.fleet.fleet import embedded_router
from companion.live.recording import FlightRecording
from companion.messages.preview import Preview, jpeg
from companion.monitor import foxglove as live
from companion.monitor.options import MonitorOptions
from companion.settings.settings import RecordSettings, Settings
from drivers.bus import Endpoints
from drivers.samples import Attitude, Frame, Velocity
from landing.rotations import matrix_from_euler
from landing.vision.camera import CameraModel

CAMERA = CameraModel.from_focal(320, 240, 256.0)


def matrix(q: Any) -> np.ndarray:
    """Of a decoded quaternion."""
    return rotation_of(q.x, q.y, q.z, q.w)


def rotation_of(x: float, y: float, z: float, w: float) -> np.ndarray:
    """The matrix of a unit quaternion, by the textbook."""
    return np.array(
        (
            (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
            (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
            (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
        )
    )


@pytest.fixture(scope="module")
def exported(recorded: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Recording]:
    folder = tmp_path_factory.mktemp("export")
    assert main(["export", str(recorded), "--mcap", str(folder / "flight.mcap")]) == 0
    assert [file.name for file in folder.iterdir()] == ["flight.mcap"]
    return folder, Recording(folder / "flight.mcap")


def test_the_file_holds_what_the_replay_says(exported: tuple[Path, Recording], recorded: Path) -> None:
    folder, recording = exported
    replayed = replay_support.run(recorded, folder)
    found = check_against_replay(recording, recorded, replayed.folder / "out.jsonl", folder / "events.jsonl")
    assert found["frames"] == found["estimates"] > 60
    assert found["events"] > 0
    assert found["surfaces"] > 0


def test_the_flights_own_files_travel_along(exported: tuple[Path, Recording], recorded: Path) -> None:
    _, recording = exported
    assert recording.attachments["landslope.toml"] == (recorded / "landslope.toml").read_bytes()
    assert recording.attachments["camera.yaml"] == (recorded / "camera.yaml").read_bytes()
    assert recording.metadata["landslope"]["vehicle"] in recording.vehicles


def test_the_drawn_surface_agrees_with_the_estimate_through_the_frames(
    exported: tuple[Path, Recording],
) -> None:
    """The surface's normal, once from the triangles and once from the slopes in the camera, seen from ENU."""
    _, recording = exported
    trees = {
        time: {t.child_frame_id.split("/")[1]: matrix(t.rotation) for t in tree.transforms}
        for time, tree in recording.protobuf("transforms")
    }
    compared = 0
    for (time, update), said in zip(recording.protobuf("surface"), recording.json("estimate"), strict=True):
        if not update.entities:
            continue
        turn = trees[time]
        enu_from_level = turn["ned"] @ turn["level"]
        enu_from_camera = turn["ned"] @ turn["body"] @ turn["camera"]
        a, b, c = (np.array((p.x, p.y, p.z)) for p in update.entities[0].triangles[0].points[:3])
        drawn = enu_from_level @ np.cross(b - a, c - b)
        drawn /= np.linalg.norm(drawn)
        slopes = (math.tan(math.radians(said[f"slope_{axis}_deg"])) for axis in "xy")
        seen = enu_from_camera @ np.array([-s for s in slopes] + [1.0])
        seen /= np.linalg.norm(seen)
        # Normals have no sign of their own here; up is what both are turned to.
        drawn, seen = drawn * np.sign(drawn[2]), seen * np.sign(seen[2])
        assert math.degrees(math.acos(min(1.0, float(drawn[2])))) == pytest.approx(
            said["inclination_deg"], abs=0.01
        )
        # The direction drawn is that of the per-axis angles, which is not exactly that of the full one.
        assert math.degrees(math.acos(min(1.0, float(drawn @ seen)))) < 1.5
        compared += 1
    assert compared > 20


@pytest.fixture
def sink(tmp_path: Path) -> McapSink:
    return McapSink(tmp_path / "live.mcap", "vehicle1", CAMERA)


def processed(number: int) -> Processed:
    frame = Frame(number=number, stamp_us=0, arrival_us=number, image=np.zeros((240, 320), np.uint8))
    return Processed(frame, surface(number))


def test_a_live_recording_takes_whatever_the_core_puts_out(sink: McapSink, tmp_path: Path) -> None:
    sink.sample(Attitude(arrival_us=0, boot_us=0, roll=0.0, pitch=0.0, yaw=1.0))
    sink.sample(
        Velocity(arrival_us=0, boot_us=0, position_ned=(1.0, 2.0, -3.0), velocity_ned=(0.0, 0.0, 0.0))
    )
    steep = estimate(1, 20.0)
    unknown = msgspec.structs.replace(estimate(2), inclination_deg=None, status="starting")
    for output in (
        health(),
        steep,
        processed(1),
        decision(verdict="fit"),
        unknown,
        processed(2),
        event("hello"),
    ):
        sink.put(output)
    assert (sink.frames, sink.estimates, sink.events) == (2, 2, 1)
    assert not (tmp_path / "live.mcap").exists()
    sink.close()
    assert [file.name for file in tmp_path.iterdir()] == ["live.mcap"]
    recording = Recording(tmp_path / "live.mcap")
    assert {topic: recording.schemas[topic].name for topic in OURS} == OURS
    assert [len(recording.json(topic)) for topic in OURS] == [2, 1, 1, 1]
    (_, first), (_, second) = recording.protobuf("surface")
    assert len(first.entities) == 1
    assert len(second.deletions) == 1
    (_, pose), _ = recording.protobuf("pose")
    assert (pose.pose.position.x, pose.pose.position.y, pose.pose.position.z) == (1.0, 2.0, -3.0)
    assert matrix(pose.pose.orientation) == pytest.approx(
        matrix_from_euler(math.radians(1.0), math.radians(-2.0), 1.0)
    )
    (_, tracks), _ = recording.protobuf("camera/tracks")
    assert [len(points.points) for points in tracks.points] == [4, 2]


def test_a_recording_that_is_given_up_leaves_no_file(sink: McapSink, tmp_path: Path) -> None:
    sink.put(estimate(1))
    sink.abandon()
    assert list(tmp_path.iterdir()) == []


def test_a_recording_cut_off_by_the_power_keeps_its_chunks(sink: McapSink, tmp_path: Path) -> None:
    noise = np.random.default_rng(1)
    for number in range(60):
        image = noise.integers(0, 255, (240, 320), np.uint8)
        sink.put(estimate(number))
        sink.put(Processed(Frame(number=number, stamp_us=0, arrival_us=0, image=image), surface(number)))
    raw = (tmp_path / "live.mcap.part").read_bytes()
    sink.close()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(raw)
    from mcap.exceptions import McapError
    from mcap.stream_reader import StreamReader

    estimates = 0
    with cut.open("rb") as file:
        records = StreamReader(file).records
        try:
            for record in records:
                estimates += type(record).__name__ == "Message"
        except (McapError, struct.error):
            pass
    assert estimates > 60


def test_the_daemons_recording_writes_it_beside_the_flight(tmp_path: Path) -> None:
    settings = Settings(
        record=RecordSettings(directory=str(tmp_path), when="always", mcap=True, min_free_mb=1)
    )
    recording = FlightRecording(settings)
    recording.message(estimate(0))  # before there is a flight: not in it
    assert eventually(lambda: recording.step(0) and list(tmp_path.glob("*")))
    number = 0

    def fly() -> bool:
        """Until the file, opened by the first frame, takes what comes."""
        nonlocal number
        number += 1
        recording.step(number)
        recording.samples([Attitude(arrival_us=number, boot_us=0, roll=0.0, pitch=0.0, yaw=0.5)])
        recording.message(estimate(number))
        recording.processed(processed(number))
        return number > 20

    assert eventually(fly)
    recording.by_hand(False)
    recording.step(number)
    recording.close()
    (file,) = tmp_path.glob("*/flight.mcap")
    recorded = Recording(file)
    frames = [frame["frame"] for frame in recorded.json("estimate")]
    assert frames == sorted(set(frames))
    assert 10 < len(frames) <= 20
    assert len(recorded.messages["camera/image"]) in (len(frames), len(frames) + 1)
    assert recording.counters["mcap dropped"] == 0
    assert not list(tmp_path.glob("*/*.part"))


def test_a_place_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(LandslopeError, match="cannot be written"):
        McapSink(tmp_path / "none" / "x.mcap", "vehicle1", CAMERA)


def test_the_command_refuses_what_would_overwrite_or_clash(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    there = tmp_path / "there.mcap"
    there.write_text("mine")
    flight = str(recorded)
    for words, complaint in (
        ([flight, "--mcap", str(there)], "give --force"),
        ([flight, str(tmp_path), "--mcap", str(tmp_path / "one.mcap")], "need a folder"),
        ([flight, flight, "--mcap", str(tmp_path)], "same name"),
        ([flight, "--mcap", str(tmp_path / "no" / "x.mcap")], "make it first"),
        ([str(tmp_path / "nothing"), "--mcap", str(tmp_path / "x.mcap")], "nothing"),
    ):
        assert main(["export", *words]) == 2
        assert complaint in capsys.readouterr().err
    assert there.read_text() == "mine"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["there.mcap"]


def test_quaternions_of_all_turns() -> None:
    for angles in (
        (0.0, 0.0, 0.0),
        (math.pi, 0.0, 0.0),
        (0.3, -1.2, 3.0),
        (1e-9, 0.0, 0.0),
        (0.0, 0.0, math.pi),
    ):
        rotation = matrix_from_euler(*angles)
        assert rotation_of(*shapes.xyzw(rotation)) == pytest.approx(rotation, abs=1e-7)


def test_a_scaled_picture_gets_a_scaled_overlay() -> None:
    preview = Preview(
        frame=1,
        time_unix_us=1,
        width=640,
        height=480,
        status="ok",
        tracks=((0.0, 10.0, 100.0, 200.0),),
        inlier=(True,),
    )
    picture = jpeg(np.zeros((480, 640), np.uint8), 320, 80)
    found = live.scaled(preview, picture)
    assert found is not None
    assert (found.width, found.height, found.tracks) == (320, 240, ((0.0, 5.0, 50.0, 100.0),))
    assert live.scaled(preview, b"no jpeg") is None
    assert live.scaled(preview, b"") is None


def advertised(app: ClientConnection, wanted: str) -> dict[str, dict[str, Any]]:
    """Channels by topic, once the wanted one is there."""
    channels: dict[str, dict[str, Any]] = {}
    while wanted not in channels:
        reported = app.recv(timeout=300)
        if isinstance(reported, str) and (message := json.loads(reported))["op"] == "advertise":
            channels |= {channel["topic"]: channel for channel in message["channels"]}
    return channels


def test_the_foxglove_app_is_served_live() -> None:
    endpoint = free_endpoint()
    with embedded_router(endpoint):
        vehicle = Vehicle("vehicle1", endpoint)
        server, end = live.start(
            MonitorOptions(), Endpoints(connect=(endpoint,)), "*", "127.0.0.1", free_tcp_port()
        )
        try:
            assert not vehicle.preview.watched  # nobody has opened a camera yet
            url = f"ws://127.0.0.1:{server.port}"
            with connect(url, subprotocols=["foxglove.sdk.v1", "foxglove.websocket.v1"]) as app:  # type: ignore[list-item]
                channels = advertised(app, "/vehicle1/camera/image")
                assert channels["/vehicle1/estimate"]["schemaName"] == "landslope.Estimate"
                assert channels["/vehicle1/camera/image"]["schemaName"] == "foxglove.CompressedImage"
                wanted = ["/vehicle1/estimate", "/vehicle1/camera/image"]
                asked = [{"id": i, "channelId": channels[topic]["id"]} for i, topic in enumerate(wanted)]
                app.send(json.dumps({"op": "subscribe", "subscriptions": asked}))
                heard: dict[int, bytes] = {}
                while len(heard) < len(wanted):
                    data = app.recv(timeout=300)
                    if isinstance(data, bytes) and data[0] == 1:
                        (subscription,) = struct.unpack("<I", data[1:5])
                        heard[subscription] = data[13:]
                assert json.loads(heard[0])["inclination_deg"] == 12.5
                assert b"\xff\xd8\xff" in heard[1]
                assert vehicle.preview.watched
            assert eventually(lambda: not vehicle.preview.watched)
        finally:
            end()
            vehicle.close()


def test_a_taken_port_is_an_error() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(LandslopeError, match="choose another --port"):
            live.start(
                MonitorOptions(),
                Endpoints(connect=(free_endpoint(),)),
                "*",
                "127.0.0.1",
                taken.getsockname()[1],
            )
