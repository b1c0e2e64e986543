"""A vehicle for tests: speaks MAVLink on a real UDP socket, plays a recorded tlog, answers commands as configured."""

import heapq
import math
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from ports import free_udp_port
from pymavlink.dialects.v20 import ardupilotmega as dialect

from drivers.events import DriverEvent
from drivers.mavlink.framing import FrameSplitter, WireFrame, checksum, crc_extra_of
from drivers.mavlink.link import Link, LinkOptions
from drivers.samples import Refusal, Sample

COPTER_GUIDED = 4
COPTER_LAND = 9
NAV_LAND = 21

# What the vehicle does with MAV_CMD_NAV_LAND: (seconds after the command, result) each; the mode follows an ACCEPTED.
ACCEPTED = ((0.0, dialect.MAV_RESULT_ACCEPTED),)
DENIED = ((0.0, dialect.MAV_RESULT_DENIED),)
TEMPORARILY_REJECTED = ((0.0, dialect.MAV_RESULT_TEMPORARILY_REJECTED),)
IN_PROGRESS_ACCEPTED = ((0.0, dialect.MAV_RESULT_IN_PROGRESS), (0.6, dialect.MAV_RESULT_ACCEPTED))
IN_PROGRESS_SILENCE = ((0.0, dialect.MAV_RESULT_IN_PROGRESS),)
SILENCE: tuple[tuple[float, int], ...] = ()

HEARTBEAT, ATTITUDE = b"\0\0\0", b"\x1e\0\0"
"""Message ids 0 and 30 in a MAVLink 2 header."""
LONGEST_SILENCE_S = 1.2
"""Between heartbeats while the recording plays slowly: MAVSDK, which lives by the machine's clock, waits for 3 s."""


def tlog_frames(path: Path) -> list[tuple[int, bytes]]:
    """(arrival stamp in us, frame) of every MAVLink frame of an intact tlog."""
    data = path.read_bytes()
    frames, at = [], 0
    while at + 8 < len(data):
        (stamp,) = struct.unpack(">Q", data[at : at + 8])
        start = at + 8
        if data[start] == 0xFD:
            length = 12 + data[start + 1] + (13 if data[start + 2] & 1 else 0)
        else:
            length = 8 + data[start + 1]
        frames.append((stamp, data[start : start + length]))
        at = start + length
    return frames


def patched(frame: bytes, offset: int, value: bytes) -> bytes:
    """A MAVLink 2 frame with payload bytes replaced; the checksum is left to the sender."""
    body = bytearray(frame)
    length = body[1]
    if offset + len(value) > length:  # the wire drops trailing zeros
        grown = offset + len(value)
        body = body[: 10 + length] + bytes(grown - length) + body[10 + length :]
        body[1] = grown
    body[10 + offset : 10 + offset + len(value)] = value
    return bytes(body)


