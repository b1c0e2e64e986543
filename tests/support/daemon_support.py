"""A daemon on the bench: a recorded flight as live camera and live autopilot, and everything it said."""

import math
import threading
import time
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
from bench_clock import HELD_S, SPEED, BenchClock
from places import REPOSITORY
from ports import free_tcp_port, free_udp_port
from vehicle_support import ACCEPTED, TestVehicle, tlog_frames

from companion.live.daemon import Daemon
from companion.live.inputs import Inputs
from companion.messages.messages import Message, topic_of
from companion.settings.settings import Settings
from companion.settings.settings_file import load
from drivers.bus import Endpoints, Subscription
from drivers.cameras.interface import Camera, Grab, Notify, ReaderLimits
from drivers.cameras.reader import ReaderCamera
from drivers.errors import DriverError
from drivers.files.video_file import VideoFile
from drivers.samples import Frame, Refusal

STAIRS = REPOSITORY / "sitl_logs" / "stairs_a"
EVERY = 2
"""Of the recording's 30 frames a second so many are one: 15 a second cost half."""
PATIENCE_S = 600.0
"""Nothing is waited for longer; a test that passes never waits so long."""
LINK_DELAY_US = 1000
"""Shortest delay between a message of the recording and its arrival."""

FrameEdit = Callable[[float, np.ndarray], "np.ndarray | tuple[np.ndarray, int] | None"]
"""(seconds into the cut, image) -> what to show, with a shift of its stamp (us); None: the device is gone."""


