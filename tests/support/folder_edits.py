"""Named edits of a recorded flight: each takes a copy of a flight folder and damages it in one way.

``EDITS`` names the edits with what must come of them.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flight_copy import FLIGHTS, Message, edit_rows, rewrite, short_flight, write_video
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.files.video_file import VideoFile

__all__ = ["EDITS", "FLIGHTS", "Edit", "edit_rows", "short_flight"]

WRAP_MS = 2**32


def _names(messages: list[Message], *names: str) -> list[int]:
    return [i for i, (_, m) in enumerate(messages) if m.get_type() in names]


def video_missing(folder: Path) -> None:
    (folder / "camera.mkv").unlink()


def video_empty(folder: Path) -> None:
    (folder / "camera.mkv").write_bytes(b"")


def video_is_text(folder: Path) -> None:
    (folder / "camera.mkv").write_text("this is no video\n" * 100)


def video_cut(folder: Path) -> None:
    data = (folder / "camera.mkv").read_bytes()
    (folder / "camera.mkv").write_bytes(data[: len(data) // 2])


def damaged(data: bytes) -> bytes:
    """A video's bytes with 20 kB of them overwritten in the middle."""
    middle = len(data) // 2
    return data[:middle] + b"\x55" * 20_000 + data[middle + 20_000 :]


def video_damaged(folder: Path) -> None:
    path, coded = folder / "camera.mkv", folder / "coded.mkv"
    video = VideoFile(path)
    write_video(
        coded, video, video.frame_count, "FFV1"
    )  # damage to a video that is not compressed shows in pictures alone
    path.write_bytes(damaged(coded.read_bytes()))
    coded.unlink()


def stamps_missing(folder: Path) -> None:
    (folder / "frames.csv").unlink()


def stamps_without_rows(folder: Path) -> None:
    edit_rows(folder, lambda rows: [])


def stamps_without_columns(folder: Path) -> None:
    (folder / "frames.csv").write_text("a,b\n1,2\n")


def rows_gap(folder: Path) -> None:
    edit_rows(folder, lambda rows: rows[:20] + rows[30:])


def rows_repeated(folder: Path) -> None:
    edit_rows(folder, lambda rows: rows[:21] + rows[20:])


def rows_unreadable(folder: Path) -> None:
    edit_rows(folder, lambda rows: [*rows[:20], ["20", "soon"], ["\0"], *rows[21:]])


def rows_fewer(folder: Path) -> None:
    edit_rows(folder, lambda rows: rows[:60])


def rows_more(folder: Path) -> None:
    def more(rows: list[list[str]]) -> list[list[str]]:
        last = [int(value) for value in rows[-1]]
        return rows + [[str(last[0] + k), str(last[1] + 33_333 * k)] for k in range(1, 8)]

    edit_rows(folder, more)


def stamp_repeated(folder: Path) -> None:
    edit_rows(folder, lambda rows: [*rows[:20], [rows[20][0], rows[19][1]], *rows[21:]])


def stamp_backward(folder: Path) -> None:
    edit_rows(folder, lambda rows: [*rows[:20], [rows[20][0], rows[15][1]], *rows[21:]])


def tlog_missing(folder: Path) -> None:
    (folder / "vehicle.tlog").unlink()


def tlog_empty(folder: Path) -> None:
    (folder / "vehicle.tlog").write_bytes(b"")