class TestVehicle:
    """Sends to 127.0.0.1:``port`` (where a link listens) from a socket of its own, in a thread of its own.

    ``frames`` are (us since the start, frame) of a recording, sent at that pace once ``play()`` is called; without
    them it beats only; paced by ``clock`` (s). ``answer`` says what becomes of NAV_LAND. ``edit(t_s, frame)``
    may replace a frame by others.
    """

    __test__ = False

    def __init__(
        self,
        port: int,
        answer: tuple[tuple[float, int], ...] = ACCEPTED,
        frames: list[tuple[int, bytes]] | None = None,
        system: int = 1,
        component: int = 1,
        edit: Callable[[float, bytes], list[bytes]] | None = None,
        mode: int = COPTER_GUIDED,
        seal: Callable[[bytes], bytes] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.commands: list[tuple[float, Any]] = []
        self.received: list[Any] = []
        self.received_raw: list[bytes] = []
        self.beats: list[float] = []
        """When heartbeats of the companion came (monotonic)."""
        self.beats_s: list[float] = []
        """The same in seconds into the recording."""
        self.sent = 0
        """Frames that went out."""
        self.on_next: Callable[[float], None] = lambda t_us: None
        """Called with the moment of the next frame of the recording, once those before it went out."""
        self.landed_at: float | None = None
        self.armed = True
        self.autopilot = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
        self.mode = mode
        self.muted = False
        """While True nothing is sent or heard: the link is lost."""
        self.played = threading.Event()
        self._answer = answer
        self._frames = frames or []
        self._edit = edit
        self._seal = seal
        self._target = ("127.0.0.1", port)
        self._mav = dialect.MAVLink(None, system, component)
        self._parser = dialect.MAVLink(None)
        self._splitter = FrameSplitter()
        self._sequence = 0
        self._lock = threading.Lock()
        self._due: list[tuple[float, int, Callable[[], None]]] = []
        self._ticket = 0
        self._play_from: float | None = None
        self._position = 0
        self._boot_us_at_start = self._restarted_us = 0
        self._clock = clock
        self._start = clock()
        self._heartbeat_sent = 0.0
        self._stop = threading.Event()
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.002)
        self._thread = threading.Thread(target=self._run, name="test vehicle", daemon=True)

    def __enter__(self) -> "TestVehicle":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(timeout=3)
        self.socket.close()

    def play(self) -> None:
        """Begin with the recording."""
        self._play_from = self._clock()

    @property
    def play_s(self) -> float:
        """Seconds into the recording."""
        return 0.0 if self._play_from is None else self._clock() - self._play_from

    def land_commands(self) -> list[Any]:
        """Every NAV_LAND received; MAVSDK repeats one, up to four in all, while no answer comes."""
        return [c for _, c in self.commands if c.command == NAV_LAND]

    def send(self, message: Any) -> None:
        """Send a message of ours."""
        self.send_frame(bytes(message.pack(self._mav)))

    def send_frame(self, frame: bytes, resequence: bool = True) -> None:
        """Send a frame, numbered as ours and with its checksum set."""
        with self._lock:
            if resequence:
                frame = renumbered(frame, self._sequence)
                self._sequence = (self._sequence + 1) & 0xFF
            if self._seal is not None:
                frame = self._seal(frame)
            if not self.muted:
                if frame[7:10] == HEARTBEAT:
                    self._heartbeat_sent = time.monotonic()
                self.socket.sendto(frame, self._target)
                self.sent += 1

    def send_bytes(self, data: bytes) -> None:
        """Send anything at all."""
        self.socket.sendto(data, self._target)

    def _run(self) -> None:
        next_beat = 0.0
        while not self._stop.is_set():
            now = time.monotonic()
            if now >= next_beat and (self._play_from is None or self._position >= len(self._frames)):
                self._beat()
                next_beat = now + 0.25
            self._play(self._clock())
            while self._due and self._due[0][0] <= now:
                heapq.heappop(self._due)[2]()
            try:
                data = self.socket.recv(65536)
            except TimeoutError:
                continue
            except ConnectionError:
                continue
            if not self.muted:
                self._receive(data)

    def _beat(self) -> None:
        base = 81 | (128 if self.armed else 0)
        self.send(dialect.MAVLink_heartbeat_message(2, self.autopilot, base, self.mode, 4, 3))

    def _play(self, now: float) -> None:
        if self._play_from is None:
            return
        elapsed_us = (now - self._play_from) * 1e6
        while self._position < len(self._frames) and self._frames[self._position][0] <= elapsed_us:
            at_us, frame = self._frames[self._position]
            self._position += 1
            if frame[7:10] == b"\0\0\0":  # the heartbeat carries the mode that the commands made
                frame = patched(frame, 0, struct.pack("<I", self.mode))
            for out in [frame] if self._edit is None else self._edit(at_us / 1e6, frame):
                if (
                    out[7:10] == frame[7:10] == ATTITUDE
                ):  # an autopilot that restarts counts anew in TIMESYNC too
                    edited_ms, recorded_ms = (struct.unpack("<I", f[10:14])[0] for f in (out, frame))
                    self._restarted_us = (edited_ms - recorded_ms) * 1000
                self.send_frame(out)
                if time.monotonic() - self._heartbeat_sent > LONGEST_SILENCE_S:
                    self._beat()
        self.on_next(self._frames[self._position][0] if self._position < len(self._frames) else math.inf)
        if self._position >= len(self._frames):
            self.played.set()

    def boot_us(self) -> int:
        """The vehicle's time since boot: that of the recording."""
        since_s = self._clock() - (self._play_from or self._start)
        return self._boot_us_at_start + self._restarted_us + int(since_s * 1e6)

    def set_boot_us(self, boot_us: int) -> None:
        """The boot time at the recording's start."""
        self._boot_us_at_start = boot_us

    def _receive(self, data: bytes) -> None:
        self.received_raw.append(data)
        for piece in self._splitter.feed(data):
            if not isinstance(piece, WireFrame):
                continue
            message = self._parser.decode(bytearray(piece.data))
            self.received.append(message)
            name = message.get_type()
            if name == "HEARTBEAT":
                self.beats.append(time.monotonic())
                self.beats_s.append(self.play_s)
            elif name == "TIMESYNC" and message.tc1 == 0:
                self.send(dialect.MAVLink_timesync_message(self.boot_us() * 1000, message.ts1))
            elif name == "COMMAND_LONG":
                self.commands.append((self.play_s, message))
                self._obey(message)

    def _obey(self, command: Any) -> None:
        if command.command != NAV_LAND:
            self._acknowledge(command, dialect.MAV_RESULT_ACCEPTED)
            return
        for delay_s, result in self._answer:
            self._ticket += 1
            due = (
                time.monotonic() + delay_s,
                self._ticket,
                lambda result=result: self._acknowledge(command, result),
            )
            heapq.heappush(self._due, due)

    def _acknowledge(self, command: Any, result: int) -> None:
        if command.command == NAV_LAND and result == dialect.MAV_RESULT_ACCEPTED:
            self.mode = COPTER_LAND
            self.landed_at = self.play_s
        self.send(
            dialect.MAVLink_command_ack_message(
                command.command, result, 0, 0, command.get_srcSystem(), command.get_srcComponent()
            )
        )
        if command.command == NAV_LAND and result == dialect.MAV_RESULT_ACCEPTED:
            self._beat()


