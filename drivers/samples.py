"""What drivers hand to the companion: plain samples with the companion's own arrival time.

``arrival_us`` is the companion's clock in microseconds: the log's stamp in a replay, the monotonic clock set
against the wall clock once at the start when live. ``boot_us`` is the autopilot's time since boot.
Angles are aerospace roll, pitch, yaw (body FRD in world NED), rates body FRD, all SI and radians.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drivers.refusals import RefusalCode

Vector3 = tuple[float, float, float]

GRAVITY = 9.80665
"""Standard gravity, m/s^2."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One camera frame; ``image`` is (height, width) uint8 grey; ``stamp_us`` as the camera driver stamped it."""

    number: int
    stamp_us: int
    arrival_us: int
    image: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Attitude:
    """ATTITUDE (or ATTITUDE_QUATERNION where that is all there is)."""

    arrival_us: int
    boot_us: int
    roll: float
    pitch: float
    yaw: float
    rollspeed: float = 0.0
    pitchspeed: float = 0.0
    yawspeed: float = 0.0


@dataclass(frozen=True, slots=True)
class Imu:
    """RAW_IMU, SCALED_IMU or HIGHRES_IMU, body FRD; ``source`` is the message's name.

    ``rate`` of turn in rad/s, ``force``: specific force in m/s^2, None without an accelerometer.
    """

    arrival_us: int
    boot_us: int
    rate: Vector3
    force: Vector3 | None = None
    source: str = "RAW_IMU"


@dataclass(frozen=True, slots=True)
class Velocity:
    """LOCAL_POSITION_NED: position in m and velocity in m/s, world NED."""

    arrival_us: int
    boot_us: int
    position_ned: Vector3
    velocity_ned: Vector3


@dataclass(frozen=True, slots=True)
class Distance:
    """DISTANCE_SENSOR of a rangefinder that looks down along the body's z axis.

    ``distance_m`` is None out of the sensor's own limits and where it calls the signal bad; ``std_m`` is one sigma,
    None where it reports none.
    """

    arrival_us: int
    boot_us: int
    distance_m: float | None
    std_m: float | None
    min_m: float
    max_m: float


@dataclass(frozen=True, slots=True)
class EstimatorReport:
    """What the autopilot's estimator says of its own errors; ``source`` is the message's or the log's name for it.

    ``velocity_known``, ``attitude_known``: whether it calls them good, None where the message does not say.
    ``velocity_std`` (m/s, an axis) and ``tilt_std`` (rad, roll or pitch): one sigma, None where it does not say.
    """

    arrival_us: int
    source: str
    velocity_known: bool | None = None
    attitude_known: bool | None = None
    velocity_std: float | None = None
    tilt_std: float | None = None


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """The autopilot's HEARTBEAT; ``mode`` is the flight mode by name ("GUIDED", "LAND", ...).

    ``system_status`` is a MAV_STATE, ``vehicle_type`` a MAV_TYPE by name ("quadrotor", "vtol_tiltrotor").
    """

    arrival_us: int
    armed: bool
    mode: str
    autopilot: str
    system_status: int
    vehicle_type: str = "quadrotor"


@dataclass(frozen=True, slots=True)
class CurrentMode:
    """CURRENT_MODE (PX4): the flight mode, and the one that the pilot or a program asked for last, by name.

    ``intended`` is empty where the autopilot does not report it. The two differ while a failsafe flies another mode.
    """

    arrival_us: int
    mode: str
    intended: str


@dataclass(frozen=True, slots=True)
class SystemStatus:
    """SYS_STATUS: what the autopilot says of its radio receiver."""

    arrival_us: int
    radio_present: bool
    radio_enabled: bool
    radio_healthy: bool


@dataclass(frozen=True, slots=True)
class StatusText:
    """The autopilot's STATUSTEXT; ``severity`` is a MAV_SEVERITY (0 is the gravest). One chunk of a longer text."""

    arrival_us: int
    severity: int
    text: str


@dataclass(frozen=True, slots=True)
class ManualControl:
    """MANUAL_CONTROL: x, y, z, r of a joystick, -1000 to 1000 (z often 0 to 1000); None where there is no such axis."""

    arrival_us: int
    axes: tuple[int | None, int | None, int | None, int | None]


@dataclass(frozen=True, slots=True)
class LandedState:
    """EXTENDED_SYS_STATE: "undefined", "on_ground", "in_air", "takeoff" or "landing".

    ``vtol_state``: "undefined" (also of what is no VTOL), "transition", "multicopter" or "fixed_wing".
    """

    arrival_us: int
    state: str
    vtol_state: str = "undefined"


@dataclass(frozen=True, slots=True)
class RcChannels:
    """RC_CHANNELS: pulse widths in microseconds, channel 1 first; 0 where there is none."""

    arrival_us: int
    pulse_us: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class ClockOffset:
    """One TIMESYNC round trip: companion clock minus autopilot clock, and the trip's length."""

    arrival_us: int
    boot_us: int
    offset_us: int
    round_trip_us: int


@dataclass(frozen=True, slots=True)
class SystemTime:
    """SYSTEM_TIME: the autopilot's date in microseconds since 1970; 0 while it does not know it."""

    arrival_us: int
    unix_us: int


@dataclass(frozen=True, slots=True)
class CommandAnswer:
    """COMMAND_ACK to a command of ours; ``result`` by MAVLink name without the prefix ("ACCEPTED", ...)."""

    arrival_us: int
    command: int
    result: str


@dataclass(frozen=True, slots=True)
class Refusal:
    """An input that was refused, with its reason; counted, never dropped in silence."""

    arrival_us: int
    source: str
    reason: RefusalCode
    detail: str = field(default="", compare=False)


Sample = (
    Frame
    | Attitude
    | Imu
    | Velocity
    | Distance
    | EstimatorReport
    | Heartbeat
    | CurrentMode
    | SystemStatus
    | SystemTime
    | StatusText
    | ManualControl
    | LandedState
    | RcChannels
    | ClockOffset
    | CommandAnswer
    | Refusal
)
