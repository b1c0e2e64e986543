"""The one MAVLink link: owns the port, believes one vehicle, shares the bytes with MAVSDK and other programs."""

import threading
from collections import Counter, deque
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from drivers.events import DriverEvent
from drivers.mavlink.command_gate import CommandGate
from drivers.mavlink.endpoint import Endpoint
from drivers.mavlink.forward import Forwarder
from drivers.mavlink.framing import Garbage, WireFrame
from drivers.mavlink.identity import Sender, VehicleIdentity
from drivers.mavlink.link_options import LinkOptions
from drivers.mavlink.message_rates import MessageRates
from drivers.mavlink.outgoing import Sealer
from drivers.mavlink.ports import Address
from drivers.mavlink.rates_owner import RatesOwner
from drivers.mavlink.sender_splitters import SenderSplitters
from drivers.mavlink.signing import Signer, unsigned
from drivers.mavlink.signing_memory import SigningMemory
from drivers.mavlink.telemetry import MESSAGE_IDS, STREAM_IDS, TelemetryDecoder
from drivers.mavlink.timesync import TimeSync
from drivers.mavlink.unpacking import Unpacker
from drivers.refusals import RefusalCode
from drivers.samples import Attitude, CommandAnswer, Heartbeat, Imu, Refusal, Sample, Velocity
from drivers.system.host_clock import now_us as host_now_us

HOUSEKEEPING_S = 0.1
REBOOT_BACK_US = 1_000_000
"""Boot time that falls by more than this is a reboot; by less, a late message."""
SAY_AGAIN_US = 30_000_000
"""The same refusal is reported as an event at most this often; every one is counted."""
HEARTBEAT_ID = 0
KNOCK_EVERY_US = 1_000_000
SAVE_EVERY_US = 10_000_000
"""How often the time of a signed link is kept on disk."""
DEFAULT_SYSTEM_ID = 1
"""As which system we speak before any vehicle was heard and none is named."""
IMU_OF = {"ardupilot": ("RAW_IMU",), "px4": ("HIGHRES_IMU",)}
"""Autopilot -> the gyro message it sends; an unknown one is asked for both."""

_ESTIMATOR = ("ESTIMATOR_STATUS", "ODOMETRY", "EKF_STATUS_REPORT")
ONLY_OF = {
    "CURRENT_MODE": "px4",
    "MANUAL_CONTROL": "px4",
    "ESTIMATOR_STATUS": "px4",
    "ODOMETRY": "px4",
    "EKF_STATUS_REPORT": "ardupilot",
}
"""Message -> the autopilot that sends it: PX4's HEARTBEAT keeps to 1 Hz, and it passes a joystick's sticks on."""
MAY_BE_MISSING = frozenset({"MANUAL_CONTROL", "RC_CHANNELS", "CURRENT_MODE", *_ESTIMATOR})
"""Messages that come only with a joystick, a receiver, or from newer firmware: none is no rate that is too low."""