def renumbered(frame: bytes, sequence: int) -> bytes:
    """A MAVLink 2 frame with another sequence number and its checksum set."""
    body = bytearray(frame[:-2])
    body[4] = sequence
    extra = crc_extra_of(int.from_bytes(body[7:10], "little"))
    assert extra is not None
    return bytes(body) + checksum(bytes(body), len(body), extra).to_bytes(2, "little")


PATIENCE_S = 600.0


def wait_for(condition: Callable[[], object], what: str) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, f"no {what} within {PATIENCE_S} s"
        time.sleep(0.01)


class LinkBench:
    """A link that listens on a free port, and what it said."""

    def __init__(self, **options: object) -> None:
        self.port = free_udp_port()
        self.samples: list[Sample] = []
        self.events: list[DriverEvent] = []
        options = {"connection": f"udpin:127.0.0.1:{self.port}", "system_id": 1} | options
        self.link = Link(LinkOptions(**options), self.samples.extend, self.events.append)
        self.link.start()

    def refusals(self, reason: str) -> list[Refusal]:
        return [s for s in self.samples if isinstance(s, Refusal) and s.reason == reason]

    def of(self, kind: type) -> list[Sample]:
        return [s for s in self.samples if isinstance(s, kind)]

    def event_names(self) -> list[str]:
        return [e.event for e in self.events]


@pytest.fixture
def link_bench() -> Iterator[Callable[..., LinkBench]]:
    benches: list[LinkBench] = []

    def make(**options: object) -> LinkBench:
        benches.append(LinkBench(**options))
        return benches[-1]

    yield make
    for b in benches:
        b.link.close()


def attitude(boot_ms: int, roll: float = 0.0) -> object:
    return dialect.MAVLink_attitude_message(boot_ms, roll, 0, 0, 0, 0, 0)
