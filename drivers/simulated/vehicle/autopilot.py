"""A simulated multirotor autopilot that speaks MAVLink 2 over a socket as ArduCopter does.

Time is either real (``start`` runs a thread, ``speed`` times as fast as the clock) or driven (``advance``).
"""

import random
import select
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.simulated.vehicle.autopilot_protocol import Answer, AutopilotProtocol, ReceivedCommand
from drivers.simulated.vehicle.flight_controller import FlightController
from drivers.simulated.vehicle.peers import Endpoint, Peer
from drivers.simulated.vehicle.sensors import SensorErrors, Sensors
from drivers.simulated.vehicle.telemetry_streams import Origin, TelemetryStreams
from drivers.simulated.vehicle.vehicle import Multirotor

LONGEST_LAG_S = 0.1
"""Physics that falls behind the clock by more than this does not catch up: time stretches."""


@dataclass(slots=True)
class LinkFaults:
    """What the way between autopilot and companion does to messages; may be changed in flight."""

    delay_s: tuple[float, float] = (0.0, 0.0)
    """Shortest and longest delay of a message on its way out; order is kept."""
    loss: float = 0.0
    """Share of the messages lost, each way."""
    silent: bool = False
    """The cable is out: nothing passes either way."""


class SimulatedAutopilot:
    """Vehicle, flight controller, sensors and MAVLink on one endpoint.

    ``connection`` is ``udpout:HOST:PORT``, ``udpin:HOST:PORT`` or ``tcp:HOST:PORT`` (a server), port 0 for a
    free one, see ``port``. ``since_boot_s`` is the age of the autopilot at the start: 4294960 puts its 32 bit
    milliseconds seven seconds before their wrap. From another thread take ``lock`` around what
    is not a method of this class.
    """

    def __init__(
        self,
        connection: str,
        vehicle: Multirotor | None = None,
        *,
        errors: SensorErrors | None = None,
        link: LinkFaults | None = None,
        origin: Origin | None = None,
        system_id: int = 1,
        component_id: int = 1,
        since_boot_s: float = 30.0,
        step_hz: float = 400.0,
        speed: float = 1.0,
        seed: int = 1,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.vehicle = vehicle or Multirotor(seed=seed)
        self.controller = FlightController(self.vehicle)
        self.sensors = Sensors(self.vehicle, errors or SensorErrors(), seed + 1)
        self.streams = TelemetryStreams(self.controller, self.sensors, origin or Origin())
        self.streams.boot_s = self.vehicle.time_s - since_boot_s
        self.protocol = AutopilotProtocol(self.controller, self.streams, system_id, component_id)
        self.link = link or LinkFaults()
        self.lock = threading.RLock()
        self.speed = speed
        self.before_step: Callable[[float], None] | None = None
        """Called with the simulated time before every step of the physics: a pilot or a flight script."""
        self.after_step: Callable[[float], None] | None = None
        """The same after every step."""
        self._step_s = 1.0 / step_hz
        self._clock = clock
        self._random = random.Random(seed + 2)
        self._dark_until_s: float | None = None
        self._thread: threading.Thread | None = None
        self._pace = (0.0, 0.0)
        """(clock's time, simulated time) at one moment."""
        self._stop = threading.Event()
        self._endpoint = Endpoint(connection, system_id, component_id)
        self._later: list[tuple[float, Peer, Any]] = []
        self._started_s = self.vehicle.time_s
        self._steps = 0

    # -- its life ----------------------------------------------------------------------------------------

    @property
    def port(self) -> int:
        """The local port."""
        return self._endpoint.port

    @property
    def time_s(self) -> float:
        """Simulated time."""
        return self.vehicle.time_s

    @property
    def now_s(self) -> float:
        """Simulated time at this moment, which the physics has not quite reached yet; ``time_s`` when driven."""
        if self._thread is None:
            return self.time_s
        return min(self._paced_s(), self.time_s + LONGEST_LAG_S * self.speed)

    def _paced_s(self) -> float:
        """Where the clock says that simulated time should be."""
        started, origin = self._pace
        return origin + (self._clock() - started) * self.speed

    @property
    def commands(self) -> list[ReceivedCommand]:
        """Commands received so far, oldest first."""
        with self.lock:
            return list(self.protocol.commands)

    def start(self) -> None:
        """Run in a thread of its own, ``speed`` times as fast as the clock."""
        self._pace = (self._clock(), self.time_s)
        self._thread = threading.Thread(target=self._run, name="simulated-autopilot", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the thread and close the sockets."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
        self._endpoint.close()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    # -- what tests and scenarios do to it ---------------------------------------------------------------

    def set_answer(self, command: int, answer: Answer) -> None:
        """How a MAV_CMD is answered from now on; see ``autopilot_protocol.Answer``."""
        with self.lock:
            self.protocol.set_answer(command, answer)

    def set_mode(self, name: str) -> bool:
        """Switch the flight mode as the pilot does at the radio; False when the autopilot refuses."""
        with self.lock:
            return self.controller.set_mode(name)

    def set_channel(self, channel: int, pulse_us: int) -> None:
        """Move a stick or switch of the radio (channel 1 to 18)."""
        with self.lock:
            self.controller.pulse_us[channel - 1] = pulse_us

    def reboot(self, down_s: float = 1.0) -> None:
        """Fall silent for ``down_s`` and boot again: boot time from zero, message rates as after a boot.

        As after a watchdog reset in flight, armed state and mode survive and the vehicle keeps flying.
        """
        with self.lock:
            self._dark_until_s = self.time_s + down_s

    def send(self, message: Any) -> None:
        """Send any message to all peers, as if the autopilot had."""
        with self.lock:
            for peer in self._endpoint.peers:
                self._queue(peer, message, self.time_s)

    # -- time --------------------------------------------------------------------------------------------

    def advance(self, until_s: float) -> None:
        """Move physics and messages on to a simulated time."""
        with self.lock:
            while self._started_s + (self._steps + 1) * self._step_s <= until_s + 1e-9:
                if self.before_step is not None:
                    self.before_step(self.time_s)
                self.vehicle.step(self._step_s, self.controller.step(self._step_s))
                self._steps += 1
                self.vehicle.time_s = self._started_s + self._steps * self._step_s
                self.sensors.step(self._step_s)
                if self.after_step is not None:
                    self.after_step(self.time_s)
                self._stream()
            self._answer(until_s)
            for due in [entry for entry in self._later if entry[0] <= until_s]:
                self._later.remove(due)
                self._queue(due[1], due[2], until_s)
            self._flush(until_s)

    def _run(self) -> None:
        while not self._stop.is_set():
            now = self._paced_s()
            if now - self.time_s > LONGEST_LAG_S * self.speed:
                # The machine slept or is too slow: time stretches rather than bursts.
                now = self.time_s + LONGEST_LAG_S * self.speed
                self._pace = (self._clock(), now)
            self.advance(now)
            wait = (self._started_s + (self._steps + 1) * self._step_s - now) / self.speed
            select.select(self._endpoint.sockets(), [], [], max(wait, 0.0))

    def _stream(self) -> None:
        now = self.time_s
        if self._dark_until_s is not None:
            if now < self._dark_until_s:
                return
            self._dark_until_s = None
            self.streams.reset()
            self.streams.boot_s = now
        messages = self.streams.due(now)
        for severity, text in self.controller.texts:
            messages.append(mavlink.MAVLink_statustext_message(severity, text.encode()[:50]))
        self.controller.texts.clear()
        for peer in self._endpoint.peers:
            for message in messages:
                self._queue(peer, message, now)

    def _answer(self, now: float) -> None:
        for peer, data in self._endpoint.receive():
            if self._dark_until_s is not None or self.link.silent:
                continue
            for message in peer.codec.parse_buffer(data) or ():
                if message.get_type() == "BAD_DATA" or self._lost():
                    continue
                for delay, reply in self.protocol.handle(message, now):
                    self._later.append((now + delay, peer, reply))

    def _queue(self, peer: Peer, message: Any, now: float) -> None:
        data = message.pack(peer.codec)
        peer.codec.seq = (peer.codec.seq + 1) % 256
        if self._lost() or self.link.silent:
            return
        low, high = self.link.delay_s
        release = now + (self._random.uniform(low, high) if high > 0.0 else 0.0)
        queue = peer.queue
        queue.append((max(release, queue[-1][0]) if queue else release, data))

    def _flush(self, now: float) -> None:
        for peer in list(self._endpoint.peers):
            while peer.queue and peer.queue[0][0] <= now + 1e-9 and peer.open:
                self._endpoint.send(peer, peer.queue.popleft()[1])

    def _lost(self) -> bool:
        return self.link.loss > 0.0 and self._random.random() < self.link.loss
