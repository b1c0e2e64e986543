"""The MAVLink protocol of the simulated autopilot: commands, modes, setpoints, parameters, time synchronisation.

``handle`` takes one MAVLink message at a simulated time in s, changes the ``FlightController`` and the
``TelemetryStreams``, and returns the replies, each with the delay in s after which it is sent.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.errors import DriverError
from drivers.mavlink.current_mode import AVAILABLE_MODES_ID
from drivers.simulated.vehicle.firmware import MODE_NAMES
from drivers.simulated.vehicle.flight_controller import FlightController
from drivers.simulated.vehicle.quaternion import Vector
from drivers.simulated.vehicle.telemetry_streams import DEFAULT_RATES_HZ, TelemetryStreams

Answer = Literal[
    "normal",
    "accepted",
    "denied",
    "temporarily_rejected",
    "unsupported",
    "failed",
    "in_progress_then_accepted",
    "in_progress_then_silence",
    "no_answer",
    "answer_lost",
]
"""How a command is answered: "normal" does it and says so; "accepted" says so and does nothing; the refusals
and "in_progress_then_silence" do nothing; "in_progress_then_accepted" does it with the second answer;
"no_answer" does nothing in silence; "answer_lost" does it in silence."""
_REFUSALS = {
    "denied": mavlink.MAV_RESULT_DENIED,
    "temporarily_rejected": mavlink.MAV_RESULT_TEMPORARILY_REJECTED,
    "unsupported": mavlink.MAV_RESULT_UNSUPPORTED,
    "failed": mavlink.MAV_RESULT_FAILED,
}
ACCEPTED, FAILED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_FAILED
FORCE = 21196
"""Second parameter of COMPONENT_ARM_DISARM that forces it (MAVLink's constant)."""
Replies = list[tuple[float, Any]]
"""(delay in s, message)."""


@dataclass(frozen=True, slots=True)
class ReceivedCommand:
    """One COMMAND_LONG or COMMAND_INT addressed to the autopilot."""

    time_s: float
    command: int
    name: str
    source_system: int
    source_component: int
    params: tuple[float, ...]


@dataclass(slots=True)
class AutopilotProtocol:
    """The autopilot's side of the protocol; ``commands`` and ``setpoints`` record what it received."""

    controller: FlightController
    streams: TelemetryStreams
    system_id: int = 1
    component_id: int = 1
    progress_s: float = 0.5
    """Between IN_PROGRESS and the answer that follows it."""
    commands: list[ReceivedCommand] = field(default_factory=list)
    setpoints: list[tuple[float, str, Vector]] = field(default_factory=list)
    """Velocities received: simulated time, flight mode at that moment, velocity (NED)."""
    _answers: dict[int, Answer] = field(default_factory=dict)

    def set_answer(self, command: int, answer: Answer) -> None:
        """How a MAV_CMD is answered from now on."""
        if answer not in get_args(Answer):
            raise DriverError(
                f"'{answer}' is no way to answer a command; there are {', '.join(get_args(Answer))}"
            )
        self._answers[command] = answer

    def handle(self, message: Any, time_s: float) -> Replies:
        """Process one message; the replies to it."""
        target = getattr(message, "target_system", 0)
        if target not in (0, self.system_id):
            return []
        handler = _HANDLERS.get(message.get_type())
        return [] if handler is None else handler(self, message, time_s)

    # -- commands ----------------------------------------------------------------------------------------

    def _command_long(self, m: Any, time_s: float) -> Replies:
        params = (m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7)
        return self._command(m, params, time_s)

    def _command_int(self, m: Any, time_s: float) -> Replies:
        params = (m.param1, m.param2, m.param3, m.param4, m.x / 1e7, m.y / 1e7, m.z)
        return self._command(m, params, time_s, m.frame)

    def _command(self, m: Any, params: tuple[float, ...], time_s: float, frame: int | None = None) -> Replies:
        if m.target_component not in (0, self.component_id):
            return []
        source = (m.get_srcSystem(), m.get_srcComponent())
        entry = mavlink.enums["MAV_CMD"].get(m.command)
        name = entry.name if entry is not None else str(m.command)
        self.commands.append(ReceivedCommand(time_s, m.command, name, *source, params))
        answer = self._answers.get(m.command, "normal")

        def ack(result: int) -> Any:
            return mavlink.MAVLink_command_ack_message(m.command, result, 0, 0, *source)

        if answer == "no_answer":
            return []
        if answer in _REFUSALS:
            return [(0.0, ack(_REFUSALS[answer]))]
        if answer == "accepted":
            return [(0.0, ack(ACCEPTED))]
        if answer == "in_progress_then_silence":
            return [(0.0, ack(mavlink.MAV_RESULT_IN_PROGRESS))]
        result, extra = self._do(m.command, params, frame, time_s)
        if answer == "answer_lost":
            return []
        if answer == "in_progress_then_accepted":
            return [(0.0, ack(mavlink.MAV_RESULT_IN_PROGRESS)), (self.progress_s, ack(result))]
        return [(0.0, ack(result)), *extra]

    def _do(
        self, command: int, p: tuple[float, ...], frame: int | None, time_s: float
    ) -> tuple[int, Replies]:
        c = self.controller
        if command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            forced = int(p[1]) == FORCE
            return _result(c.arm(forced) if p[0] == 1 else c.disarm(forced)), []
        if command == mavlink.MAV_CMD_DO_SET_MODE:
            if c.firmware.px4:
                name = c.firmware.mode_named(int(p[1]), 0 if math.isnan(p[2]) else int(p[2]))
                done = name is not None and c.set_mode(name)
                return ACCEPTED if done else mavlink.MAV_RESULT_TEMPORARILY_REJECTED, []
            return _result(self._switch(int(p[1]))), []
        if command == mavlink.MAV_CMD_NAV_TAKEOFF:
            return _result(c.take_off(p[6])), []
        if command == mavlink.MAV_CMD_NAV_LAND:
            return _result(c.firmware.land(c)), []
        if command == mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            return _result(c.set_mode("RTL")), []
        if command == mavlink.MAV_CMD_NAV_LOITER_UNLIM:
            return _result(c.set_mode("LOITER")), []
        if command == mavlink.MAV_CMD_DO_REPOSITION:
            return _result(self._reposition(p, frame)), []
        if command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            return self._set_interval(int(p[0]), p[1]), []
        if command == mavlink.MAV_CMD_GET_MESSAGE_INTERVAL:
            rate = self.streams.rates_hz.get(int(p[0]), 0.0)
            interval = int(1e6 / rate) if rate > 0 else -1
            return ACCEPTED, [(0.0, mavlink.MAVLink_message_interval_message(int(p[0]), interval))]
        if command == mavlink.MAV_CMD_REQUEST_MESSAGE and int(p[0]) == AVAILABLE_MODES_ID:
            return ACCEPTED, [(0.0, message) for message in c.firmware.listed_modes()]
        if command == mavlink.MAV_CMD_REQUEST_MESSAGE:
            message = self.streams.build(int(p[0]), time_s)
            return (FAILED, []) if message is None else (ACCEPTED, [(0.0, message)])
        if command == mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES:
            return ACCEPTED, [(0.0, self.streams.build(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, time_s))]
        if command == mavlink.MAV_CMD_GET_HOME_POSITION:
            return ACCEPTED, [(0.0, self.streams.build(mavlink.MAVLINK_MSG_ID_HOME_POSITION, time_s))]
        if command == mavlink.MAV_CMD_DO_CHANGE_SPEED:
            return ACCEPTED, []
        return mavlink.MAV_RESULT_UNSUPPORTED, []

    def _switch(self, custom_mode: int) -> bool:
        name = MODE_NAMES.get(custom_mode)
        return name is not None and self.controller.set_mode(name)

    def _set_interval(self, message_id: int, interval_us: float) -> int:
        if not self.streams.can_build(message_id):
            return FAILED
        if self.controller.firmware.px4 and message_id == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            return ACCEPTED  # and it stays at 1 Hz
        rate = DEFAULT_RATES_HZ.get(message_id, 0.0)
        if interval_us != 0.0:
            rate = 1e6 / interval_us if interval_us > 0 else 0.0
        self.streams.set_rate(message_id, rate)
        return ACCEPTED

    def _reposition(self, p: tuple[float, ...], frame: int | None) -> bool:
        c = self.controller
        # MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
        if int(p[1]) & 1 and not c.set_mode("GUIDED"):
            return False
        if math.isnan(p[4]) or math.isnan(p[5]):
            return False
        yaw = None if math.isnan(p[3]) else p[3]
        return c.go_to(self._local(p[4], p[5], p[6], frame), yaw)

    def _local(self, latitude: float, longitude: float, altitude: float, frame: int | None) -> Vector:
        """NED of a global place; the frame says what the altitude counts from."""
        n, e = self.streams.origin.to_local(latitude, longitude)
        relative = (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
        if frame in relative:
            return (n, e, self.controller.home[2] - altitude)
        return (n, e, self.streams.origin.altitude_m - altitude)

    # -- modes, setpoints, radio -------------------------------------------------------------------------

    def _set_mode(self, m: Any, time_s: float) -> Replies:
        self._switch(m.custom_mode)
        return []

    def _target_local(self, m: Any, time_s: float) -> Replies:
        c, mask = self.controller, m.type_mask
        body = m.coordinate_frame in (mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED)
        velocity, position = (m.vx, m.vy, m.vz), (m.x, m.y, m.z)
        if body:
            velocity, position = self._turned(velocity), self._turned(position)
        if body or m.coordinate_frame == mavlink.MAV_FRAME_LOCAL_OFFSET_NED:
            here = c.vehicle.position
            position = (here[0] + position[0], here[1] + position[1], here[2] + position[2])
        self._setpoint(mask, position, velocity, m.yaw, m.yaw_rate)
        return []

    def _target_global(self, m: Any, time_s: float) -> Replies:
        position = self._local(m.lat_int / 1e7, m.lon_int / 1e7, m.alt, m.coordinate_frame)
        self._setpoint(m.type_mask, position, (m.vx, m.vy, m.vz), m.yaw, m.yaw_rate)
        return []

    def _setpoint(self, mask: int, position: Vector, velocity: Vector, yaw: float, yaw_rate: float) -> None:
        """Position when it is not masked, or else velocity; as ArduCopter, NaN masks nothing and is refused."""
        heading = None if mask & mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE or math.isnan(yaw) else yaw
        turn = (
            None
            if mask & mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE or math.isnan(yaw_rate)
            else yaw_rate
        )
        if mask & 0b111 == 0:
            if all(map(math.isfinite, position)):
                self.controller.go_to(position, heading)
        elif mask & 0b111000 == 0 and all(map(math.isfinite, velocity)):
            self.setpoints.append((self.controller.vehicle.time_s, self.controller.mode, velocity))
            self.controller.fly(velocity, heading, turn)

    def _turned(self, v: Vector) -> Vector:
        """From forward, right, down to NED by the heading alone."""
        yaw = self.controller.vehicle.euler[2]
        c, s = math.cos(yaw), math.sin(yaw)
        return (c * v[0] - s * v[1], s * v[0] + c * v[1], v[2])

    def _target_attitude(self, m: Any, time_s: float) -> Replies:
        if m.type_mask & mavlink.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE == 0:
            # As ArduCopter's default: thrust 0.5 holds the height, 0 and 1 are the fastest sink and climb.
            climb = (m.thrust - 0.5) * 2 * self.controller.gains.max_climb
            self.controller.point(tuple(m.q), climb)
        return []

    def _rc_override(self, m: Any, time_s: float) -> Replies:
        for i in range(8):
            pulse = getattr(m, f"chan{i + 1}_raw")
            if pulse not in (0, 65535):
                self.controller.pulse_us[i] = pulse
        return []

    # -- the rest ----------------------------------------------------------------------------------------

    def _timesync(self, m: Any, time_s: float) -> Replies:
        if m.tc1 != 0:
            return []
        return [(0.0, mavlink.MAVLink_timesync_message(int(self.streams.since_boot_s(time_s) * 1e9), m.ts1))]

    def _data_stream(self, m: Any, time_s: float) -> Replies:
        for message_id in _STREAMS.get(m.req_stream_id, ()):
            self.streams.set_rate(message_id, float(m.req_message_rate) if m.start_stop else 0.0)
        return []

    @property
    def parameters(self) -> dict[str, float]:
        """By name; those of both firmwares."""
        return self.controller.parameters.values

    def _param_list(self, m: Any, time_s: float) -> Replies:
        return self.controller.parameters.all(self.controller.firmware.px4)

    def _param_read(self, m: Any, time_s: float) -> Replies:
        return self.controller.parameters.read(m, self.controller.firmware.px4)

    def _param_set(self, m: Any, time_s: float) -> Replies:
        return self.controller.parameters.set(m, self.controller.firmware.px4)

    def _landing_target(self, m: Any, time_s: float) -> Replies:
        self.controller.landing_target(m)
        return []

    def _mission_list(self, m: Any, time_s: float) -> Replies:
        source = (m.get_srcSystem(), m.get_srcComponent())
        return [(0.0, mavlink.MAVLink_mission_count_message(*source, 0, m.mission_type))]


def _result(done: bool) -> int:
    return ACCEPTED if done else FAILED


_STREAMS = {
    mavlink.MAV_DATA_STREAM_RAW_SENSORS: (mavlink.MAVLINK_MSG_ID_RAW_IMU,),
    mavlink.MAV_DATA_STREAM_EXTENDED_STATUS: (
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,
    ),
    mavlink.MAV_DATA_STREAM_RC_CHANNELS: (mavlink.MAVLINK_MSG_ID_RC_CHANNELS,),
    mavlink.MAV_DATA_STREAM_POSITION: (
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    ),
    mavlink.MAV_DATA_STREAM_EXTRA1: (mavlink.MAVLINK_MSG_ID_ATTITUDE,),
    mavlink.MAV_DATA_STREAM_EXTRA2: (mavlink.MAVLINK_MSG_ID_VFR_HUD,),
}
_STREAMS[mavlink.MAV_DATA_STREAM_ALL] = tuple(i for ids in _STREAMS.values() for i in ids)
_HANDLERS: dict[str, Callable[[AutopilotProtocol, Any, float], Replies]] = {
    "COMMAND_LONG": AutopilotProtocol._command_long,
    "COMMAND_INT": AutopilotProtocol._command_int,
    "SET_MODE": AutopilotProtocol._set_mode,
    "SET_POSITION_TARGET_LOCAL_NED": AutopilotProtocol._target_local,
    "SET_POSITION_TARGET_GLOBAL_INT": AutopilotProtocol._target_global,
    "SET_ATTITUDE_TARGET": AutopilotProtocol._target_attitude,
    "LANDING_TARGET": AutopilotProtocol._landing_target,
    "RC_CHANNELS_OVERRIDE": AutopilotProtocol._rc_override,
    "TIMESYNC": AutopilotProtocol._timesync,
    "REQUEST_DATA_STREAM": AutopilotProtocol._data_stream,
    "PARAM_REQUEST_LIST": AutopilotProtocol._param_list,
    "PARAM_REQUEST_READ": AutopilotProtocol._param_read,
    "PARAM_SET": AutopilotProtocol._param_set,
    "MISSION_REQUEST_LIST": AutopilotProtocol._mission_list,
}