class Link:
    """Opens the port and keeps it open; hands over samples from a thread of its own.

    ``on_samples(samples)`` and ``on_event(event)`` are called from the link's threads and must return at once.
    ``on_frame(arrival_us, frame)`` gets every frame of both directions, for a recording. ``raw_out`` is where
    MAVSDK takes the vehicle's bytes, without its streams. ``may_beat()`` says whether MAVSDK's heartbeats may go out.
    """

    def __init__(
        self,
        options: LinkOptions,
        on_samples: Callable[[list[Sample]], None],
        on_event: Callable[[DriverEvent], None] = lambda event: None,
        on_frame: Callable[[int, bytes], None] | None = None,
    ) -> None:
        self.options = options
        self.counters: Counter[str] = Counter()
        self.gate = CommandGate()
        """What MAVSDK may make of the vehicle."""
        self.rates = MessageRates({})
        self.raw_out: Callable[[bytes], None] | None = None
        self.may_beat: Callable[[], bool] = lambda: True
        self.answers: deque[CommandAnswer] = deque(maxlen=64)
        self.vehicle_found = threading.Event()
        self._on_samples = on_samples
        self._on_event = on_event
        self.on_frame = on_frame
        memory = SigningMemory(options.signing_memory) if options.signing_memory else None
        self._signer = Signer(options.signing_key, memory=memory) if options.signing_key else None
        self._sealer = Sealer(options.own_component, self._signer)
        self._identity = VehicleIdentity(
            options.system_id, options.autopilot_component, options.own_component
        )
        self._decoder = TelemetryDecoder(0, options.autopilot_component, options.own_component)
        self._unpacker = Unpacker()
        self._rates_owner = RatesOwner()
        self._timesync = TimeSync(options.timesync_interval_s)
        self._splitters = SenderSplitters()
        self._autopilot: str | None = None
        self._boot_us: int | None = None
        self._said_us: dict[str, int] = {}
        self._slow: frozenset[str] = frozenset()
        self._stop = threading.Event()
        self._port = Endpoint(options.connection, self._receive, self._port_changed)
        self._forwarder = Forwarder(options.forward, self._forwarded)
        self._keeper = threading.Thread(target=self._keep, name="link housekeeping", daemon=True)

    def start(self) -> None:
        """Open the ports and begin."""
        self._forwarder.start()  # first: the vehicle's first bytes are for the others too
        self._port.start()
        self._keeper.start()

    def close(self) -> None:
        """Stop the threads and close the ports."""
        if self._signer is not None:
            self._signer.save()
        self._stop.set()
        if self._keeper.is_alive():
            self._keeper.join(timeout=3)
        self._port.close()
        self._forwarder.close()

    @property
    def system_id(self) -> int | None:
        """The vehicle's system id; None as long as none was heard."""
        return self._identity.system_id if self.vehicle_found.is_set() else None

    @property
    def autopilot(self) -> str | None:
        """The vehicle's autopilot by name ("ardupilot", "px4"); None before its first heartbeat."""
        return self._autopilot

    @property
    def ambiguous(self) -> bool:
        """Whether a second vehicle was heard although the settings name none: nothing may be commanded."""
        return self._identity.ambiguous

    @property
    def is_open(self) -> bool:
        """Whether the port is open."""
        return self._port.is_open

    def send(self, message: Any) -> bool:
        """Send a pymavlink message as our component of the vehicle; False while there is no vehicle or no port."""
        system = self.system_id
        return system is not None and self._write(self._sealer.pack(message, system))

    def send_raw(self, data: bytes) -> None:
        """Send what MAVSDK wrote; heartbeats only while they may go out, setpoints and commands past the gate."""
        for frame, sealed in self._sealer.take_over(data):
            if self._rates_owner.takes(frame, self.rates.wanted_hz):
                self.counters["rate requests of MAVSDK answered"] += 1
            elif frame.message_id == HEARTBEAT_ID and not self.may_beat():
                self.counters["heartbeats withheld"] += 1
            elif refusal := self.gate.refusal(frame):
                self.counters[f"orders withheld: {refusal}"] += 1
            else:
                self._write(sealed)

    def _write(self, frame: bytes) -> bool:
        sent = self._port.write(frame)
        self._forwarder.write(frame)
        self.counters["frames out" if sent else "frames out lost"] += 1
        if sent and self.on_frame is not None:
            self.on_frame(host_now_us(), frame)
        return sent

    def _receive(self, data: bytes, sender: Address) -> None:
        now_us = host_now_us()
        self.counters["bytes in"] += len(data)
        splitter = self._splitters.of(sender, keep=self._identity.sender)
        samples: list[Sample] = []
        for piece in splitter.feed(data):
            self._forwarder.write(piece.data)
            if isinstance(piece, Garbage):
                self.counters["garbage bytes"] += len(piece.data)
                reason = RefusalCode.BAD_CHECKSUM if piece.bad_checksum else RefusalCode.GARBAGE
                samples.append(Refusal(now_us, "mavlink", reason, f"{len(piece.data)} bytes"))
            else:
                samples += self._frame(piece, sender, now_us)
        if samples:
            self._on_samples(samples)

    def _frame(self, frame: WireFrame, sender: Address, now_us: int) -> list[Sample]:
        self.counters["frames in"] += 1
        if self._signer is not None:
            reason = self._signer.refusal(frame)
            if reason is not None:
                return self._refuse(reason, frame, sender, now_us)
        verdict = self._identity.check(frame, sender, now_us)
        if verdict == Sender.NOBODY_YET:
            self.counters["frames before a heartbeat"] += 1
            return []
        if verdict == Sender.OTHER:
            self.counters["frames of others"] += 1
            if frame.system == self._identity.system_id:
                self._record(frame, now_us)  # another component of the vehicle
            if frame.component != self.options.autopilot_component or frame.message_id not in MESSAGE_IDS:
                return []
            verdict = RefusalCode.FOREIGN_SYSTEM
        if isinstance(verdict, RefusalCode):
            return self._refuse(verdict, frame, sender, now_us)
        return self._vehicle_frame(frame, now_us)

    def _refuse(self, reason: RefusalCode, frame: WireFrame, sender: Address, now_us: int) -> list[Sample]:
        self.counters[f"refused: {reason}"] += 1
        who = f"system {frame.system} component {frame.component}"
        if sender is not None:
            who += f" at {sender[0]}:{sender[1]}"
        if now_us - self._said_us.get(reason, -SAY_AGAIN_US) >= SAY_AGAIN_US:
            self._said_us[reason] = now_us
            text = f"refused messages of {who}: {reason.words}"
            if reason is RefusalCode.UNSIGNED:
                text += "; mavlink.signing_key is set here, but this sender does not sign"
            if reason is RefusalCode.SECOND_VEHICLE:
                text += "; set vehicle.system_id, nothing is commanded until then"
            self._event("mavlink_refused", "warning", text, now_us, reason=reason)
        return [Refusal(now_us, "mavlink", reason, who)]

    def _record(self, frame: WireFrame, now_us: int) -> None:
        """For a recording, after the sender was checked: a flood of foreign frames fills no disk."""
        if self.on_frame is not None:
            self.on_frame(now_us, frame.data)

    def _forwarded(self, frame: WireFrame) -> bool:
        """A frame of another program to the vehicle; nobody speaks there as us."""
        if frame.system == self.system_id and frame.component == self.options.own_component:
            self.counters[f"refused: {RefusalCode.OUR_NAME}"] += 1
            return False
        return self._port.write(frame.data)

    def _vehicle_frame(self, frame: WireFrame, now_us: int) -> list[Sample]:
        self._record(frame, now_us)
        message = None
        if frame.message_id in MESSAGE_IDS:
            try:
                message = self._unpacker.unpack(frame)
            except dialect.MAVError as error:
                return [Refusal(now_us, "mavlink", RefusalCode.UNDECODABLE, str(error))]
            if not self._for_us(message):
                self.counters["answers to others"] += 1
                return []
        self.counters["frames of the vehicle"] += 1
        if not self.vehicle_found.is_set() and frame.message_id == HEARTBEAT_ID:
            self._found(now_us)
        samples: list[Sample] = []
        if message is not None:
            name = message.get_type()
            self.rates.seen(name)
            samples = self._decoder.decode(message, now_us)
            for sample in samples:
                self._watch(sample, now_us)
            if name == "TIMESYNC" and message.tc1 == 0:
                # the autopilot's own question: with our answer its log relates both clocks
                self.send(dialect.MAVLink_timesync_message(host_now_us() * 1000, message.ts1))
        # Last, so that an answer is on record before MAVSDK's call returns with it.
        if self.raw_out is not None and frame.message_id not in STREAM_IDS:
            self.raw_out(unsigned(frame.data))
        return samples

    def _for_us(self, message: Any) -> bool:
        name = message.get_type()
        if name == "COMMAND_ACK":
            ours = (0, self._identity.system_id), (0, self.options.own_component)
            return message.target_system in ours[0] and message.target_component in ours[1]
        if name == "TIMESYNC" and message.tc1 != 0:
            return self._timesync.answers_us(message.tc1, message.ts1)
        return True

    def _found(self, now_us: int) -> None:
        self.vehicle_found.set()
        self._port.believe(self._identity.sender)
        self._event(
            "vehicle_found", "info", f"vehicle with system id {self._identity.system_id} found", now_us
        )

    def _watch(self, sample: Sample, now_us: int) -> None:
        if not isinstance(sample, Imu | Velocity):  # the most frequent ones say nothing of orders
            self.gate.saw(sample)
        if isinstance(sample, Heartbeat):
            self._port.believe(self._identity.sender)
            if sample.autopilot != self._autopilot:
                self._autopilot = sample.autopilot
                self.rates.want(self._wanted(sample.autopilot))
        elif isinstance(sample, Attitude):
            if self._boot_us is not None and sample.boot_us < self._boot_us - REBOOT_BACK_US:
                self.rates.forget()  # the pipeline's clock reports the reboot
                self.counters["reboots"] += 1
            self._boot_us = sample.boot_us
        elif isinstance(sample, CommandAnswer):
            self.answers.append(sample)

    def _wanted(self, autopilot: str) -> dict[str, float]:
        wanted = {n: hz for n, hz in self.options.rates_hz.items() if ONLY_OF.get(n, autopilot) == autopilot}
        imu_hz = wanted.pop("IMU", None)
        if imu_hz is not None:
            wanted.update(dict.fromkeys(IMU_OF.get(autopilot, ("RAW_IMU", "HIGHRES_IMU")), imu_hz))
        return wanted

    def _keep(self) -> None:
        """Ask for rates and for the time, regularly."""
        knocked_us = saved_us = 0
        while not self._stop.wait(HOUSEKEEPING_S):
            now_us = host_now_us()
            if self._signer is not None and now_us - saved_us >= SAVE_EVERY_US:
                saved_us = now_us
                self._signer.save()
            if self.system_id is None:
                if now_us - knocked_us >= KNOCK_EVERY_US:
                    knocked_us = now_us
                    self._knock(now_us)
                continue
            if self.raw_out is not None:
                for answer in self._rates_owner.answers(self.system_id, self.options.autopilot_component):
                    self.raw_out(answer)
            for request in self.rates.due(now_us):
                self.send(request.command(self.system_id, self.options.autopilot_component))
            self._report_slow(now_us)
            ts1_ns = self._timesync.due(host_now_us())
            if ts1_ns is not None:
                self.send(dialect.MAVLink_timesync_message(0, ts1_ns))

    def _knock(self, now_us: int) -> None:
        """Over UDP and through routers the vehicle speaks only to those who spoke first."""
        system = self.options.system_id or DEFAULT_SYSTEM_ID
        self._write(self._sealer.pack(dialect.MAVLink_timesync_message(0, now_us * 1000), system))

    @property
    def slow(self) -> dict[str, float]:
        """Messages that come too rarely although they were asked for, and that should come: name -> rate."""
        return {name: hz for name, hz in sorted(self.rates.slow.items()) if name not in MAY_BE_MISSING}

    @property
    def unsigned_only(self) -> bool:
        """Whether a signing key is set here, and nothing but unsigned messages came."""
        return self.system_id is None and self.counters[f"refused: {RefusalCode.UNSIGNED}"] > 0

    def _report_slow(self, now_us: int) -> None:
        slow = self.slow
        for name in slow.keys() - self._slow:
            text = f"{name} comes at {slow[name]:.1f} Hz, {self.rates.wanted_hz[name]:g} Hz were asked for"
            self._event("rate_too_low", "warning", text, now_us, message=name)
        self._slow = frozenset(slow)

    def _port_changed(self, is_open: bool, why: str) -> None:
        name, severity = ("link_open", "info") if is_open else ("link_closed", "warning")
        text = f"{self._port.name} is open" if is_open else why
        self._splitters.clear()
        self._event(name, severity, text, host_now_us())

    def _event(self, name: str, severity: str, text: str, now_us: int, **details: Any) -> None:
        self._on_event(DriverEvent(name, severity, text, now_us, details))
