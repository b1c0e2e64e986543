"""The physics behind an ArduPilot SITL, over its JSON interface (``--model JSON:127.0.0.1``), UDP port 9002.

SITL sends motor pulses and waits; each packet moves the physics on by one frame, and the state goes back as one
line of JSON. So the simulation's time is the physics' time, however fast either side is.
"""

import json
import socket
import struct
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from drivers.errors import DriverError
from drivers.simulated.vehicle.rotors import QuadX
from drivers.simulated.vehicle.vehicle import Multirotor

PORT = 9002
MAGIC = 18458
MAGIC_32 = 29569
"""Of packets with 32 instead of 16 channels."""
HEADER = struct.Struct("<HHI")
RATES_HZ = (50, 4000)
"""Frame rates that are believed."""
POLL_S = 0.1
FINEST_STEP_S = 0.003
"""Longer frames are computed in several steps."""


@dataclass(frozen=True, slots=True)
class ServoPacket:
    """What SITL sends: the rate it runs at, its count of frames, pulse widths in microseconds."""

    rate_hz: int
    count: int
    pulses_us: tuple[int, ...]


def parse_servos(data: bytes) -> ServoPacket:
    """Take a packet apart. Raises DriverError for what is no such packet."""
    if len(data) < HEADER.size:
        raise DriverError(f"a packet of {len(data)} bytes is no servo packet of ArduPilot's JSON interface")
    magic, rate, count = HEADER.unpack_from(data)
    channels = {MAGIC: 16, MAGIC_32: 32}.get(magic)
    if channels is None or len(data) != HEADER.size + 2 * channels:
        raise DriverError(
            f"a packet of {len(data)} bytes with magic {magic} is no servo packet of ArduPilot's JSON interface; "
            f"40 bytes and {MAGIC}, or 72 and {MAGIC_32} are"
        )
    if not RATES_HZ[0] <= rate <= RATES_HZ[1]:
        raise DriverError(f"SITL runs at {rate} Hz; {RATES_HZ[0]} to {RATES_HZ[1]} Hz can be simulated")
    return ServoPacket(rate, count, struct.unpack_from(f"<{channels}H", data, HEADER.size))


def state_line(vehicle: Multirotor, time_s: float) -> bytes:
    """The vehicle's state as SITL reads it: one line of JSON, a newline before and after."""
    state: dict[str, Any] = {
        "timestamp": round(time_s, 9),
        "imu": {"gyro": list(vehicle.rates), "accel_body": list(vehicle.specific_force)},
        "position": list(vehicle.position),
        "attitude": list(vehicle.euler),
        "quaternion": list(vehicle.attitude),
        "velocity": list(vehicle.velocity),
        "rng_1": round(max(vehicle.height_above_ground, 0.0), 4),
    }
    # ArduCopter's parser refuses a space behind a colon.
    return b"\n" + json.dumps(state, separators=(",", ":")).encode("ascii") + b"\n"


class JsonBackend:
    """Answers SITL in a thread of its own. Physics starts with the first packet, at ``vehicle.time_s``.

    ``before_step`` and ``after_step`` are called with the physics' time. ``refused`` counts packets that were
    none, ``repeated`` those that SITL sent again because an answer was late or lost.
    """

    def __init__(
        self, vehicle: Multirotor, port: int = PORT, host: str = "127.0.0.1", frame: QuadX | None = None
    ) -> None:
        self.vehicle = vehicle
        self.frame = frame or QuadX()
        self.before_step: Callable[[float], None] | None = None
        self.after_step: Callable[[float], None] | None = None
        self.connected = threading.Event()
        self.refused = 0
        self.repeated = 0
        self.restarts = 0
        self.problem = ""
        """Of the newest packet that was refused."""
        self._count: int | None = None
        self._answer = b""
        self._last: tuple[float, float] = (0.0, 0.0)
        self._stop = threading.Event()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise DriverError(
                f"UDP {host}:{port} cannot be bound ({error.strerror}); another physics backend may be running"
            ) from None
        self._socket.settimeout(POLL_S)
        self._thread = threading.Thread(target=self._run, name="ardupilot-json", daemon=True)

    @property
    def port(self) -> int:
        """The UDP port."""
        return int(self._socket.getsockname()[1])

    @property
    def now_s(self) -> float:
        """The physics' time at this moment, reckoned on from the last packet in real time."""
        at, time_s = self._last
        return time_s + min(time.monotonic() - at, POLL_S) if at else self.vehicle.time_s

    def start(self) -> None:
        """Begin to answer."""
        self._thread.start()

    def stop(self) -> None:
        """End."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                data, sender = self._socket.recvfrom(512)
            except TimeoutError:
                continue
            except ConnectionError:
                continue  # An answer met a SITL that had ended.
            try:
                packet = parse_servos(data)
            except DriverError as error:
                self.refused += 1
                self.problem = str(error)
                continue
            self._advance(packet)
            self._socket.sendto(self._answer, sender)

    def _advance(self, packet: ServoPacket) -> None:
        if packet.count == self._count:
            self.repeated += 1
            return
        if self._count is not None and packet.count < self._count:
            self.restarts += 1  # a new SITL takes over the vehicle where it is
        # What SITL skipped is not made up: it counts frames, the physics counts time.
        self._count = packet.count
        step_s = 1.0 / packet.rate_hz
        pieces = max(1, round(step_s / FINEST_STEP_S))
        command = self.frame.command(packet.pulses_us)
        for _ in range(pieces):
            if self.before_step is not None:
                self.before_step(self.vehicle.time_s)
            self.vehicle.step(step_s / pieces, command)
            if self.after_step is not None:
                self.after_step(self.vehicle.time_s)
        self._answer = state_line(self.vehicle, self.vehicle.time_s)
        self._last = (time.monotonic(), self.vehicle.time_s)
        self.connected.set()