def wait_for(condition: Callable[[], object], what: str, timeout_s: float = PATIENCE_S) -> None:
    """Wait until the condition holds; fail with ``what`` was waited for."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, f"no {what} within {timeout_s} s"
        time.sleep(0.02)


@lru_cache(maxsize=4)
def recorded_frames(from_s: float, to_s: float) -> list[tuple[int, np.ndarray]]:
    """(us since the cut's start, grey image) of every second frame of the recording."""
    stamps = [int(line.split(",")[1]) for line in (STAIRS / "frames.csv").read_text().splitlines()[1:]]
    start = stamps[0]
    frames = []
    for index, image in VideoFile(STAIRS / "camera.mkv").images():
        t_us = stamps[index] - start
        if t_us > to_s * 1e6:
            break
        if t_us >= from_s * 1e6 and index % EVERY == 0:
            grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
            frames.append((t_us - int(from_s * 1e6), grey))
    return frames


@lru_cache(maxsize=4)
def recorded_telemetry(from_s: float, to_s: float) -> list[tuple[int, bytes]]:
    """(us since the cut's start, MAVLink frame) of the recording's telemetry."""
    start = int((STAIRS / "frames.csv").read_text().splitlines()[1].split(",")[1])
    cut = int(from_s * 1e6)
    frames = [(stamp - start - cut, frame) for stamp, frame in tlog_frames(STAIRS / "vehicle.tlog")]
    return [(t, frame) for t, frame in frames if 0 <= t <= (to_s - from_s) * 1e6]


class PlayedGrabber:
    """The recording as a device: each frame when its time has come."""

    def __init__(
        self, frames: list[tuple[int, np.ndarray]], clock: BenchClock, edit: FrameEdit | None
    ) -> None:
        self._frames = frames
        self._clock = clock
        self._edit = edit

    def open(self) -> None:
        """Raises DriverError while the device is gone."""
        t_s = self._clock.seconds()
        if self._edit is not None and self._edit(t_s, self._frames[0][1]) is None:
            raise DriverError("the test's camera is unplugged")

    def grab(self) -> Grab | None:
        while True:
            t_us = self._clock.seconds() * 1e6
            following = next((f for f in self._frames if f[0] > max(t_us, self._clock.last_us)), None)
            if following is None:
                self._clock.limit("camera", math.inf)
                time.sleep(0.05)
                return None if self._clock.over else self.grab()
            self._clock.last_us = following[0]
            self._clock.limit("camera", following[0])
            self._clock.wait_until(following[0])
            image = following[1] if self._edit is None else self._edit(following[0] / 1e6, following[1])
            if image is None:
                raise DriverError("the test's camera is unplugged")
            image, shift_us = image if isinstance(image, tuple) else (image, 0)
            return Grab(image.copy(), self._clock.host_us(following[0]) + shift_us)

    def close(self) -> None:
        """Nothing to give back, and nobody waits for it."""
        self._clock.limit("camera", math.inf)


class PlayedCamera(ReaderCamera):
    """Knows whether a frame is still with the daemon: it is done with one when it asks for the next."""

    in_hand = False

    def take(self) -> list[Frame | Refusal]:
        self.in_hand = False
        samples = super().take()
        self.in_hand = any(isinstance(sample, Frame) for sample in samples)
        return samples

    def behind(self) -> bool:
        return self.in_hand or self.status().waiting > 0


class DaemonBench:
    """Plays a cut of stairs_a to a daemon in this process, over a real MAVLink socket and zenoh.

    All live by the bench's clock; with ``driven`` false by the machine's. ``speed`` 1 is for tests of what goes by the
    machine's clock all the same: MAVSDK's patience, heartbeats and the watchdog.
    """

    def __init__(
        self,
        tmp_path: Path,
        cut: tuple[float, float] = (0.0, 6.0),
        *,
        answer: tuple[tuple[float, int], ...] = ACCEPTED,
        edit_frames: FrameEdit | None = None,
        edit_telemetry: Callable[[float, bytes], list[bytes]] | None = None,
        settings: tuple[str, ...] = (),
        listen: bool = True,
        driven: bool = True,
        speed: float = SPEED,
    ) -> None:
        self.clock = BenchClock(driven=driven, speed=speed)
        self.port = free_udp_port()
        zenoh_port = free_tcp_port()
        self.settings: Settings = load(
            STAIRS / "landslope.toml",
            (
                f"mavlink.connection=udpin:127.0.0.1:{self.port}",
                f"vehicle.name=test{zenoh_port}",
                f"zenoh.listen=tcp/127.0.0.1:{zenoh_port}",
                "landing.enabled=true",
                "decision.at_rest_known=false",  # after a fault the cut goes on at a constant velocity
                "decision.touchdown_known=false",  # the cut ends before the vehicle slows down
                *settings,
            ),
        ).settings
        self.messages: list[tuple[str, dict[str, Any]]] = []
        telemetry = recorded_telemetry(*cut)
        self.vehicle = TestVehicle(
            self.port, answer, telemetry, edit=edit_telemetry, clock=self.clock.monotonic
        )
        self.vehicle.on_next = lambda t_us: self.clock.limit("vehicle", t_us)
        least = min(t - int.from_bytes(f[10:14], "little") * 1000 for t, f in telemetry if f[7] == 30)
        self.vehicle.set_boot_us(LINK_DELAY_US - least)
        self._frames = recorded_frames(*cut)
        self._edit_frames = edit_frames
        self._watched = listen
        self.alive = False
        self.endpoints = Endpoints(connect=(f"tcp/127.0.0.1:{zenoh_port}",))
        self._closing = threading.Event()
        self._published: dict[str, Message] = {}
        self._lost, self._read_at = 0, time.monotonic()

    def camera(self, notify: Notify) -> Camera:
        """The recording's frames behind the reader that real cameras have."""
        limits = ReaderLimits(open_timeout_s=30, read_timeout_s=30, first_retry_s=0.1, longest_retry_s=0.2)
        self.played_camera = PlayedCamera(
            "test camera", lambda: PlayedGrabber(self._frames, self.clock, self._edit_frames), limits, notify
        )
        return self.played_camera

    def __enter__(self) -> "DaemonBench":
        self.clock.__enter__()
        self.vehicle.__enter__()
        self.daemon = Daemon(self.settings, Inputs(self.settings, self.camera))
        self._put_on_bus, self.daemon._publisher.publish = self.daemon._publisher.publish, self._publish
        self.clock.hold += [self._frame_in_hand, self._message_on_its_way]
        if self._watched:
            self._listener = threading.Thread(target=self._listen, daemon=True)
            self._listener.start()
            wait_for(lambda: self.alive, "liveliness token")
        self.daemon_thread = threading.Thread(target=self.daemon.run, daemon=True)
        self.daemon_thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.clock.over = True
        self.daemon.stop()
        self.join(PATIENCE_S)
        self._closing.set()
        if self._watched:
            self._listener.join(timeout=PATIENCE_S)
        self.vehicle.__exit__()
        self.clock.__exit__()

    def _frame_in_hand(self) -> bool:
        behind = self.played_camera.behind()
        if behind:
            self.daemon._inbox.wake()
        return behind

    def _behind(self) -> int:
        """Messages that the vehicle sent and the link has not read; those to a port that was not open stay there."""
        link = self.daemon._link
        return self.vehicle.sent - link.counters["frames in"] if link is not None else 0

    def _message_on_its_way(self) -> bool:
        if self._behind() <= self._lost:
            self._read_at = time.monotonic()
            return False
        if time.monotonic() - self._read_at > HELD_S:
            self._lost = self._behind()
        return True

    def wrong_now(self) -> list[str]:
        """The conditions of the newest health; a busy machine that skips frames says so, which no test forbids."""
        codes = [c["code"] for c in self.of("health")[-1]["conditions"]]
        return [code for code in codes if code != "overloaded"]

    def join(self, timeout_s: float) -> None:
        """Wait for the daemon's end."""
        self.daemon_thread.join(timeout=timeout_s)
        assert not self.daemon_thread.is_alive(), "the daemon does not end"

    def play(self) -> None:
        """Begin, once MAVSDK has found the vehicle."""
        wait_for(lambda: self.daemon.commander_connected, "connection of MAVSDK")
        self._lost = self._behind()
        self.clock.limit("vehicle", 0)
        self.clock.start()
        self.vehicle.play()

    def play_to_end(self, then_s: float = 0.5) -> None:
        """Begin and wait for the end of the cut."""
        self.play()
        self.wait_for_end()
        wait_for(lambda: not self.daemon._commander.busy, "end of the command")
        self.go_on(then_s)

    def go_on(self, seconds: float) -> None:
        """Let that much of the bench's time pass, and wait for the messages that were published by then."""
        self.clock.wait_until((self.clock.seconds() + seconds) * 1e6)
        for topic, message in list(self._published.items()):
            wait_for(lambda t=topic, m=message: self._has(t, m), f"{topic} that was published")

    def _has(self, topic: str, message: Message) -> bool:
        """Whether a message, or one of its topic that is newer, has come over the bus."""
        return any(m["time_unix_us"] >= message.time_unix_us for m in self.of(topic)[-50:])

    def _publish(self, message: Message) -> None:
        self._put_on_bus(message)
        if self._watched:
            self._published[topic_of(message)] = message

    def wait_for_end(self) -> None:
        """Wait until the recording has been played."""
        assert self.vehicle.played.wait(10 * PATIENCE_S)

    def of(self, topic: str) -> list[dict[str, Any]]:
        """Messages of one topic so far."""
        return [m for t, m in list(self.messages) if t == topic]

    def events(self, name: str) -> list[dict[str, Any]]:
        """Events of one name so far."""
        return [m for m in self.of("event") if m["event"] == name]

    def at_s(self, message: dict[str, Any]) -> float:
        """Seconds into the cut of a message."""
        return (message["time_unix_us"] - self.clock.host_us(0)) / 1e6

    def problems(self) -> set[str]:
        """Every problem that health ever reported."""
        return {p for h in self.of("health") for p in h["problems"]}

    def counters(self) -> dict[str, int]:
        """The newest counters."""
        return self.of("health")[-1]["counters"]

    def _listen(self) -> None:
        with Subscription(self.endpoints, self.settings.vehicle.name) as subscription:
            while not self._closing.is_set():
                delivery = subscription.receive(0.1)
                if delivery is None or delivery.topic == "preview":
                    continue
                if delivery.alive is not None:
                    self.alive = delivery.alive
                else:
                    self.messages.append((delivery.topic, msgspec.json.decode(delivery.payload)))
