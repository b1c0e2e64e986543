"""The autopilot's link without a socket: real MAVLink packets both ways in simulated time, delayed and lost.

What a daemon has in threads (telemetry decoder, TIMESYNC, the command to land and its answer) runs here in one,
so that a flight is the same every time.
"""

import random
from collections import deque
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.core.command import NAV_LAND, NO_ANSWER
from companion.settings.settings import Settings
from companion.simulation.scenario import Scenario
from drivers.autopilot.landing_target import LandingTarget
from drivers.mavlink.telemetry import TelemetryDecoder
from drivers.mavlink.timesync import TimeSync
from drivers.samples import CommandAnswer, Sample
from drivers.simulated.vehicle.autopilot_protocol import AutopilotProtocol
from drivers.simulated.vehicle.firmware import MODES
from drivers.simulated.vehicle.mavlink_pilot import VELOCITY_ONLY
from drivers.simulated.vehicle.telemetry_streams import TelemetryStreams

NO_ANSWER_S = 2.0
"""MAVSDK gives up this long after the command when nothing came, as measured."""
NO_OUTCOME_S = 10.0
"""The same when the autopilot said IN_PROGRESS."""
OWN_SYSTEM, OWN_COMPONENT = 1, 191


class VirtualLink:
    """Packets between a simulated autopilot and the core. Times in simulated seconds from 0.

    ``epoch_us`` is the companion's clock at 0. ``packets`` keeps (arrival, bytes) for a recording when ``keep``.
    """

    def __init__(
        self,
        scenario: Scenario,
        settings: Settings,
        streams: TelemetryStreams,
        protocol: AutopilotProtocol,
        epoch_us: int,
        keep: bool = False,
    ) -> None:
        link = scenario.link
        self._streams, self._protocol, self._epoch_us = streams, protocol, epoch_us
        self._delay = (link.delay_min_s, max(link.delay_max_s, link.delay_min_s))
        self._loss = link.loss
        self._random = random.Random(scenario.basics.seed + 17)
        self._vehicle = mavlink.MAVLink(
            None, srcSystem=protocol.system_id, srcComponent=protocol.component_id
        )
        self._companion = mavlink.MAVLink(None, srcSystem=OWN_SYSTEM, srcComponent=OWN_COMPONENT)
        self._decoder = TelemetryDecoder(0, protocol.component_id, OWN_COMPONENT)
        self._target = LandingTarget()
        self._timesync = TimeSync(1 / settings.mavlink.timesync_rate_hz)
        self._to_vehicle: deque[tuple[float, Any]] = deque()
        self._to_companion: deque[tuple[float, bytes]] = deque()
        self._later: list[tuple[float, Any]] = []
        self._command_s: float | None = None
        self._in_progress = False
        self._dark_until_s = -1.0
        self.silent = False
        self.packets: list[tuple[int, bytes]] | None = [] if keep else None
        m, rate = settings.mavlink, link.telemetry_rate_hz
        self._rates = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: min(rate, m.attitude_rate_hz),
            mavlink.MAVLINK_MSG_ID_RAW_IMU: min(rate, m.imu_rate_hz),
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: m.position_rate_hz,
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: m.state_rate_hz,
            mavlink.MAVLINK_MSG_ID_RC_CHANNELS: m.state_rate_hz,
        }
        if not scenario.sensors.velocity_told:
            del self._rates[mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED]
        self._ask_for_rates()

    def land(self, time_s: float) -> None:
        """Send MAV_CMD_NAV_LAND."""
        self._command_s, self._in_progress = time_s, False
        self._send(mavlink.MAVLink_command_long_message(1, 1, NAV_LAND, 0, 0, 0, 0, 0, 0, 0, 0), time_s)

    def fly(self, time_s: float, velocity_ned: tuple[float, float, float]) -> None:
        """Send a velocity (NED, m/s), the heading held."""
        north, east, down = velocity_ned
        self._send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, mavlink.MAV_FRAME_LOCAL_NED, VELOCITY_ONLY, 0, 0, 0, north, east, down, 0, 0, 0, 0, 0
            ),
            time_s,
        )

    def target(self, time_s: float, target_ned: tuple[float, float, float], true_at_us: int) -> None:
        """Send LANDING_TARGET for a place in m from where the vehicle was at ``true_at_us``."""
        message = self._target.message(target_ned, true_at_us, self._clock_us(time_s))
        if message is not None:
            self._send(message, time_s)

    def hold(self, time_s: float) -> None:
        """Ask for the mode BRAKE, as MAVSDK's Offboard.stop does with an ArduCopter."""
        custom = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        self._send(
            mavlink.MAVLink_command_long_message(
                1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, custom, MODES["BRAKE"], 0, 0, 0, 0, 0
            ),
            time_s,
        )

    def reboot(self, time_s: float, down_s: float) -> None:
        """The autopilot falls silent and counts from zero afterwards."""
        self._dark_until_s = time_s + down_s

    def step(self, time_s: float) -> list[Sample]:
        """Let packets travel; the samples that have arrived by now, in order."""
        if self._dark_until_s > 0 and time_s >= self._dark_until_s:
            self._dark_until_s = -1.0
            self._streams.reset()
            self._streams.boot_s = time_s
            self._ask_for_rates()
        dark = time_s < self._dark_until_s
        if not dark:
            for message in self._streams.due(time_s):
                self._post(message, time_s)
        stamp = self._timesync.due(self._clock_us(time_s))
        if stamp is not None:
            self._send(mavlink.MAVLink_timesync_message(0, stamp), time_s)
        while self._to_vehicle and self._to_vehicle[0][0] <= time_s:
            at, message = self._to_vehicle.popleft()
            if not dark:
                self._later += [(at + d, reply) for d, reply in self._protocol.handle(message, at)]
        for entry in [e for e in self._later if e[0] <= time_s]:
            self._later.remove(entry)
            if not dark:
                self._post(entry[1], entry[0])
        return [*self._arrivals(time_s), *self._give_up(time_s)]

    def _arrivals(self, time_s: float) -> list[Sample]:
        samples: list[Sample] = []
        while self._to_companion and self._to_companion[0][0] <= time_s:
            at, packet = self._to_companion.popleft()
            arrival_us = self._clock_us(at)
            if self.packets is not None:
                self.packets.append((arrival_us, packet))
            message = self._companion.decode(bytearray(packet))
            if message.get_type() == "TIMESYNC" and not self._timesync.answers_us(message.tc1, message.ts1):
                continue
            for sample in self._decoder.decode(message, arrival_us):
                if isinstance(sample, CommandAnswer):
                    self._in_progress = sample.result == "IN_PROGRESS"
                    self._command_s = self._command_s if self._in_progress else None
                self._target.feed(sample)
                samples.append(sample)
        return samples

    def _give_up(self, time_s: float) -> list[Sample]:
        limit = NO_OUTCOME_S if self._in_progress else NO_ANSWER_S
        if self._command_s is None or time_s - self._command_s < limit:
            return []
        self._command_s = None
        return [CommandAnswer(self._clock_us(time_s), NAV_LAND, NO_ANSWER)]

    def _ask_for_rates(self) -> None:
        self._streams.rates_hz = {k: v for k, v in self._rates.items() if v > 0}

    def _post(self, message: Any, time_s: float) -> None:
        """From the autopilot."""
        packet = bytes(message.pack(self._vehicle))
        self._vehicle.seq = (self._vehicle.seq + 1) % 256
        if self.silent or self._lost():
            return
        at = time_s + self._random.uniform(*self._delay)
        if self._to_companion:
            at = max(at, self._to_companion[-1][0])
        self._to_companion.append((at, packet))

    def _send(self, message: Any, time_s: float) -> None:
        """To the autopilot."""
        packet = message.pack(self._companion)
        self._companion.seq = (self._companion.seq + 1) % 256
        if self.packets is not None:
            self.packets.append((self._clock_us(time_s), bytes(packet)))
        if self.silent or self._lost():
            return
        at = time_s + self._random.uniform(*self._delay)
        if self._to_vehicle:
            at = max(at, self._to_vehicle[-1][0])
        self._to_vehicle.append((at, self._vehicle.decode(bytearray(packet))))

    def _clock_us(self, time_s: float) -> int:
        return self._epoch_us + round(time_s * 1e6)

    def _lost(self) -> bool:
        return self._loss > 0 and self._random.random() < self._loss