def tlog_cut(folder: Path) -> None:
    data = (folder / "vehicle.tlog").read_bytes()
    (folder / "vehicle.tlog").write_bytes(data[: len(data) // 2 + 3])


def tlog_garbage(folder: Path) -> None:
    data = (folder / "vehicle.tlog").read_bytes()
    middle = len(data) // 2
    noise = bytes((i * i * 31 + i // 7) % 256 for i in range(997)) + b"\xfd\xfe" * 20
    (folder / "vehicle.tlog").write_bytes(data[:middle] + noise + data[middle + 300 :])


def tlog_two_vehicles(folder: Path) -> None:
    def both(messages: list[Message]) -> Iterable[Message]:
        for i, (stamp_us, message) in enumerate(messages):
            yield stamp_us, message
            if i % 3 == 0:
                other = _copy(message)
                other._header.srcSystem = 7
                yield stamp_us, other

    rewrite(folder, both)


def tlog_two_vehicles_none_named(folder: Path) -> None:
    tlog_two_vehicles(folder)
    settings = folder / "landslope.toml"
    settings.write_text(settings.read_text().replace("system_id = 1", "system_id = 0"))


def tlog_without_attitude(folder: Path) -> None:
    rewrite(
        folder,
        lambda messages: [m for m in messages if m[1].get_type() not in ("ATTITUDE", "ATTITUDE_QUATERNION")],
    )


def tlog_attitude_gap(folder: Path) -> None:
    """No ATTITUDE for 0.8 s."""

    def without(messages: list[Message]) -> Iterable[Message]:
        start_us = messages[0][0] + 1_500_000
        gone = ("ATTITUDE", "ATTITUDE_QUATERNION")
        return [(t, m) for t, m in messages if m.get_type() not in gone or not 0 <= t - start_us < 800_000]

    rewrite(folder, without)


def tlog_not_a_number(folder: Path) -> None:
    def spoil(messages: list[Message]) -> Iterable[Message]:
        for k, i in enumerate(_names(messages, "ATTITUDE")):
            if k % 10 == 0:
                messages[i][1].roll = float("nan")
        for i in _names(messages, "LOCAL_POSITION_NED")[::5]:
            messages[i][1].vx = float("inf")
        return messages

    rewrite(folder, spoil)


def clock_jump(folder: Path, seconds: float, frames_too: bool) -> None:
    """The recording clock is set by ``seconds`` in the middle of the flight."""
    rows = (folder / "frames.csv").read_text().splitlines()[1:]
    at_us = int(rows[len(rows) // 2].split(",")[1]) - 16_000
    by_us = round(seconds * 1e6)
    rewrite(folder, lambda messages: [(t + by_us if t >= at_us else t, m) for t, m in messages])
    if frames_too:
        edit_rows(
            folder, lambda rows: [[n, str(int(t) + by_us)] if int(t) >= at_us else [n, t] for n, t in rows]
        )


def tlog_reboot(folder: Path) -> None:
    """The autopilot's boot time starts again at 3 s in the middle of the flight."""

    def restart(messages: list[Message]) -> Iterable[Message]:
        half = messages[len(messages) // 2][0]
        boots = [m.time_boot_ms for t, m in messages if t >= half and hasattr(m, "time_boot_ms")]
        shift_ms = boots[0] - 3_000
        for stamp_us, message in messages:
            if stamp_us >= half:
                _shift_boot(message, -shift_ms)
            yield stamp_us, message

    rewrite(folder, restart)


def tlog_wrap(folder: Path) -> None:
    """Boot times in milliseconds pass 2^32 in the middle of the flight."""

    def late(messages: list[Message]) -> Iterable[Message]:
        half = messages[len(messages) // 2][0]
        boots = [m.time_boot_ms for t, m in messages if t >= half and hasattr(m, "time_boot_ms")]
        for stamp_us, message in messages:
            _shift_boot(message, WRAP_MS - boots[0])
            yield stamp_us, message

    rewrite(folder, late)


def _shift_boot(message: Any, by_ms: int) -> None:
    if hasattr(message, "time_boot_ms"):
        message.time_boot_ms = (message.time_boot_ms + by_ms) % WRAP_MS
    elif message.get_type() == "RAW_IMU":
        message.time_usec += by_ms * 1000


def calibration_of_other_size(folder: Path) -> None:
    path = folder / "camera.yaml"
    path.write_text(path.read_text().replace("image_width: 320", "image_width: 640"))


def calibration_unreadable(folder: Path) -> None:
    (folder / "camera.yaml").write_text("camera_matrix: [1, 2\n")


def _copy(message: Any) -> Any:
    packer = mavlink.MAVLink(None, message.get_srcSystem(), message.get_srcComponent())
    return mavlink.MAVLink(None).decode(bytearray(message.pack(packer)))


@dataclass(frozen=True, slots=True)
class Edit:
    """An edit and what must come of it.

    ``error``: words of the one-line error; else ``refusals`` as (source, reason) -> how many at least, ``events``
    that must be reported, and the fewest frames with an estimate that is no refusal.
    """

    apply: Callable[[Path], None]
    error: tuple[str, ...] = ()
    refusals: tuple[tuple[str, str, int], ...] = ()
    events: tuple[str, ...] = ()
    frames: int = 90
    with_attitude: int = 85


EDITS: dict[str, Edit] = {
    "nothing": Edit(lambda folder: None),
    "video_missing": Edit(video_missing, error=("camera.mkv", "no such video")),
    "video_empty": Edit(video_empty, error=("camera.mkv", "empty")),
    "video_is_text": Edit(video_is_text, error=("camera.mkv", "no video")),
    "video_cut": Edit(video_cut, refusals=(("camera", "video_ended", 30),), frames=35, with_attitude=35),
    "video_damaged": Edit(
        video_damaged, refusals=(("camera", "video_ended", 30),), frames=35, with_attitude=35
    ),
    "stamps_missing": Edit(stamps_missing, error=("frames.csv", "No such file")),
    "stamps_without_rows": Edit(stamps_without_rows, error=("frames.csv", "no row")),
    "stamps_without_columns": Edit(stamps_without_columns, error=("frames.csv", "host_time_us")),
    "rows_gap": Edit(
        rows_gap, refusals=(("camera", "frame_without_stamp", 10),), frames=80, with_attitude=75
    ),
    "rows_repeated": Edit(rows_repeated, refusals=(("frames.csv", "repeated_row", 1),)),
    "rows_unreadable": Edit(
        rows_unreadable, refusals=(("frames.csv", "unreadable_row", 2),), frames=89, with_attitude=84
    ),
    "rows_fewer": Edit(
        rows_fewer, refusals=(("camera", "frame_without_stamp", 30),), frames=60, with_attitude=55
    ),
    "rows_more": Edit(rows_more, refusals=(("camera", "video_ended", 7),)),
    "stamp_repeated": Edit(
        stamp_repeated, refusals=(("frames", "repeated_stamp", 1),), frames=89, with_attitude=84
    ),
    "stamp_backward": Edit(
        stamp_backward, refusals=(("frames", "backward_stamp", 1),), frames=89, with_attitude=84
    ),
    "tlog_missing": Edit(tlog_missing, error=("vehicle.tlog", "missing")),
    "tlog_empty": Edit(
        tlog_empty, refusals=(("vehicle.tlog", "empty_file", 1),), events=("attitude_lost",), with_attitude=0
    ),
    "tlog_cut": Edit(
        tlog_cut, refusals=(("vehicle.tlog", "cut_off", 1),), events=("attitude_lost",), with_attitude=35
    ),
    "tlog_garbage": Edit(tlog_garbage, refusals=(("vehicle.tlog", "garbage", 1),), with_attitude=80),
    "tlog_two_vehicles": Edit(
        tlog_two_vehicles, refusals=(("ATTITUDE", "foreign_system", 100), ("RAW_IMU", "foreign_system", 100))
    ),
    "tlog_two_vehicles_none_named": Edit(
        tlog_two_vehicles_none_named, error=("vehicle.tlog", "1 and 7", "vehicle.system_id")
    ),
    "tlog_without_attitude": Edit(tlog_without_attitude, events=("attitude_lost",), with_attitude=0),
    "tlog_attitude_gap": Edit(tlog_attitude_gap, events=("attitude_lost", "attitude_back"), with_attitude=60),
    "tlog_not_a_number": Edit(
        tlog_not_a_number,
        refusals=(("ATTITUDE", "not_finite", 20), ("LOCAL_POSITION_NED", "not_finite", 10)),
    ),
    "clock_jump_forward": Edit(
        lambda folder: clock_jump(folder, 100.0, True), events=("clock_jumped",), with_attitude=65
    ),
    "clock_jump_back": Edit(
        lambda folder: clock_jump(folder, -100.0, True),
        refusals=(("frames", "backward_stamp", 2),),
        events=("clock_jumped", "frames_jumped"),
        frames=88,
        with_attitude=65,
    ),
    "clock_jump_of_the_log_alone": Edit(
        lambda folder: clock_jump(folder, 5.0, False), events=("clock_jumped",), with_attitude=65
    ),
    "tlog_reboot": Edit(tlog_reboot, events=("autopilot_rebooted",), with_attitude=75),
    "tlog_wrap": Edit(tlog_wrap, events=("boot_time_wrapped",)),
    "calibration_of_other_size": Edit(calibration_of_other_size, error=("camera.yaml", "640 x 240")),
    "calibration_unreadable": Edit(calibration_unreadable, error=("camera.yaml", "YAML")),
}
