"""The settings: one TOML file, one frozen dataclass a section, every number bounded."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from landing.options import DecisionOptions, EstimatorOptions, Limits, TrackingOptions


@dataclass(frozen=True, slots=True)
class CameraSettings:
    """The camera, its calibration and how it is mounted."""

    source: str = ""
    calibration: str = ""
    mount_roll_deg: Annotated[float, Limits(-180, 180, "deg", "camera's roll in the body frame")] = 0.0
    mount_pitch_deg: Annotated[float, Limits(-180, 180, "deg", "camera's pitch in the body frame")] = 0.0
    mount_yaw_deg: Annotated[float, Limits(-180, 180, "deg", "camera's yaw in the body frame")] = 0.0
    time_offset_s: Annotated[float, Limits(-0.5, 0.5, "s", "how late the frames' time stamps are")] = 0.0


@dataclass(frozen=True, slots=True)
class VehicleSettings:
    """Which vehicle."""

    name: str = "vehicle1"
    system_id: Annotated[int, Limits(0, 255, "", "MAVLink system id; 0 takes the only one there is")] = 0


@dataclass(frozen=True, slots=True)
class MavlinkSettings:
    """The link to the autopilot."""

    connection: str = ""
    component_id: Annotated[int, Limits(1, 255, "", "our component id")] = 191
    autopilot_component: Annotated[int, Limits(1, 255, "", "the autopilot's component id")] = 1
    attitude_rate_hz: Annotated[float, Limits(1, 400, "Hz", "rate of ATTITUDE asked for")] = 100.0
    imu_rate_hz: Annotated[float, Limits(1, 400, "Hz", "rate of RAW_IMU or HIGHRES_IMU asked for")] = 100.0


@dataclass(frozen=True, slots=True)
class ZenohSettings:
    """How messages get out."""

    mode: Literal["peer", "client"] = "peer"
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    scouting: bool = False
    config: str = ""


@dataclass(frozen=True, slots=True)
class LandingSettings:
    """Whether a landing may be requested."""

    enabled: bool = False
    allowed_modes: tuple[str, ...] = ("GUIDED", "AUTO", "LOITER", "POSHOLD", "OFFBOARD", "HOLD", "MISSION", "POSCTL")


@dataclass(frozen=True, slots=True)
class Settings:
    """All sections."""

    camera: CameraSettings = field(default_factory=CameraSettings)
    vehicle: VehicleSettings = field(default_factory=VehicleSettings)
    mavlink: MavlinkSettings = field(default_factory=MavlinkSettings)
    zenoh: ZenohSettings = field(default_factory=ZenohSettings)
    tracking: TrackingOptions = field(default_factory=TrackingOptions)
    estimator: EstimatorOptions = field(default_factory=EstimatorOptions)
    decision: DecisionOptions = field(default_factory=DecisionOptions)
    landing: LandingSettings = field(default_factory=LandingSettings)
