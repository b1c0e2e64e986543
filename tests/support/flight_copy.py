"""A copy of the first seconds of a recorded flight, and the way to change its telemetry and its frame table."""

import shutil
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import cv2
from places import REPOSITORY
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.files.tlog import decode_record, records
from drivers.files.video_file import VideoFile

FLIGHTS = REPOSITORY / "sitl_logs"
ASKS_FLYING_ON = "\n[decision]\ntouchdown_known = false\n"
"""A cut of a flight ends before the vehicle slows down to land."""


def short_flight(directory: Path, source: str = "stairs_a", seconds: float = 3.0) -> Path:
    """The first seconds of a recorded flight as a flight folder of its own."""
    flight = FLIGHTS / source
    directory.mkdir(parents=True)
    lines = (flight / "frames.csv").read_text().splitlines()
    first_us = int(lines[1].split(",")[1])
    kept = [line for line in lines[1:] if int(line.split(",")[1]) < first_us + seconds * 1e6]
    (directory / "frames.csv").write_text("\n".join([lines[0], *kept]) + "\n")
    write_video(directory / "camera.mkv", VideoFile(flight / "camera.mkv"), len(kept), "Y800")
    data = (flight / "vehicle.tlog").read_bytes()
    end_us = first_us + (seconds + 0.2) * 1e6
    (directory / "vehicle.tlog").write_bytes(
        b"".join(data[r.start : r.end] for r in records(data) if r.stamp_us < end_us)
    )
    for name in ("camera.yaml", "landslope.toml"):
        shutil.copy(flight / name, directory / name)
    truth = (flight / "truth.csv").read_text().splitlines()
    (directory / "truth.csv").write_text("\n".join(truth[: len(kept) + 1]) + "\n")
    with (directory / "landslope.toml").open("a") as settings:
        settings.write(ASKS_FLYING_ON)
    return directory


def write_video(path: Path, video: VideoFile, frames: int, codec: str) -> None:
    """The first frames of a video without loss; "Y800" is not compressed and costs the least to write and read."""
    fourcc, size = cv2.VideoWriter_fourcc(*codec), (video.width, video.height)
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, fourcc, video.fps, size, False)
    for index, image in video.images():
        if index == frames:
            break
        writer.write(image)
    writer.release()


Message = tuple[int, Any]
"""Stamp in microseconds and a pymavlink message."""


def rewrite(folder: Path, change: Callable[[list[Message]], Iterable[Message]]) -> None:
    """Decode a folder's tlog, change the list of (stamp, message), and write it again."""
    path = folder / "vehicle.tlog"
    data = path.read_bytes()
    messages = [(r.stamp_us, decode_record(data, r)) for r in records(data)]
    written = bytearray()
    for stamp_us, message in change(messages):
        packer = mavlink.MAVLink(None, message.get_srcSystem(), message.get_srcComponent())
        written += stamp_us.to_bytes(8, "big") + message.pack(packer)
    path.write_bytes(bytes(written))


def edit_rows(folder: Path, change: Callable[[list[list[str]]], Iterable[list[str]]]) -> None:
    """Change the rows of a folder's frames.csv (without its first line)."""
    path = folder / "frames.csv"
    head, *lines = path.read_text().splitlines()
    rows = change([line.split(",") for line in lines])
    path.write_text("\n".join([head, *(",".join(row) for row in rows)]) + "\n")
